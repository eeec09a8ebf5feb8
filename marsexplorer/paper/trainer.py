"""What an algorithm has to fulfil to be trained by a trial."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from marsexplorer.training.envs import TrainingEnvs


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

    def state_dict(self) -> dict[str, Any]:
        """Return all that changes, as tensors, numbers, strings and containers of them: generators and buffers too."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Set everything as `state_dict` returned it; what follows is then what would have followed, bit for bit."""

    def save_policy(self, path: Path, card: dict[str, Any]) -> None:
        """Write the policy as it is now with a card; `marsexplorer.policies.load` reads it without the training library."""
