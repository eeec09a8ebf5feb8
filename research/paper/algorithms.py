"""The paper's four algorithms: the protocol of a trainer, and trainers by name."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np
import torch
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.rules import SEED
from marsexplorer.training.envs import TrainingEnvs
from marsexplorer.training.ppo import RolloutBuffer, TrainingRun, make_update
from marsexplorer.vector import MarsExplorerVector, VectorStep
from research.paper.trainers.settings import VARIANTS, PPOSettings, ppo_settings

ALGORITHMS = {
    "a2c": "A2C, in place of A3C",
    "ppo": "PPO",
    "rainbow": "DQN-Rainbow",
    "sac": "discrete SAC",
}
"""Name, as `--algorithms` takes it -> its name in words."""


class Trainer(Protocol):
    """An algorithm under way on the environments of one configuration, on one thread.

    settings   every setting of the run, JSON-ready, for the first line of the log
    envs       the environments; the log reads the episodes that ended there
    moves      moves made so far, over all environments
    """

    settings: dict[str, Any]
    envs: TrainingEnvs
    moves: int

    def advance(self) -> dict[str, float]:
        """Play and learn for one round, at most some seconds; return its metrics by name."""

    def save_policy(self, path: Path, card: dict[str, Any]) -> None:
        """Write the present policy as an ONNX file with a card.

        `marsexplorer.policies.load` plays it without the training library.
        """

    def state_dict(self) -> dict[str, Any]:
        """Everything that changes between two rounds, as tensors, numbers and lists."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what `state_dict` returned, with the process' random generators."""


class FewTerrains:
    """The environments of a training with only `count` terrains.

    Their seeds are those from `first` on. An environment goes from each to the next, so that its
    own state is all that it has to remember.
    """

    def __init__(self, env: MarsExplorerVector, first: int, count: int) -> None:
        self._env, self._first, self._count = env, first, count
        for index in range(env.num_envs):
            self._start(index, index)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._env, name)

    def _start(self, index: int, number: int) -> None:
        self._env._worlds.start_one(index, self._first + number % self._count)
        self._env._worlds.describe()

    def step(self, actions: NDArray[Any]) -> VectorStep:
        """Make one move in every environment."""
        seeds = self._env._worlds.scalars[:, SEED].astype(np.int64)
        transition = self._env.step(actions)
        for index in np.flatnonzero(transition[2] | transition[3]).tolist():
            self._start(index, int(seeds[index]) - self._first + 1)
        return transition


class PPOTrainer:
    """Train by PPO, our own trainer, on a CUDA device if there is one.

    A round is an update.

    config      of PPO, such as `ppo_settings` returns
    env_config  of the environments
    moves       of the whole training
    terrains    that it is trained on; 0: another one in every episode
    """

    def __init__(
        self,
        config: PPOSettings,
        env_config: EnvConfig,
        seed: int,
        moves: int,
        terrains: int = 0,
    ) -> None:
        device = "cuda" if torch.cuda.is_available() else "cpu"
        self._run = TrainingRun.begin(config, [env_config], moves, seed, device)
        self._buffer = RolloutBuffer.empty(self._run.config, self._run.envs.observe())
        self.settings = self._run.config.to_dict()
        (self.envs,) = self._run.envs.parts
        if terrains:
            few = FewTerrains(self.envs.env, 10**12 * (seed + 1), terrains)
            self.envs.env = cast(MarsExplorerVector, few)
        self.moves = 0

    def advance(self) -> dict[str, float]:
        """Make an update; return its metrics.

        They are the policy's entropy, how far it moved, and how well the values explain the
        returns.
        """
        numbers = make_update(self._run, self._buffer)
        self.moves = self._run.global_step
        return {**numbers, "kl_coef": self._run.kl_coef}

    def save_policy(self, path: Path, card: dict[str, Any]) -> None:
        self._run.config.save_policy(self._run.player, path, card)

    def state_dict(self) -> dict[str, Any]:
        return self._run.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._run.load_state_dict(state)
        self.moves = self._run.global_step


def begin(algorithm: str, variant: str, config: EnvConfig, seed: int, moves: int) -> Trainer:
    """The trainer of an algorithm at its beginning.

    Args:
        algorithm: A name in ALGORITHMS.
        variant: "paper" follows the paper to the letter, "works" completes terrains;
            `trainers.settings` lists the others; PPO's works@100 is trained on only a hundred
            terrains.
        config: Of the environments.
        seed: Of everything drawn.
        moves: Of the whole training, which schedules may depend on.

    Raises:
        ValueError: If there is no such algorithm or variant.
        ModuleNotFoundError: If tianshou is not installed; it names the command to run.
    """
    check_variant(algorithm, variant)
    if algorithm == "ppo":
        name, _, terrains = variant.partition("@")
        return PPOTrainer(ppo_settings(name), config, seed, moves, int(terrains or 0))
    try:
        from research.paper.trainers.off_policy import RainbowTrainer, SACTrainer
        from research.paper.trainers.tianshou_trainer import A2CTrainer
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "tianshou":
            raise
        raise ModuleNotFoundError(missing_tianshou([algorithm]), name="tianshou") from error
    if algorithm == "a2c":
        return A2CTrainer(variant, config, seed, moves)
    return (RainbowTrainer if algorithm == "rainbow" else SACTrainer)(variant, config, seed, moves)


def missing_tianshou(algorithms: Iterable[str]) -> str:
    """The sentence that names the command to run if tianshou is not installed."""
    names = ", ".join(ALGORITHMS[name] for name in algorithms)
    return (
        f"what trains {names} is not installed here: run `make paper`, and then "
        ".venv-research/bin/python -m research.paper; or give --algorithms ppo"
    )


def check_variant(algorithm: str, variant: str) -> None:
    """Raise ValueError if there is no such algorithm, or it has no such variant."""
    if algorithm not in ALGORITHMS:
        raise ValueError(f"no algorithm {algorithm!r}; choose of: {', '.join(ALGORITHMS)}")
    name, at, terrains = variant.partition("@")
    if at and (algorithm != "ppo" or not terrains.isdecimal()):
        raise ValueError(f"{variant!r}: only PPO has variants NAME@TERRAINS, such as works@100")
    VARIANTS[algorithm].settings_for(name)
