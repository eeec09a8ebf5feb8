"""The authors' code as environments of Gymnasium and of gym, alone or in batches."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from marsexplorer.compat.config import CodeConfig, Conf
from marsexplorer.compat.kernels import DISCOVERED, OUTCOME, RUNNING, SHIFTS, X, Y
from marsexplorer.compat.worlds import OUTCOMES, CodeWorlds
from marsexplorer.config import check_seed
from marsexplorer.env import drawn, following
from marsexplorer.observation import DISPLACEMENTS, STATE_VALUES
from marsexplorer.terrain import next_seed
from marsexplorer.vector import SAME_STEP, VectorStep, starting_seeds
from marsexplorer.world import not_actions

OWN_SHIFTS: NDArray[np.int64] = np.array(DISPLACEMENTS, np.int64)
"""What this project's actions add to (x, y): north, east, south, west."""
OPTIONS = {"terrain", "start"}


class KoutrasCode(gymnasium.Env[NDArray[Any], np.int64]):
    """The authors' code with this project's actions and observation.

    Actions: north, east, south, west; observation: (rows, cols).

    preset       of PRESETS
    conf         what differs from it, by the authors' names
    observation  "float32": Box(0, 1, (rows, cols)); "uint8": codes 0 unknown, 1 free, 2 rover, 3
                 obstacle

    `reset(seed=s)` gives the terrain of seed s, without a seed the next one's; with
    options={"terrain": bool[rows, cols], "start": (x, y)}, of which either may be left out, what is
    given. Every end is `terminated`, the time limit too, as in the authors' code.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 6}  # noqa: RUF012  # gymnasium's own convention
    shifts = OWN_SHIFTS

    def __init__(
        self,
        preset: str = "exploConf",
        conf: Conf | None = None,
        render_mode: str | None = None,
        observation: str = "float32",
    ) -> None:
        self.config = CodeConfig.of(preset, conf)
        self.render_mode = render_mode
        self.action_space = spaces.Discrete(len(self.shifts))
        self.observation_space = observation_space(self.config, observation)
        self._is_raw = observation == "uint8"
        self._worlds = CodeWorlds(self.config, 1, self.shifts)
        self._seed: int | None = None
        self._is_running = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Start an episode and return its first observation and info."""
        super().reset(seed=seed)
        options = options or {}
        if unknown := sorted(set(options) - OPTIONS):
            raise ValueError(f"options may hold terrain and start, got {', '.join(unknown)}")
        terrain, start = options.get("terrain"), options.get("start")
        if terrain is not None:
            self._worlds.start_on(0, terrain, start)
        else:
            self._seed = following(self._seed) if seed is None else check_seed(seed)
            self._worlds.start(0, self._seed, start)
        self._is_running = True
        return self._observe(), self._worlds.info(0)

    def step(self, action: np.int64) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Make one move."""
        if not self._is_running:
            raise RuntimeError("no episode is running: call reset() first")
        if not self.action_space.contains(action):
            raise ValueError(f"action must be 0, 1, 2 or 3, got {action!r}")
        reward = float(self._worlds.step(np.array([action], np.int64))[0])
        is_over = bool(self._worlds.scalars[0, OUTCOME] != RUNNING)
        self._is_running = not is_over
        return self._observe(), reward, is_over, False, self._worlds.info(0)

    def render(self) -> Any:
        """Return what the rover knows as an RGB picture, 12 pixels a cell."""
        return drawn(self._worlds.codes[0], "rgb_array")

    @property
    def terrain(self) -> NDArray[np.bool_]:
        """The true map: bool[rows, cols], True where blocked."""
        blocked: NDArray[np.bool_] = self._worlds.terrains[0].astype(np.bool_)
        return blocked.reshape(self.config.rows, self.config.cols)

    def _observe(self) -> NDArray[Any]:
        return self._worlds.codes[0].copy() if self._is_raw else self._worlds.values(0)


class ExploConf(KoutrasCode):
    """The authors' code with their names, actions and observation.

    Actions: x + 1, x - 1, y + 1, y - 1; observation: (x, y, 1).
    """

    shifts = SHIFTS

    def __init__(
        self, conf: Conf | None = None, preset: str = "exploConf", render_mode: str | None = None
    ) -> None:
        super().__init__(preset, conf, render_mode)
        shape = (self.config.rows, self.config.cols, 1)
        self.observation_space = spaces.Box(0.0, 1.0, shape, np.float32)

    @property
    def conf(self) -> dict[str, Any]:
        """The whole configuration."""
        return {**deepcopy(dict(self.config.conf)), "viewer": {}}

    @property
    def x(self) -> int:
        """Where the rover is."""
        return int(self._worlds.scalars[0, X])

    @property
    def y(self) -> int:
        """Where the rover is."""
        return int(self._worlds.scalars[0, Y])

    @property
    def groundTruthMap(self) -> NDArray[np.float32]:  # noqa: N802
        """The true map: 1 where blocked, 0.3 elsewhere."""
        return np.where(self.terrain, np.float32(1.0), np.float32(0.3))

    @property
    def exploredMap(self) -> NDArray[np.float32]:  # noqa: N802
        """What the rover knows: 0, 0.3, 0.6 and 1."""
        values: NDArray[np.float32] = STATE_VALUES[self._worlds.codes[0]]
        return values

    def _observe(self) -> NDArray[Any]:
        return self._worlds.values(0)[:, :, None]


class GymEnv:
    """`ExploConf` with the calls of gym before 0.26."""

    def __init__(self, env: ExploConf) -> None:
        self.unwrapped = env
        self._next_seed: int | None = None

    def __getattr__(self, name: str) -> Any:
        if name == "unwrapped":  # a copy asks before it has one
            raise AttributeError(name)
        return getattr(self.unwrapped, name)

    def seed(self, seed: int) -> list[int]:
        """Let the next reset give the terrain of a seed."""
        self._next_seed = check_seed(seed)
        return [seed]

    def reset(self) -> NDArray[Any]:
        """Start an episode and return its first observation."""
        seed, self._next_seed = self._next_seed, None
        return self.unwrapped.reset(seed=seed)[0]

    def step(self, action: Any) -> tuple[NDArray[Any], float, bool, dict[str, Any]]:
        """Make one move; return observation, reward, done and info."""
        observation, reward, done, _, info = self.unwrapped.step(action)
        return observation, reward, done, info


def make(conf: Conf | None = None, returns: str = "gymnasium", preset: str = "exploConf") -> Any:
    """Return the authors' environment.

    Args:
        conf: what differs from the preset, by the authors' names.
        returns: "gymnasium", two values from reset and five from step, or "gym", one and four.
        preset: a name in PRESETS.
    """
    if returns not in ("gym", "gymnasium"):
        raise ValueError(f'returns must be "gym" or "gymnasium", got {returns!r}')
    env = ExploConf(conf, preset)
    return GymEnv(env) if returns == "gym" else env


def observation_space(config: CodeConfig, observation: str) -> spaces.Box:
    """Return the space of one observation, by its name."""
    if observation == "float32":
        return spaces.Box(0.0, 1.0, (config.rows, config.cols), np.float32)
    if observation == "uint8":
        return spaces.Box(0, 3, (config.rows, config.cols), np.uint8)
    raise ValueError(f'observation must be "float32" or "uint8", got {observation!r}')


class KoutrasCodeVector(VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """`num_envs` KoutrasCode environments stepped at once, equal to single ones.

    An environment that ends begins at once on the seed that follows its own (same-step autoreset).
    Observations are new arrays.
    """

    metadata = {"autoreset_mode": SAME_STEP, "render_modes": []}  # noqa: RUF012  # gymnasium's own convention

    def __init__(
        self,
        num_envs: int = 1,
        preset: str = "exploConf",
        conf: Conf | None = None,
        observation: str = "float32",
    ) -> None:
        self.num_envs, self.config = num_envs, CodeConfig.of(preset, conf)
        self.single_observation_space = observation_space(self.config, observation)
        self.single_action_space = spaces.Discrete(len(OWN_SHIFTS))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._is_raw = observation == "uint8"
        self._worlds = CodeWorlds(self.config, num_envs, OWN_SHIFTS)
        self._was_reset = False

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Start every environment, i on seed + i, and return the observations and infos."""
        if options:
            raise ValueError("a batch takes no options: play given terrains one at a time")
        last = self._worlds.seeds.tolist() if self._was_reset else None
        for i, terrain_seed in enumerate(starting_seeds(seed, self.num_envs, last)):
            self._worlds.start(i, terrain_seed)
        self._was_reset = True
        return self._observe(), self._info()

    def step(self, actions: NDArray[Any]) -> VectorStep:
        """Make one move in every environment."""
        moves = np.asarray(actions)
        is_whole = moves.shape == (self.num_envs,) and moves.dtype.kind in "iu"
        if not is_whole or not ((moves >= 0) & (moves < len(OWN_SHIFTS))).all():
            raise not_actions(self.num_envs, actions)
        worlds = self._worlds
        rewards = worlds.step(moves.astype(np.int64))
        ended = worlds.scalars[:, OUTCOME] != RUNNING
        final: dict[str, Any] = {}
        if ended.any():
            final = self._finals(ended)
            for i in np.flatnonzero(ended).tolist():
                worlds.start(i, next_seed(int(worlds.seeds[i])))
        truncated = np.zeros(self.num_envs, np.bool_)
        return self._observe(), rewards, ended, truncated, {**self._info(), **final}

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return copies of everything that changes with a step."""
        return self._worlds.snapshot()

    def restore(self, snapshot: dict[str, NDArray[Any]]) -> NDArray[Any]:
        """Restore a snapshot of environments like these; return their observations."""
        self._worlds.restore(snapshot)
        self._was_reset = True
        return self._observe()

    def _observe(self) -> NDArray[Any]:
        if self._is_raw:
            return self._worlds.codes.copy()
        return np.stack([self._worlds.values(i) for i in range(self.num_envs)])

    def _finals(self, ended: NDArray[np.bool_]) -> dict[str, Any]:
        """Return what `info` says of the episodes that ended in this step."""
        observations = np.full(self.num_envs, None, object)
        last = self._observe()
        for i in np.flatnonzero(ended):
            observations[i] = last[i]
        finals = {"final_obs": observations, "final_info": self._info()}
        return finals | {"_final_obs": ended.copy(), "_final_info": ended.copy()}

    def _info(self) -> dict[str, Any]:
        scalars, always = self._worlds.scalars, np.ones(self.num_envs, np.bool_)
        outcomes = np.full(self.num_envs, None, object)
        outcomes[:] = [OUTCOMES[code] for code in scalars[:, OUTCOME]]
        info = {
            "position": scalars[:, [X, Y]].copy(),
            "discovered": scalars[:, DISCOVERED].copy(),
            "coverage": scalars[:, DISCOVERED] / self.config.n,
            "outcome": outcomes,
            "terrain_seed": self._worlds.seeds.copy(),
        }
        return info | {f"_{name}": always for name in info}
