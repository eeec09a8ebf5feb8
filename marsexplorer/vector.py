"""`gymnasium.make_vec("MarsExplorer-v0")`: the stacked rules as they are."""

from __future__ import annotations

import secrets
from enum import Enum
from functools import cached_property
from typing import Any, Self

import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from marsexplorer.buffers import shared_array, write_values
from marsexplorer.config import (
    ACTIONS,
    MAX_SEED,
    OUTCOMES,
    RUNNING,
    TIMED_OUT,
    EnvConfig,
    check_seed,
)
from marsexplorer.env import (
    LimitedSpec,
    MarsExplorer,
    check_render_mode,
    copied,
    drawn,
    following,
    observation_space,
    packed,
    unpacked,
)
from marsexplorer.observation import STATE_VALUES, action_masks
from marsexplorer.rules import DISCOVERED, SEED
from marsexplorer.terrain import next_seed
from marsexplorer.world import Worlds, live_positions, not_actions, positions

try:
    from gymnasium.vector import AutoresetMode
except ImportError:  # Gymnasium 1.0 has no such words

    class AutoresetMode(Enum):  # type: ignore[no-redef]
        """When an environment that ended begins anew."""

        NEXT_STEP = "NextStep"
        SAME_STEP = "SameStep"
        DISABLED = "Disabled"


SAME_STEP = AutoresetMode.SAME_STEP

NAMED = np.array([None, *OUTCOMES[1:]], object)
"""Outcomes by code, None while running."""

VIEWS = ("_info", "_final_info", "_final_obs", "_which", "_final_views", "_out")
"""Attributes that are views of the worlds' arrays, or the caller's memory: a copy makes its own."""

VectorStep = tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]


class MarsExplorerVector(LimitedSpec, VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """`num_envs` MarsExplorer environments stepped at once, each as if it were alone.

    They equal single ones bit for bit.

    Takes what MarsExplorer takes, and

    autoreset_mode  when an environment that ended begins anew (`gymnasium.vector.AutoresetMode` or
                    its value): in the next step, which makes no move in it ("NextStep"); at once
                    ("SameStep"), both on the seed that follows its own; or when
                    `reset(options={"reset_mask": bool[num_envs]})` names it ("Disabled")
    out  memory for the observations: a NumPy array, a torch tensor, or anything with DLPack, of the
         dtype and shape [num_envs, rows, cols] of the observations, in the processor's memory

    With "SameStep", the fastest, the last observation and info of an episode are
    `info["final_obs"][i]` and the columns of `info["final_info"]`, where `info["_final_obs"]` is
    True. `reset(seed=s)` starts environment i on seed s + i.

    With observation="uint8", the observations, the last ones, and the columns of `info` and
    `info["final_info"]` are the worlds' own arrays, valid until the next step: copy what must last.
    With "float32" each step returns new arrays, but for the observations where `out` is given.
    Rewards, terminated and truncated are always new.
    """

    metadata = MarsExplorer.metadata | {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        level: str = "random",
        size: int | tuple[int, int] = 21,
        sensor_radius: int = 6,
        beta: float = 0.99,
        max_steps: int | None = None,
        observation: str = "float32",
        discoverable_only: bool | None = None,
        out: Any = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
    ) -> None:
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self.render_mode = check_render_mode(render_mode)
        if max_episode_steps is not None:  # of a spec that make_vec is given
            max_steps = (
                max_episode_steps if max_steps is None else min(max_steps, max_episode_steps)
            )
        limits = (sensor_radius, beta, max_steps, discoverable_only)
        self.config = EnvConfig.of(level, size, *limits)
        self.single_observation_space = observation_space(self.config, observation)
        self.single_action_space = spaces.Discrete(len(ACTIONS))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._raw = observation == "uint8"
        shape = (num_envs, self.config.rows, self.config.cols)
        dtype = self.single_observation_space.dtype
        self._out = None if out is None else shared_array(out, shape, dtype)
        self._worlds = Worlds(self.config, num_envs, self._out if self._raw else None)
        self._was_reset = False
        self._ended: NDArray[np.bool_] = np.zeros(num_envs, np.bool_)
        self._view()

    def _view(self) -> None:
        """Make the infos: views of the worlds' arrays."""
        worlds, always = self._worlds, np.ones(self.num_envs, np.bool_)
        self._info = self._columns(worlds.shares, worlds.scalars, always)
        self._final_info = self._columns(worlds.last_shares, worlds.last_scalars, worlds.ended)
        self._final_obs: NDArray[np.object_] = np.full(self.num_envs, None, object)
        self._which: NDArray[np.int64] = np.zeros(0, np.int64)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Start every environment and return the observations and infos."""
        chosen = self._chosen(options or {})
        last = self._worlds.scalars[:, SEED].tolist() if self._was_reset else None
        seeds = starting_seeds(seed, self.num_envs, last)
        super().reset(seed=seeds[0])
        if chosen is None:
            self._worlds.start(seeds)
            self._ended[:] = False
        else:
            for index in np.flatnonzero(chosen):
                self._worlds.start_one(int(index), seeds[index])
            self._ended[chosen] = False
        self._was_reset = True
        self._info["outcome"][:] = NAMED[self._worlds.outcomes]
        self._worlds.describe()
        info = self._lasting(self._info)
        return self._observe(), info if chosen is None else _masked(info, chosen)

    def _chosen(self, options: dict[str, Any]) -> NDArray[np.bool_] | None:
        """Which environments a reset starts, None for all."""
        if set(options) - {"reset_mask"}:
            instead = "play given terrains one at a time"
            raise ValueError(f"a stack of environments takes no options but reset_mask; {instead}")
        mask = options.get("reset_mask")
        if mask is None:
            return None
        is_mask = isinstance(mask, np.ndarray) and mask.dtype == np.bool_
        if not (is_mask and mask.shape == (self.num_envs,) and mask.any()):
            wanted = f"bool[{self.num_envs}] with at least one True"
            raise ValueError(f"reset_mask must be {wanted}, got {mask!r}")
        if not self._was_reset:
            raise RuntimeError("no episode is running: call reset() without a reset_mask first")
        chosen: NDArray[np.bool_] = mask
        return chosen

    def step(self, actions: NDArray[Any]) -> VectorStep:
        """Make one move in every environment."""
        moves = np.ascontiguousarray(actions)
        if moves.shape != (self.num_envs,) or moves.dtype.kind not in "iu":
            raise not_actions(self.num_envs, actions)
        moves = moves.astype(np.int64, copy=False)
        if not moves.flags.writeable:  # the kernels are compiled for arrays that are
            moves = moves.copy()
        if self.autoreset_mode is not AutoresetMode.SAME_STEP:
            return self._step_alone(moves)
        return self._step_and_start(moves)

    def _step_and_start(self, actions: NDArray[np.int64]) -> VectorStep:
        """Make one move everywhere; where an episode ended, begin the next."""
        if self._which.size:
            self._final_obs[self._which] = None
        num = self.num_envs
        rewards, (terminated, truncated) = np.empty(num), np.empty((2, num), np.bool_)
        observations = self._observations()
        values = None if self._raw else observations.reshape(-1)
        self._which = self._worlds.step_described(actions, rewards, terminated, truncated, values)
        info = self._lasting(self._info)
        if self._which.size:
            info.update(self._finals(self._which))
        return observations, rewards, terminated, truncated, info

    def _step_alone(self, actions: NDArray[np.int64]) -> VectorStep:
        """Make one move in every environment that runs; begin those that have ended.

        An environment that ended in the step before begins, as its autoreset mode says.
        """
        worlds, ended = self._worlds, self._ended
        if self.autoreset_mode is AutoresetMode.DISABLED and ended.any():
            which = np.flatnonzero(ended).tolist()
            raise RuntimeError(
                f"the environments {which} have ended: call "
                f"reset(options={{'reset_mask': ended}}) first"
            )
        if actions.min() < 0 or actions.max() >= len(ACTIONS):
            raise not_actions(self.num_envs, actions)
        rewards = worlds.step(actions).copy()
        for index in np.flatnonzero(ended):
            worlds.start_one(int(index), next_seed(int(worlds.scalars[index, SEED])))
        worlds.describe()
        self._ended = worlds.outcomes != RUNNING
        self._info["outcome"][:] = NAMED[worlds.outcomes]
        truncated = worlds.outcomes == TIMED_OUT
        terminated = self._ended & ~truncated
        return self._observe(), rewards, terminated, truncated, self._lasting(self._info)

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture or a text of each environment, or None without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(drawn(codes, self.render_mode) for codes in self._worlds.codes)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each environment, as single ones have it."""
        if name == "terrain":
            return tuple(self.terrain(index) for index in range(self.num_envs))
        single = f"single_{name}"
        return (getattr(self, single if hasattr(self, single) else name),) * self.num_envs

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of each environment, or return an attribute, as single ones do."""
        if name in ("action_masks", "render"):
            return tuple(getattr(self, name)(*args, **kwargs))
        members = self.get_attr(name)
        return tuple(member(*args, **kwargs) if callable(member) else member for member in members)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of every environment; the values must be equal.

        A stack has one for all.
        """
        several = list(values) if isinstance(values, (list, tuple)) else [values]
        if len(several) not in (1, self.num_envs) or any(one != several[0] for one in several):
            raise ValueError(f"{name} must be one value for the whole stack, got {values!r}")
        setattr(self, name, several[0])

    def __getstate__(self) -> dict[str, Any]:
        return packed(self.__dict__, VIEWS)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(unpacked(state))
        self._out = None
        self._view()
        if self.autoreset_mode is not AutoresetMode.SAME_STEP:
            self._info["outcome"][:] = NAMED[self._worlds.outcomes]

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        twin = self.__class__.__new__(self.__class__)
        memo[id(self)] = twin
        twin.__setstate__(copied(self.__getstate__(), memo))
        return twin

    def action_masks(self) -> NDArray[np.bool_]:
        """Return bool[num_envs, 4]: which moves stay on the grid and off known obstacles."""
        return action_masks(self._worlds.codes, positions(self._worlds.scalars))

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return copies of everything that changes with a step."""
        return self._worlds.take(np.arange(self.num_envs))

    def restore(self, snapshot: dict[str, NDArray[Any]]) -> NDArray[Any]:
        """Restore a snapshot of environments like these; return their observations."""
        self._worlds.put(np.arange(self.num_envs), snapshot)
        self._was_reset = True
        return self._observe()

    def terrain(self, index: int) -> NDArray[np.bool_]:
        """Return the true map of one environment: bool[rows, cols], True where blocked."""
        return self._worlds.terrain(index)

    def _observe(self) -> NDArray[Any]:
        """Return the observations of the worlds as they stand."""
        observations = self._observations()
        if not self._raw:
            write_values(self._worlds.codes.reshape(-1), STATE_VALUES, observations.reshape(-1))
        return observations

    def _observations(self) -> NDArray[Any]:
        """Return where the observations stand, or are to be written to."""
        if self._raw:
            return self._worlds.codes
        return np.empty(self._worlds.codes.shape, np.float32) if self._out is None else self._out

    def _columns(
        self, shares: NDArray[np.float64], scalars: NDArray[np.uint64], mask: NDArray[np.bool_]
    ) -> dict[str, Any]:
        """Return the columns of an info as views of the worlds' arrays."""
        whole = scalars.view(np.int64)
        info = {
            "position": live_positions(scalars),
            "discovered": whole[:, DISCOVERED],
            "coverage": shares[0::2],
            "score": shares[1::2],
            "outcome": np.full(self.num_envs, None, object),
            "terrain_seed": whole[:, SEED],
        }
        return info | {f"_{name}": mask for name in info}

    def _lasting(self, info: dict[str, Any]) -> dict[str, Any]:
        """An info to give away: views, or copies where observations are copies too."""
        return info.copy() if self._raw else {name: column.copy() for name, column in info.items()}

    @cached_property
    def _final_views(self) -> NDArray[np.object_]:
        """object[num_envs]: the last codes of each environment."""
        views = np.full(self.num_envs, None, object)
        for i, codes in enumerate(self._worlds.last_codes):
            views[i] = codes
        return views

    def _finals(self, which: NDArray[np.int64]) -> dict[str, Any]:
        """What `info` says of the episodes that ended in this step, those of `which`."""
        self._final_info["outcome"][which] = NAMED[self._worlds.outcomes[which]]
        if self._raw:
            self._final_obs[which] = self._final_views[which]
            observations, ended = self._final_obs, self._worlds.ended
        else:
            observations, ended = np.full(self.num_envs, None, object), self._worlds.ended.copy()
            for i in which:
                observations[i] = STATE_VALUES[self._worlds.last_codes[i]]
        finals = {"final_obs": observations, "final_info": self._lasting(self._final_info)}
        return finals | {"_final_obs": ended, "_final_info": ended}


def starting_seeds(
    seed: int | list[int | None] | None, num_envs: int, last: list[int] | None
) -> list[int]:
    """The seed of each environment of a reset.

    seed  the first of consecutive ones, or one for each environment, None for any
    last  those of the episodes before, which the next ones follow without `seed`; None before the
          first reset
    """
    if isinstance(seed, (list, tuple)):
        if len(seed) != num_envs:
            raise ValueError(f"seed must be one number or {num_envs} of them, got {len(seed)}")
        return [following(None) if one is None else check_seed(one) for one in seed]
    if seed is None and last is not None:
        return [next_seed(one) for one in last]
    first = secrets.randbelow(MAX_SEED + 2 - num_envs) if seed is None else check_seed(seed)
    return [check_seed(first + i) for i in range(num_envs)]


def _masked(info: dict[str, Any], chosen: NDArray[np.bool_]) -> dict[str, Any]:
    """An info of some environments: zeros, or None, for the others."""
    columns = {}
    for name, column in info.items():
        mask = chosen.reshape(-1, *(1,) * (column.ndim - 1))
        columns[name] = np.where(
            mask, column, None if column.dtype == object else column.dtype.type(0)
        )
    return columns
