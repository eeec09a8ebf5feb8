"""`gymnasium.make("MarsExplorer-v0")`: a thin adapter on the rules."""

from __future__ import annotations

import copy
import secrets
from collections.abc import Collection
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Self

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from marsexplorer.config import (
    ACTIONS,
    MAX_SEED,
    OUTCOMES,
    RUNNING,
    TIMED_OUT,
    EnvConfig,
    check_seed,
)
from marsexplorer.episode import score
from marsexplorer.maps import GridMap, read_map
from marsexplorer.observation import STATE_VALUES, action_masks
from marsexplorer.rules import NO_SEED, OUTCOME
from marsexplorer.terrain import next_seed
from marsexplorer.world import Worlds, check_action, positions

_RGB = [[14, 11, 13], [201, 122, 74], [255, 179, 71], [107, 74, 58]]
COLOURS: NDArray[np.uint8] = np.array(_RGB, np.uint8)
GLYPHS = "?.@#"
CELL_PIXELS = 12

SHARED = frozenset({"config", "_spec"})
"""What nobody changes of `packed` attributes, so that copies may share it."""
PLAIN = frozenset({int, float, str, bool, type(None)})

KEYS = {ord("w"): 0, ord("d"): 1, ord("s"): 2, ord("a"): 3}
"""Letters of a keyboard and the moves that they make."""
ARROWS = {1073741906: 0, 1073741903: 1, 1073741905: 2, 1073741904: 3}
"""The arrow keys as pygame numbers them, and the moves that they make."""


class LimitedSpec:
    """The spec of an environment that ends its episodes without a TimeLimit."""

    config: EnvConfig
    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """The spec that it was made from, with the moves after which an episode ends."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        limit = self.config.limit
        self._spec = None if spec is None else replace(spec, max_episode_steps=limit)


class MarsExplorer(LimitedSpec, gymnasium.Env[NDArray[Any], np.int64]):
    """Explore an unknown terrain with a lidar rover (Koutras et al. 2021, section 2).

    level          `random`, `t-m-b`, `building`, `cave` or `map`, see config.ALL_LEVELS
    size           cells a side, or (rows, cols)
    sensor_radius  reach of the lidar, cells
    beta           share of cells to discover
    max_steps      moves until truncation, rows * cols by default
    discoverable_only  whether only cells count that can be discovered, see config.EnvConfig; None:
                       as the level has it
    observation    "float32": Box(0, 1, (rows, cols)), eq. 6; "uint8": codes 0 unknown, 1 free, 2
                   rover, 3 obstacle

    Actions: Discrete(4), 0 north, 1 east, 2 south, 3 west. `reset(seed=s)` gives the terrain of
    seed s; without a seed the terrain of the seed that follows the last. `reset(options={"terrain":
    bool[rows, cols], "start": (row, col)})` plays a given terrain, and options={"map": ...} a
    robot's map: the path of a map_server file or a `maps.GridMap`, with level="map". A copy by
    `copy.deepcopy` or `pickle` plays on by itself, with random numbers of its own that go on as the
    original's do. `info`: position, discovered (cells), coverage, score, outcome (None while
    running), terrain_seed.
    """

    metadata = {"render_modes": ["rgb_array", "ansi"], "render_fps": 10}  # noqa: RUF012  # gymnasium's own convention

    def __init__(
        self,
        level: str = "random",
        size: int | tuple[int, int] = 21,
        sensor_radius: int = 6,
        beta: float = 0.99,
        max_steps: int | None = None,
        render_mode: str | None = None,
        observation: str = "float32",
        discoverable_only: bool | None = None,
    ) -> None:
        self.render_mode = check_render_mode(render_mode)
        limits = (sensor_radius, beta, max_steps, discoverable_only)
        self.config = EnvConfig.of(level, size, *limits)
        self._raw = observation == "uint8"
        box, discrete = unsampled(self.config, observation)
        self.observation_space, self.action_space = copy.copy(box), copy.copy(discrete)
        self._worlds = Worlds(self.config)
        self._action = np.zeros(1, np.int64)
        self._seed: int | None = None
        self._scalars = self._worlds.head(0)
        self._total = 0.0
        self._running = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Start an episode and return its first observation and info."""
        seed = None if seed is None else check_seed(seed)
        super().reset(seed=seed)
        options = options or {}
        unknown = set(options) - {"terrain", "start", "map"}
        if unknown:
            came = ", ".join(sorted(map(str, unknown)))
            raise ValueError(f"options may hold terrain and start, or map, got {came}")
        if "map" in options:
            if len(options) > 1:
                raise ValueError("a map has its own terrain and start: options={'map': ...} alone")
            self._start_on_map(options["map"])
        elif "terrain" in options:
            self._worlds.start_on(0, options["terrain"], tuple(options.get("start", (0, 0))))
        elif "start" in options:
            example = "options={'terrain': ..., 'start': (row, col)}"
            raise ValueError(f"a start needs a terrain: {example}")
        else:
            self._seed = following(self._seed) if seed is None else seed
            self._worlds.start_one(0, self._seed)
        self._running, self._total = True, 0.0
        return self._observe(), self._info()

    def _start_on_map(self, map_or_path: Path | str | GridMap) -> None:
        """Start on a robot's map; ValueError when the environment is not made for it."""
        grid_map = map_or_path if isinstance(map_or_path, GridMap) else read_map(map_or_path)
        shape = grid_map.terrain.shape
        if not self.config.discoverable_only:
            way_out = 'make the environment with level="map"'
            raise ValueError(f"a map has walls that are never seen whole: {way_out}")
        if shape != (self.config.rows, self.config.cols):
            cells = f"{shape[0]} x {shape[1]} cells"
            raise ValueError(f"the map has {cells}: make the environment with size={shape}")
        self._worlds.start_on(0, grid_map.terrain, grid_map.start)

    def step(self, action: np.int64) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Make one move; see the class for what comes back."""
        if not self._running:
            raise RuntimeError("no episode is running: call reset() first")
        self._action[0] = check_action(action)
        reward = float(self._worlds.step(self._action)[0])
        self._total += reward
        outcome = self._scalars[OUTCOME]
        self._running = outcome == RUNNING
        terminated, truncated = RUNNING < outcome < TIMED_OUT, outcome == TIMED_OUT
        return self._observe(), reward, terminated, truncated, self._info()

    @property
    def terrain(self) -> NDArray[np.bool_]:
        """The true map: bool[rows, cols], True where blocked."""
        return self._worlds.terrain(0)

    def action_masks(self) -> NDArray[np.bool_]:
        """Return bool[4]: which moves stay on the grid and off known obstacles."""
        masks = action_masks(self._worlds.codes, positions(self._worlds.scalars))
        return np.asarray(masks[0])

    def render(self) -> Any:
        """What the rover knows: an RGB picture (12 pixels a cell), text, or None."""
        return drawn(self._worlds.codes[0], self.render_mode)

    def get_keys_to_action(self) -> dict[tuple[int, ...], int]:
        """The keys of `gymnasium.utils.play`: WASD and arrows.

        Call it with `wait_on_player=True`: no move stands still.
        """
        return {(key,): action for key, action in (KEYS | ARROWS).items()}

    def _spaces(self) -> tuple[spaces.Box, spaces.Discrete]:
        """The spaces as they are made, which nobody samples."""
        return unsampled(self.config, "uint8" if self._raw else "float32")

    def __getstate__(self) -> dict[str, Any]:
        state = packed(self.__dict__, ("_scalars", "_action"))  # a live view, and room for a move
        box, discrete = self._spaces()
        if (
            getattr(self.observation_space, "low", None) is box.low
            and self.action_space == discrete
        ):
            # the bounds are as they were made, and take half of a pickle's time
            state["observation_space"] = self.observation_space._np_random
            state["action_space"] = self.action_space._np_random
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(unpacked(state))
        for name, space in zip(("observation_space", "action_space"), self._spaces(), strict=True):
            generator = state[name]
            if not isinstance(generator, spaces.Space):
                setattr(self, name, copy.copy(space))
                getattr(self, name)._np_random = generator
        self._action = np.zeros(1, np.int64)
        self._scalars = self._worlds.head(0)

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        twin = self.__class__.__new__(self.__class__)
        memo[id(self)] = twin
        twin.__setstate__(copied(self.__getstate__(), memo))
        return twin

    def _observe(self) -> NDArray[Any]:
        codes = self._worlds.codes[0]
        observation: NDArray[Any] = codes.copy() if self._raw else STATE_VALUES[codes]
        return observation

    def _info(self) -> dict[str, Any]:
        packed, _, discovered, _, seed, outcome, cells, _ = self._scalars
        return {
            "position": (packed >> 32, packed & 0xFFFFFFFF),
            "discovered": discovered,
            "coverage": discovered / cells,
            "score": score(self.config, self._total, cells),
            "outcome": OUTCOMES[outcome] if outcome else None,
            "terrain_seed": None if seed == NO_SEED else seed,
        }


def observation_space(config: EnvConfig, observation: str) -> spaces.Box:
    """Return the space of one observation, by its name."""
    if observation == "float32":
        return spaces.Box(0.0, 1.0, (config.rows, config.cols), np.float32)
    if observation == "uint8":
        return spaces.Box(0, 3, (config.rows, config.cols), np.uint8)
    raise ValueError(f'observation must be "float32" or "uint8", got {observation!r}')


@lru_cache(maxsize=64)
def unsampled(config: EnvConfig, observation: str) -> tuple[spaces.Box, spaces.Discrete]:
    """The spaces of an observation and of an action, to be copied and not sampled."""
    return observation_space(config, observation), spaces.Discrete(len(ACTIONS))


def following(seed: int | None) -> int:
    """The seed after the last one, or a fresh one of the operating system for None."""
    return secrets.randbelow(MAX_SEED + 1) if seed is None else next_seed(seed)


def check_render_mode(render_mode: str | None) -> str | None:
    """Return a render mode that is one; ValueError otherwise."""
    if render_mode not in (None, "rgb_array", "ansi"):
        raise ValueError(f'render_mode must be None, "rgb_array" or "ansi", got {render_mode!r}')
    return render_mode


def drawn(codes: NDArray[np.uint8], render_mode: str | None) -> Any:
    """A grid as the picture or the text of a render mode, None without one."""
    if render_mode == "ansi":
        return "\n".join("".join(GLYPHS[code] for code in row) for row in codes) + "\n"
    if render_mode == "rgb_array":
        return COLOURS[codes].repeat(CELL_PIXELS, axis=0).repeat(CELL_PIXELS, axis=1)
    return None


class RestoredSeeds(np.random.SeedSequence):
    """The seeds of a restored generator; what they spawn is hashed as ever.

    NumPy hashes the seeds of a new generator, even if its state is written over at once.
    """

    is_written_over = False
    """Whether the state that they would give is not needed, and so not hashed."""

    def generate_state(self, n_words: int, dtype: Any = np.uint32) -> NDArray[Any]:
        if self.is_written_over:
            return np.zeros(n_words, dtype)
        return super().generate_state(n_words, dtype)


def packed(members: dict[str, Any], views: Collection[str]) -> dict[str, Any]:
    """The attributes of an environment for a pickle or a copy, without its views.

    A random generator becomes its state and that of its seeds, which takes a quarter of the time.
    """
    state = {name: member for name, member in members.items() if name not in views}
    generator = state.get("_np_random")
    if generator is not None and type(generator.bit_generator) is np.random.PCG64:
        seeds = generator.bit_generator.seed_seq
        if isinstance(seeds, np.random.SeedSequence):
            state["_np_random"] = (generator.bit_generator.state, seeds.state)
    return state


def unpacked(state: dict[str, Any]) -> dict[str, Any]:
    """The attributes of an environment from what `packed` made of them."""
    if isinstance(state.get("_np_random"), tuple):
        numbers, of_seeds = state["_np_random"]
        seeds = RestoredSeeds(**of_seeds)
        seeds.is_written_over = True
        bits = np.random.PCG64(seeds)
        bits.state = numbers
        seeds.is_written_over = False
        return {**state, "_np_random": np.random.Generator(bits)}
    return state


def copied(state: dict[str, Any], memo: dict[int, Any]) -> dict[str, Any]:
    """A copy of what `packed` made; what nobody changes is shared."""
    return {name: _copied(name, member, memo) for name, member in state.items()}


def _copied(name: str, member: Any, memo: dict[int, Any]) -> Any:
    is_state = name == "_np_random" and isinstance(member, tuple)
    if is_state or name in SHARED or type(member) in PLAIN:
        return member
    if type(member) in (
        spaces.Box,
        spaces.Discrete,
        spaces.MultiDiscrete,
    ):  # their bounds do not change
        space = copy.copy(member)
        if space._np_random is not None:
            space._np_random = copy.deepcopy(space._np_random)
        return space
    return copy.deepcopy(member, memo)
