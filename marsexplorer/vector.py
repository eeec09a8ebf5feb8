"""`gymnasium.make_vec("MarsExplorer-v0", vectorization_mode="vector_entry_point")`: the stacked rules as they are."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from marsexplorer.config import ACTIONS, OUTCOMES, RUNNING, TIMED_OUT, EnvConfig
from marsexplorer.env import following, observation_space
from marsexplorer.observation import STATE_VALUES, action_masks
from marsexplorer.rules import CELLS, DISCOVERED, OUTCOME, SEED
from marsexplorer.score import score
from marsexplorer.terrain import next_seed
from marsexplorer.world import Worlds, positions, totals

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

    Takes what MarsExplorer takes. An environment that ends begins at once on the seed that follows its own (same-step
    autoreset): its last observation and info are `info["final_obs"][i]` and the columns of `info["final_info"]`, where
    `info["_final_obs"]` is True. `reset(seed=s)` starts environment i on seed s + i. With observation="uint8" the codes
    are the worlds' own array, valid until the next step: copy what must last.
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
    ) -> None:
        self.num_envs = num_envs
        self.config = EnvConfig.of(level, size, sensor_radius=sensor_radius, beta=beta, max_steps=max_steps)
        self.single_observation_space = observation_space(self.config, observation)
        self.single_action_space = spaces.Discrete(len(ACTIONS))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._raw = observation == "uint8"
        self._worlds = Worlds(self.config, num_envs)
        self._seeds: list[int] | None = None

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Start every environment and return the observations and infos."""
        if options:
            raise ValueError("a stack of environments takes no options; play given terrains one at a time")
        super().reset(seed=seed if isinstance(seed, int) else None)
        seeds = self._starting_seeds(seed)
        self._worlds.start(seeds)
        return self._observe(self._worlds.codes), self._info(self._worlds.scalars)

    def _starting_seeds(self, seed: int | list[int | None] | None) -> list[int]:
        if isinstance(seed, (list, tuple)):
            if len(seed) != self.num_envs:
                raise ValueError(f"seed must be one number or {self.num_envs} of them, got {len(seed)}")
            return [following(None) if one is None else one for one in seed]
        if seed is not None:
            return [seed + i for i in range(self.num_envs)]
        current = self._worlds.scalars[:, SEED]
        if self._seeds is None and not current.any():
            self._seeds = [following(None)]
            return [self._seeds[0] + i for i in range(self.num_envs)]
        return [next_seed(int(one)) for one in current]

    def step(self, actions: NDArray[Any]) -> VectorStep:
        """Make one move in every environment."""
        given = np.ascontiguousarray(actions, np.int64)
        if given.shape != (self.num_envs,) or given.min() < 0 or given.max() > 3:
            raise ValueError(f"actions must be {self.num_envs} numbers in 0..3, got {actions!r}")
        rewards = self._worlds.step_autoreset(given).copy()
        outcomes = self._worlds.outcomes
        terminated, truncated = (outcomes > RUNNING) & (outcomes < TIMED_OUT), outcomes == TIMED_OUT
        info = self._info(self._worlds.scalars)
        ended = outcomes > RUNNING
        if ended.any():
            info |= self._finals(ended)
        return self._observe(self._worlds.codes), rewards, terminated, truncated, info

    def action_masks(self) -> NDArray[np.bool_]:
        """Return bool[num_envs, 4]: which moves stay on the grid and off known obstacles."""
        return action_masks(self._worlds.codes, positions(self._worlds.scalars))

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return copies of everything that changes with a step."""
        return self._worlds.take(np.arange(self.num_envs))

    def restore(self, snapshot: dict[str, NDArray[Any]]) -> NDArray[Any]:
        """Return the observations of the environments as they were at a snapshot of one made alike."""
        self._worlds.put(np.arange(self.num_envs), snapshot)
        return self._observe(self._worlds.codes)

    def terrain(self, index: int) -> NDArray[np.bool_]:
        """Return the true map of one environment: bool[rows, cols], True where blocked."""
        return self._worlds.terrain(index)

    def _observe(self, codes: NDArray[np.uint8]) -> NDArray[Any]:
        return codes if self._raw else STATE_VALUES[codes]

    def _info(self, scalars: NDArray[np.uint64]) -> dict[str, Any]:
        discovered, cells = scalars[:, DISCOVERED].astype(np.int64), scalars[:, CELLS].astype(np.int64)
        everywhere = np.ones(self.num_envs, np.bool_)
        columns = {
            "position": positions(scalars),
            "discovered": discovered,
            "coverage": discovered / cells,
            "score": np.asarray(score(self.config, totals(self.config, scalars), cells)),  # type: ignore[arg-type]
            "outcome": NAMED[scalars[:, OUTCOME]],
            "terrain_seed": scalars[:, SEED].astype(np.int64),
        }
        return columns | {f"_{name}": everywhere for name in columns}

    def _finals(self, ended: NDArray[np.bool_]) -> dict[str, Any]:
        observations = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(ended):
            observations[i] = self._observe(self._worlds.last_codes[i].copy())
        info = self._info(self._worlds.last_scalars)
        masked = {name: (ended.copy() if name.startswith("_") else column) for name, column in info.items()}
        return {
            "final_obs": observations,
            "_final_obs": ended,
            "final_info": masked,
            "_final_info": ended.copy(),
        }
