"""`gymnasium.make_vec("MarsExplorer-v0", vectorization_mode="vector_entry_point")`: the stacked rules as they are."""

from __future__ import annotations

import secrets
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from marsexplorer.buffers import shared_array, write_values
from marsexplorer.config import ACTIONS, MAX_SEED, OUTCOMES, EnvConfig, check_seed
from marsexplorer.env import following, observation_space
from marsexplorer.observation import STATE_VALUES, action_masks
from marsexplorer.rules import DISCOVERED, SEED
from marsexplorer.terrain import next_seed
from marsexplorer.world import Worlds, live_positions, not_actions, positions

try:
    from gymnasium.vector import AutoresetMode

    SAME_STEP: Any = AutoresetMode.SAME_STEP
except ImportError:  # Gymnasium 1.0 has no such word
    SAME_STEP = "SameStep"

NAMED = np.array([None, *OUTCOMES[1:]], object)
"""Outcomes by code, None while running."""

VectorStep = tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]


class MarsExplorerVector(VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """`num_envs` MarsExplorer environments stepped at once, equal to single ones bit for bit.

    Takes what MarsExplorer takes besides render_mode, and

    out  memory for the observations: a NumPy array, a torch tensor, or anything with DLPack, of the
         dtype and shape [num_envs, rows, cols] of the observations, in the processor's memory

    An environment that ends begins at once on the seed that follows its own (same-step autoreset): its last observation and
    info are `info["final_obs"][i]` and the columns of `info["final_info"]`, where `info["_final_obs"]` is True. `reset(seed=s)`
    starts environment i on seed s + i.

    With observation="uint8", the observations, the last ones, and the columns of `info` and `info["final_info"]` are the
    worlds' own arrays, valid until the next step: copy what must last. With "float32" each step returns new arrays, but for
    the observations where `out` is given. Rewards, terminated and truncated are always new.
    """

    metadata = {"autoreset_mode": SAME_STEP, "render_modes": []}  # noqa: RUF012  # gymnasium's own convention

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
    ) -> None:
        self.num_envs = num_envs
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
        worlds, always = self._worlds, np.ones(num_envs, np.bool_)
        self._info = self._columns(worlds.shares, worlds.scalars, always)
        self._final_info = self._columns(worlds.last_shares, worlds.last_scalars, worlds.ended)
        self._final_obs: NDArray[np.object_] = np.full(num_envs, None, object)
        self._which: NDArray[np.int64] = np.zeros(0, np.int64)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Start every environment and return the observations and infos."""
        if options:
            instead = "play given terrains one at a time"
            raise ValueError(f"a stack of environments takes no options; {instead}")
        seeds = self._starting_seeds(seed)
        super().reset(seed=seeds[0])
        self._was_reset = True
        self._worlds.start(seeds)
        self._worlds.describe()
        return self._observe(), self._lasting(self._info)

    def _starting_seeds(self, seed: int | list[int | None] | None) -> list[int]:
        if isinstance(seed, (list, tuple)):
            if len(seed) != self.num_envs:
                wanted = f"one number or {self.num_envs} of them"
                raise ValueError(f"seed must be {wanted}, got {len(seed)}")
            return [following(None) if one is None else check_seed(one) for one in seed]
        if seed is None and self._was_reset:
            return [next_seed(one) for one in self._worlds.scalars[:, SEED]]
        first = secrets.randbelow(MAX_SEED + 2 - self.num_envs) if seed is None else seed
        return [check_seed(check_seed(first) + i) for i in range(self.num_envs)]

    def step(self, actions: NDArray[Any]) -> VectorStep:
        """Make one move in every environment."""
        given = np.ascontiguousarray(actions)
        if given.shape != (self.num_envs,) or given.dtype.kind not in "iu":
            raise not_actions(self.num_envs, actions)
        given = given.astype(np.int64, copy=False)
        if not given.flags.writeable:  # the kernels are compiled for arrays that are
            given = given.copy()
        if self._which.size:
            self._final_obs[self._which] = None
        num = self.num_envs
        rewards, (terminated, truncated) = np.empty(num), np.empty((2, num), np.bool_)
        observations = self._observations()
        values = None if self._raw else observations.reshape(-1)
        self._which = self._worlds.step_described(given, rewards, terminated, truncated, values)
        info = self._lasting(self._info)
        if self._which.size:
            info.update(self._finals(self._which))
        return observations, rewards, terminated, truncated, info

    def action_masks(self) -> NDArray[np.bool_]:
        """Return bool[num_envs, 4]: which moves stay on the grid and off known obstacles."""
        return action_masks(self._worlds.codes, positions(self._worlds.scalars))

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return copies of everything that changes with a step."""
        return self._worlds.take(np.arange(self.num_envs))

    def restore(self, snapshot: dict[str, NDArray[Any]]) -> NDArray[Any]:
        """Return the observations of the environments as they were at a snapshot of one made alike."""
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
        """Return an info to give away: of views, or of copies where observations are copies too."""
        return info.copy() if self._raw else {name: column.copy() for name, column in info.items()}

    @cached_property
    def _final_views(self) -> NDArray[np.object_]:
        """object[num_envs]: the last codes of each environment."""
        views = np.full(self.num_envs, None, object)
        for i, codes in enumerate(self._worlds.last_codes):
            views[i] = codes
        return views

    def _finals(self, which: NDArray[np.int64]) -> dict[str, Any]:
        """Return what `info` says of the episodes that ended in this step, those of the environments `which`."""
        self._final_info["outcome"][which] = NAMED[self._worlds.outcomes[which]]
        if self._raw:
            self._final_obs[which] = self._final_views[which]
            observations, ended = self._final_obs, self._worlds.ended
        else:
            observations, ended = np.full(self.num_envs, None, object), self._worlds.ended.copy()
            for i in which:
                observations[i] = STATE_VALUES[self._worlds.last_codes[i]]
        found = {"final_obs": observations, "final_info": self._lasting(self._final_info)}
        return found | {"_final_obs": ended, "_final_info": ended}
