"""The paper's four algorithms: what each has to fulfil to be trained by a trial, and the trainers by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from marsexplorer.config import EnvConfig
from marsexplorer.training.envs import TrainingEnvs
from research.paper.trainers.ppo import PPOTrainer
from research.paper.trainers.settings import VARIANTS, ppo_settings

ALGORITHMS = {
    "a2c": "A2C, in place of A3C",
    "ppo": "PPO",
    "rainbow": "DQN-Rainbow",
    "sac": "discrete SAC",
}
"""Name, as `--algorithms` takes it -> what it is."""


class Trainer(Protocol):
    """An algorithm under way on the environments of one configuration, on one thread.

    settings   every setting that the run has, JSON-ready: the first line of the log has it, and `settings` is checked by it
    envs       the environments; the log reads the episodes that ended there
    moves      moves made so far, over all environments
    """

    settings: dict[str, Any]
    envs: TrainingEnvs
    moves: int

    def advance(self) -> dict[str, float]:
        """Play and learn for one round, at most some seconds; return its numbers by name (entropy, losses, ...)."""

    def save_policy(self, path: Path, card: dict[str, Any]) -> None:
        """Write the policy as it is now, an ONNX file with a card; `marsexplorer.policies.load` plays it without the training
        library.
        """


def begin(algorithm: str, variant: str, config: EnvConfig, seed: int, moves: int) -> Trainer:
    """Return the trainer of an algorithm at its beginning.

    variant  "paper" is the letter of the paper, "works" what completes terrains; each algorithm's module lists its others
    moves    of the whole training, which schedules may depend on

    ValueError when there is no such algorithm or variant; ModuleNotFoundError, saying
    what to run, when tianshou is not installed.
    """
    if algorithm == "ppo":
        return PPOTrainer(ppo_settings(variant), config, seed, moves)
    check_variant(algorithm, variant)
    return _begin_through_tianshou(algorithm, variant, config, seed, moves)


def check_variant(algorithm: str, variant: str) -> None:
    """Raise ValueError when there is no such algorithm, or it has no such variant."""
    if algorithm not in ALGORITHMS:
        raise ValueError(f"no algorithm {algorithm!r}; choose of: {', '.join(ALGORITHMS)}")
    if algorithm == "ppo":
        ppo_settings(variant)
    else:
        VARIANTS[algorithm].settings_for(variant)


def _begin_through_tianshou(
    algorithm: str, variant: str, config: EnvConfig, seed: int, moves: int
) -> Trainer:
    try:
        from research.paper.trainers.off_policy import RainbowTrainer, SACTrainer
        from research.paper.trainers.tianshou_trainer import A2CTrainer
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "tianshou":
            raise
        raise ModuleNotFoundError(
            f"{ALGORITHMS[algorithm]} is trained through tianshou, which is not installed here; "
            "run `make paper`, and then .venv-research/bin/python -m research.paper",
            name="tianshou",
        ) from error
    if algorithm == "a2c":
        return A2CTrainer(variant, config, seed, moves)
    return (RainbowTrainer if algorithm == "rainbow" else SACTrainer)(variant, config, seed, moves)
