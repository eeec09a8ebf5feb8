"""A policy on the terrains of some seeds: what an evaluation plays, and everything that its figure depends on."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from marsexplorer import policies
from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.policies.files.card import shipped


@dataclass(frozen=True)
class EvaluationJob:
    """A policy (its name or path) on the terrains of some seeds."""

    policy: str
    config: EnvConfig
    seeds: tuple[int, ...]

    @property
    def key(self) -> str:
        """Everything that the figure depends on, as one string."""
        seeds = hashlib.sha256(",".join(map(str, self.seeds)).encode()).hexdigest()
        return "|".join(
            (CORE_VERSION, self.policy, policy_hash(self.policy), self.config.hash, seeds)
        )

    def to_json(self) -> str:
        """Return the line the worker reads."""
        return json.dumps(
            {"policy": self.policy, "config": self.config.to_dict(), "seeds": self.seeds}
        )


@lru_cache(64)
def policy_hash(source: str) -> str:
    """Return SHA-256 (hex) of a policy: of its file where it has one, and of the code of all policies."""
    found = hashlib.sha256()
    files = sorted(Path(policies.__file__).parent.rglob("*.py"))
    own = shipped().get(source, Path(source))
    for path in (*files, own):
        if path.is_file():
            found.update(path.read_bytes())
    return found.hexdigest()
