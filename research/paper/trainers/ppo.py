"""PPO by our own trainer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from marsexplorer.config import EnvConfig
from marsexplorer.training.ppo import RolloutBuffer, TrainingRun, make_update
from research.paper.trainers.settings import PPOSettings


class PPOTrainer:
    """Train by PPO; see `research.paper.algorithms.Trainer` for what each part is. A round is an update.

    config      of PPO, such as `ppo_settings` returns
    env_config  of the environments
    moves       of the whole training
    """

    def __init__(self, config: PPOSettings, env_config: EnvConfig, seed: int, moves: int) -> None:
        self._run = TrainingRun.begin(config, [env_config], moves, seed)
        self._buffer = RolloutBuffer.empty(self._run.config, self._run.envs.observe())
        self.settings = self._run.config.to_dict()
        (self.envs,) = self._run.envs.parts
        self.moves = 0

    def advance(self) -> dict[str, float]:
        """Make an update; return the policy's entropy, how far it moved, and how well the values explain the returns."""
        numbers = make_update(self._run, self._buffer)
        self.moves = self._run.global_step
        return {**numbers, "kl_coef": self._run.kl_coef}

    def save_policy(self, path: Path, card: dict[str, Any]) -> None:
        """Write the policy with a card."""
        self._run.config.save_policy(self._run.net, path, card)
