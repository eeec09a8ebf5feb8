"""Environments as a network in training sees them: several sizes, stepped as one.

No training terrain has a seed in EVALUATION_SEEDS: a run that drew one would stop. The whole state
can be saved and loaded, so that a run that was interrupted goes on exactly where it stood.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from marsexplorer.config import EnvConfig
from marsexplorer.observation import EAST
from marsexplorer.policies.network.features import FeatureExtractor
from marsexplorer.rules import R_MOVE
from marsexplorer.vector import MarsExplorerVector

EVALUATION_SEEDS = range(10**9, 10**9 + 10**6)
"""Seeds that are kept for evaluation: training refuses them."""

Observation = tuple[Tensor, ...]
"""The arguments of a network's `forward` for a batch of environments, each [num_envs, ...]."""
Codes = NDArray[np.uint8]
Numbers = NDArray[np.int64]
Encoder = Callable[[Codes, Numbers, Codes, Numbers], Observation]
"""(codes, cells, visited, headings) of some environments -> the network's observation."""
EncoderFactory = Callable[[EnvConfig, int], Encoder]
"""(configuration, number of environments) -> an encoder for them."""


def feature_encoder(config: EnvConfig, num_envs: int) -> Encoder:
    """Return the encoder for `network.Net`: planes, and numbers for each move."""
    extractor = FeatureExtractor(num_envs, config.rows, config.cols, config.sensor_radius)

    def encode(*arrays: NDArray[Any]) -> Observation:
        planes, moves = extractor(*arrays)
        return torch.from_numpy(planes), torch.from_numpy(moves)

    return encode


STATE_ARRAYS = ("visited", "headings", "steps", "returns", "cells")
"""The arrays of TrainingEnvs that a checkpoint holds."""


@dataclass
class RecentEpisodes:
    """The last thousand episodes that ended in training.

    Of each: steps, whether explored, return, coverage, outcome.

    count  episodes that ended in all
    """

    steps: deque[int] = field(default_factory=lambda: deque(maxlen=1000))
    explored: deque[bool] = field(default_factory=lambda: deque(maxlen=1000))
    returns: deque[float] = field(default_factory=lambda: deque(maxlen=1000))
    coverages: deque[float] = field(default_factory=lambda: deque(maxlen=1000))
    outcomes: deque[str] = field(default_factory=lambda: deque(maxlen=1000))
    count: int = 0

    def add(
        self, ended: NDArray[np.bool_], steps: Numbers, returns: NDArray[np.float64], info: Any
    ) -> NDArray[np.bool_]:
        """Add the episodes that ended in a step; return which explored, bool[num_envs]."""
        outcomes = info["final_info"]["outcome"]  # older endings too
        explored: NDArray[np.bool_] = ended & (outcomes == "explored")
        self.steps += steps[ended].tolist()
        self.explored += explored[ended].tolist()
        self.returns += returns[ended].tolist()
        self.coverages += info["final_info"]["coverage"][ended].tolist()
        self.outcomes += outcomes[ended].tolist()
        self.count += int(ended.sum())
        return explored

    def state_dict(self) -> dict[str, Any]:
        """The episodes as lists, and their number."""
        recent = {name: list(column) for name, column in vars(self).items() if name != "count"}
        return {"recent_episodes": recent, "num_episodes": self.count}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Set everything as `state_dict` returned it."""
        for name, column in state["recent_episodes"].items():
            episodes = getattr(self, name)
            episodes.clear()
            episodes.extend(column)
        self.count = state["num_episodes"]


@dataclass(frozen=True)
class StepResult:
    """What one step of all environments brought.

    rewards    float64[num_envs], of eq. 8
    dones      bool[num_envs], whether the episode terminated or was truncated
    explored   bool[num_envs], whether it ended because the target was discovered
    truncated  int[...], indices of the environments that ran out of time
    final_obs  the last observations of those; None when there are none
    """

    rewards: NDArray[np.float64]
    dones: NDArray[np.bool_]
    explored: NDArray[np.bool_]
    truncated: NDArray[np.intp]
    final_obs: Observation | None

    @property
    def failed(self) -> NDArray[np.bool_]:
        """bool[num_envs], whether the episode ended because of an invalid move."""
        failed = self.dones & ~self.explored
        failed[self.truncated] = False
        return failed


class TrainingEnvs:
    """Environments of one configuration with what a network needs of each.

    That is: cells visited, headings, the observation.
    """

    def __init__(
        self,
        config: EnvConfig,
        num_envs: int,
        seed: int,
        make_encoder: EncoderFactory = feature_encoder,
    ) -> None:
        self.env, self.num_envs, self.config = make_vector_env(config, num_envs), num_envs, config
        self._make_encoder, self._encoder = make_encoder, make_encoder(config, num_envs)
        self.recent = RecentEpisodes()
        self.codes, info = self.env.reset(seed=seed)
        refuse_evaluation_seeds(info["terrain_seed"])
        self.visited: NDArray[np.uint8] = np.zeros((num_envs, config.n), np.uint8)
        self.headings: NDArray[np.int64] = np.full(num_envs, EAST, np.int64)
        self.steps: NDArray[np.int64] = np.zeros(num_envs, np.int64)
        self.returns: NDArray[np.float64] = np.zeros(num_envs)
        self._mark_visited(info["position"])

    def _mark_visited(self, positions: NDArray[np.int64]) -> None:
        """Move the rovers to int64[num_envs, 2] and mark those cells as visited."""
        self.cells = positions[:, 0] * self.config.cols + positions[:, 1]
        self.visited[np.arange(self.num_envs), self.cells] = 1

    def observe(self) -> Observation:
        """The observation of all environments; the tensors change with the next call."""
        return self._encoder(self.codes, self.cells, self.visited, self.headings)

    def step(self, actions: NDArray[np.int64]) -> StepResult:
        """Step every environment with actions int64[num_envs].

        The next episode begins at once where one ended.
        """
        self.codes, rewards, terminated, truncated, info = self.env.step(actions)
        self.headings, self.steps, self.returns = actions, self.steps + 1, self.returns + rewards
        dones, late = terminated | truncated, np.flatnonzero(truncated)
        explored, final_obs = np.zeros(self.num_envs, np.bool_), None
        if dones.any():
            explored = self.recent.add(dones, self.steps, self.returns, info)
            if len(late):
                final_obs = self._final_observations(late, info)
            refuse_evaluation_seeds(info["terrain_seed"])
            self.visited[dones], self.steps[dones], self.returns[dones] = 0, 0, 0
            self.headings = np.where(dones, EAST, actions)
        self._mark_visited(info["position"])
        return StepResult(rewards, dones, explored, late, final_obs)

    def _final_observations(self, indices: NDArray[np.intp], info: dict[str, Any]) -> Observation:
        """The last observations of environments whose episodes have just ended."""
        positions = info["final_info"]["position"][indices]
        cells = positions[:, 0] * self.config.cols + positions[:, 1]
        visited = self.visited[indices]
        visited[np.arange(len(indices)), cells] = 1
        codes = np.stack([info["final_obs"][i] for i in indices])
        encode = self._make_encoder(self.config, len(indices))
        return encode(codes, cells, visited, self.headings[indices])

    def state_dict(self) -> dict[str, Any]:
        """Return everything that changes, as tensors and lists."""
        arrays = {name: torch.from_numpy(getattr(self, name).copy()) for name in STATE_ARRAYS}
        worlds = {name: torch.from_numpy(array) for name, array in self.env.snapshot().items()}
        return {"arrays": arrays, "worlds": worlds, **self.recent.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Set everything as `state_dict` returned it."""
        for name in STATE_ARRAYS:
            setattr(self, name, state["arrays"][name].numpy().copy())
        worlds = {name: tensor.numpy() for name, tensor in state["worlds"].items()}
        self.codes = self.env.restore(worlds)
        self.recent.load_state_dict(state)


class MixedEnvs:
    """The environments of several configurations as one."""

    def __init__(self, parts: Sequence[TrainingEnvs]) -> None:
        self.parts = list(parts)
        self.num_envs = sum(part.num_envs for part in parts)
        self._splits = np.cumsum([part.num_envs for part in parts])[:-1]

    def observe(self) -> Observation:
        """Return the observation of all environments, part by part."""
        observations = (part.observe() for part in self.parts)
        return tuple(torch.cat(tensors) for tensors in zip(*observations, strict=True))

    def step(self, actions: NDArray[np.int64]) -> list[StepResult]:
        """Step every environment with actions int64[num_envs]; return each part's result."""
        split = zip(self.parts, np.split(actions, self._splits), strict=True)
        return [part.step(part_actions) for part, part_actions in split]


def make_vector_env(config: EnvConfig, num_envs: int) -> MarsExplorerVector:
    """`num_envs` environments of this configuration that observe uint8 codes."""
    settings = config.to_dict() | {"observation": "uint8", "autoreset_mode": "SameStep"}
    settings["size"] = (settings.pop("rows"), settings.pop("cols"))
    env = gymnasium.make_vec("MarsExplorer-v0", num_envs, "vector_entry_point", **settings)
    assert isinstance(env, MarsExplorerVector)
    assert env.config == config
    return env


def make_envs(
    configs: Sequence[EnvConfig], num_envs: int, seed: int, make_encoder: EncoderFactory
) -> MixedEnvs:
    """The environments of a run, of every configuration some.

    The first level has half of them; larger grids have fewer.

    ValueError when there are more configurations than environments.
    """
    others = {config.level for config in configs} - {configs[0].level}
    shares = {configs[0].level: max(1, len(others))}
    weights = [shares.get(config.level, 1) / config.n for config in configs]
    counts = [max(1, int(num_envs * weight / sum(weights))) for weight in weights]
    counts[0] += num_envs - sum(counts)
    if counts[0] < 1:
        many = f"{len(configs)} levels and sizes are too many for {num_envs} environments"
        raise ValueError(f"{many}; choose fewer")
    seeds = [10**12 * (seed + 1) + 10**7 * k for k in range(len(configs))]
    parts = zip(configs, counts, seeds, strict=True)
    return MixedEnvs([TrainingEnvs(*part, make_encoder) for part in parts])


def rewards_in_moves(
    config: EnvConfig, step: StepResult, reward_per_cell: float
) -> NDArray[np.float64]:
    """A step's rewards in units of moves, float64[num_envs].

    `reward_per_cell` for each new cell, -1 for the move.

    Undiscounted they rank explorations as eq. 8 does, by the number of moves, but they are of one
    magnitude at every size.
    """
    return reward_per_cell * (step.rewards + R_MOVE - config.r_bonus * step.explored) - 1.0


def refuse_evaluation_seeds(seeds: NDArray[np.int64]) -> None:
    """Raise ValueError when a training terrain is one of those kept for evaluation."""
    is_for_evaluation = (seeds >= EVALUATION_SEEDS.start) & (seeds < EVALUATION_SEEDS.stop)
    if is_for_evaluation.any():
        met = f"training met seed {int(seeds[is_for_evaluation][0])}, which is kept for evaluation"
        raise ValueError(f"{met}; train with another seed")
