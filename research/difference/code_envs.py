"""The code's world as a training run steps it."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from marsexplorer.compat.env import KoutrasCodeVector
from marsexplorer.training.envs import (
    Observation,
    RecentEpisodes,
    StepResult,
    refuse_evaluation_seeds,
)

NONE: NDArray[np.intp] = np.zeros(0, np.intp)


class CodeEnvs:
    """`training.envs.TrainingEnvs` of the authors' code, where nothing is truncated."""

    def __init__(self, env: KoutrasCodeVector, seed: int) -> None:
        self.env, self.num_envs = env, env.num_envs
        self.recent = RecentEpisodes()
        self.codes, info = env.reset(seed=10**12 * (seed + 1))
        refuse_evaluation_seeds(info["terrain_seed"])
        self.steps: NDArray[np.int64] = np.zeros(self.num_envs, np.int64)
        self.returns: NDArray[np.float64] = np.zeros(self.num_envs)

    def observe(self) -> Observation:
        """Return the codes of all environments."""
        return (torch.from_numpy(self.codes),)

    def step(self, actions: NDArray[np.int64]) -> StepResult:
        """Step every environment; the next episode begins at once where one ended."""
        self.codes, rewards, dones, _, info = self.env.step(actions)
        self.steps, self.returns = self.steps + 1, self.returns + rewards
        explored = np.zeros(self.num_envs, np.bool_)
        if dones.any():
            explored = self.recent.add(dones, self.steps, self.returns, info)
            refuse_evaluation_seeds(info["terrain_seed"])
            self.steps[dones], self.returns[dones] = 0, 0
        return StepResult(rewards, dones, explored, NONE, None)

    def state_dict(self) -> dict[str, Any]:
        """Return everything that changes, as tensors and lists."""
        worlds = {name: torch.from_numpy(array) for name, array in self.env.snapshot().items()}
        return {
            "steps": torch.from_numpy(self.steps.copy()),
            "returns": torch.from_numpy(self.returns.copy()),
            "worlds": worlds,
            **self.recent.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Set everything as `state_dict` returned it."""
        self.steps, self.returns = state["steps"].numpy().copy(), state["returns"].numpy().copy()
        worlds = {name: tensor.numpy() for name, tensor in state["worlds"].items()}
        self.codes = self.env.restore(worlds)
        self.recent.load_state_dict(state)
