"""PPO as the paper's experiments train it: the recipe `paper`, what makes it complete terrains, and one change at a time.

A variant is the recipe `paper` with some CHANGES:

    paper, appendix        none; the appendix's run makes RLlib's 30 passes in minibatches of 128
    works                  WORKS, the smallest set that completes terrains
    tuned                  TUNED, which needs fewer moves besides
    works-no-CHANGE        the same without one of them; tuned-no-CHANGE likewise
    paper+CHANGE           the recipe with one of them, or with several: paper+reward+mask
    paper-no-bonus         eq. 8 without +-n at the end of an episode, as on the levels t-m-2
    paper-no-value-clip    the values' change since the rollout is not clipped
"""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from marsexplorer.config import EnvConfig
from marsexplorer.paper.trainers.variants import Variants
from marsexplorer.training.config import APPENDIX_PASSES, RECIPES, TrainConfig
from marsexplorer.training.ppo import RolloutBuffer, TrainingRun, make_update

BEST = RECIPES["best"]
CHANGES: dict[str, dict[str, Any]] = {
    "reward": {"reward_per_cell": BEST.reward_per_cell, "has_bonus": False},
    "discount": {"gamma": BEST.gamma},
    "mask": {"mask": True},
    "features": {"network": BEST.network},
    "rate": {"learning_rate": 3e-4, "final_learning_rate": 3e-4},
}
OTHERS = {"name", "network", "mask", "gamma", *CHANGES["reward"]}
CHANGES["batch"] = {
    field.name: getattr(BEST, field.name) for field in fields(BEST) if field.name not in OTHERS
}
"""Name of a change -> the settings that it changes; all but "rate" are those of the recipe `best`.

reward    units of moves, nothing at the end
mask      invalid moves have no probability
discount  0.997 for 0.95
features  our network and its features for the state matrix
batch     the optimiser's: larger batches, fewer passes, a falling learning rate, an entropy target
rate      a higher learning rate alone, which makes up for the fewer gradient steps of the 6 passes
"""
WORKS = ("mask", "features")
TUNED = ("reward", "mask", "discount", "features", "batch")

CHANGED = Variants("PPO", CHANGES, WORKS, TUNED)
ALONE: dict[str, dict[str, Any]] = {
    "appendix": APPENDIX_PASSES,
    "paper-no-bonus": {"has_bonus": False},
    "paper-no-value-clip": {"vf_change_clip": float("inf")},
}
"""Variant -> the settings in which it differs from the recipe `paper`, for those that are no set of changes."""
VARIANTS = (*ALONE, *CHANGED.names)


def config_of(variant: str) -> TrainConfig:
    """Return the configuration of a variant; ValueError when there is none of that name."""
    settings = ALONE[variant] if variant in ALONE else CHANGED.settings_for(variant)
    return replace(RECIPES["paper"], **settings)


class PPOTrainer:
    """Train by PPO; see `marsexplorer.paper.trainer` for what each part is. A round is an update.

    config      of PPO, such as `config_of` returns
    env_config  of the environments
    moves       of the whole training
    """

    def __init__(self, config: TrainConfig, env_config: EnvConfig, seed: int, moves: int) -> None:
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

    def state_dict(self) -> dict[str, Any]:
        """Return all that changes: the buffer is filled anew by each update."""
        return self._run.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Set everything as `state_dict` returned it."""
        self._run.load_state_dict(state)
        self.moves = self._run.global_step

    def save_policy(self, path: Path, card: dict[str, Any]) -> None:
        """Write the policy with a card."""
        self._run.config.save_policy(self._run.net, path, card)
