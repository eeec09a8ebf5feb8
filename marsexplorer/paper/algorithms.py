"""The trainers by the name of the algorithm."""

from __future__ import annotations

from marsexplorer.config import EnvConfig
from marsexplorer.paper.ppo_trainer import PPOTrainer, config_of
from marsexplorer.paper.trainer import Trainer

ALGORITHMS = {"a2c": "A2C, in place of A3C", "ppo": "PPO", "rainbow": "DQN-Rainbow", "sac": "discrete SAC"}
"""Name, as `--algorithms` takes it -> what it is."""


def begin(algorithm: str, variant: str, config: EnvConfig, seed: int, moves: int) -> Trainer:
    """Return the trainer of an algorithm at its beginning.

    variant  "paper" is the letter of the paper, "works" what completes terrains; each algorithm's module lists its others
    moves    of the whole training, which schedules may depend on

    ValueError when there is no such algorithm or variant.
    """
    if algorithm == "ppo":
        return PPOTrainer(config_of(variant), config, seed, moves)
    raise ValueError(f"no algorithm {algorithm!r}; choose one of: {', '.join(ALGORITHMS)}")


def check_variant(algorithm: str, variant: str) -> None:
    """Raise ValueError when there is no such algorithm, or it has no such variant."""
    if algorithm not in ALGORITHMS:
        raise ValueError(f"no algorithm {algorithm!r}; choose of: {', '.join(ALGORITHMS)}")
    if algorithm == "ppo":
        config_of(variant)
