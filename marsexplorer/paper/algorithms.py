"""The trainers by the name of the algorithm."""

from __future__ import annotations

from marsexplorer.config import EnvConfig
from marsexplorer.paper.trainer import Trainer
from marsexplorer.paper.trainers.ppo_trainer import PPOTrainer, config_of
from marsexplorer.paper.trainers.tianshou_settings import VARIANTS

ALGORITHMS = {
    "a2c": "A2C, in place of A3C",
    "ppo": "PPO",
    "rainbow": "DQN-Rainbow",
    "sac": "discrete SAC",
}
"""Name, as `--algorithms` takes it -> what it is."""


def begin(algorithm: str, variant: str, config: EnvConfig, seed: int, moves: int) -> Trainer:
    """Return the trainer of an algorithm at its beginning.

    variant  "paper" is the letter of the paper, "works" what completes terrains; each algorithm's module lists its others
    moves    of the whole training, which schedules may depend on

    ValueError when there is no such algorithm or variant; ModuleNotFoundError, saying
    what to run, when tianshou is not installed.
    """
    if algorithm == "ppo":
        return PPOTrainer(config_of(variant), config, seed, moves)
    check_variant(algorithm, variant)
    return _begin_through_tianshou(algorithm, variant, config, seed, moves)


def check_variant(algorithm: str, variant: str) -> None:
    """Raise ValueError when there is no such algorithm, or it has no such variant."""
    if algorithm not in ALGORITHMS:
        raise ValueError(f"no algorithm {algorithm!r}; choose of: {', '.join(ALGORITHMS)}")
    if algorithm == "ppo":
        config_of(variant)
    else:
        VARIANTS[algorithm].settings_for(variant)


def _begin_through_tianshou(
    algorithm: str, variant: str, config: EnvConfig, seed: int, moves: int
) -> Trainer:
    try:
        from marsexplorer.paper.trainers.a2c import A2CTrainer
        from marsexplorer.paper.trainers.rainbow import RainbowTrainer
        from marsexplorer.paper.trainers.sac import SACTrainer
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "tianshou":
            raise
        raise ModuleNotFoundError(
            f"{ALGORITHMS[algorithm]} is trained through tianshou, which is not installed here; "
            "run `make paper`, and then .venv-paper/bin/marsexplorer paper",
            name="tianshou",
        ) from error
    if algorithm == "a2c":
        return A2CTrainer(variant, config, seed, moves)
    return (RainbowTrainer if algorithm == "rainbow" else SACTrainer)(variant, config, seed, moves)
