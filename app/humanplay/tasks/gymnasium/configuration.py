"""The configuration of a Gymnasium environment."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import gymnasium

from humanplay.task import Configuration
from humanplay.tasks.gymnasium.description import Description, canonical, completed, described


@dataclass(frozen=True)
class GymnasiumConfig:
    """What `gymnasium.make` is given.

    told       the id, or the description as JSON (`Description.told`)
    arguments  further keyword arguments, as canonical JSON
    limit      moves after which an episode times out
    """

    told: str
    arguments: str
    limit: int
    size: ClassVar[None] = None

    @property
    def description(self) -> Description:
        """The description, completed by the catalogue."""
        return completed(described(self.told))

    @property
    def level(self) -> str:
        """The environment's id."""
        return described(self.told).id

    def to_dict(self) -> dict[str, object]:
        """Return the values that `GymnasiumEnvironment.configuration` takes."""
        kwargs = json.loads(self.arguments)
        return {"level": self.level, "kwargs": kwargs, "max_steps": self.limit}

    @cached_property
    def hash(self) -> str:
        """SHA-256 (hex) of the canonical JSON, with what describes the environment."""
        return hashlib.sha256(canonical([self.told, self.to_dict()]).encode()).hexdigest()

    def make(self, seed: int | None = None) -> gymnasium.Env[Any, Any]:
        """A new environment.

        Raises:
            ValueError: If something it needs is not installed, or it refuses its arguments.
        """
        kwargs = json.loads(self.arguments)
        env: gymnasium.Env[object, object] = self.description.make(kwargs, self.limit, seed)
        return env


def own_config(config: Configuration) -> GymnasiumConfig:
    """A configuration as Gymnasium's own; TypeError for another task's."""
    if not isinstance(config, GymnasiumConfig):
        raise TypeError(f"expected what gymnasium.make is given, got a {type(config).__name__}")
    return config
