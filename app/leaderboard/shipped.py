"""The figures of the shipped policies that come with the package, so that a new server's leaderboard is full at once.

`marsexplorer leaderboard --out data/leaderboard` makes them: a file for each configuration on offer, a line in it for each
policy. A figure is shown only where everything that it depends on is the same here: the core version, the configuration, the
terrains, and the policy's own file. Whether the code of the rules still plays alike is tested by playing again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from app.leaderboard.jobs import EvaluationJob
from app.settings import SHIPPED_DATA
from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.policies.files.card import shipped

FOLDER = SHIPPED_DATA / "leaderboard"
FORMAT = 1


@dataclass(frozen=True)
class Origin:
    """Where a file of figures comes from: the version of the package and the command that made it."""

    version: str
    command: str


@dataclass(frozen=True)
class ShippedFigure:
    """A policy's figure and its origin.

    steps   to 99 % on each terrain, in the order of the seeds
    figure  as `app.statistics.summaries.summarize_episodes` returns it
    """

    policy: str
    file_sha256: str | None
    steps: tuple[int, ...]
    figure: dict[str, Any]
    origin: Origin


class ShippedFigures:
    """Reads the files of a folder, each when one of its figures is asked for the first time."""

    def __init__(self, folder: Path = FOLDER) -> None:
        self._folder = folder
        self._read: dict[str, list[ShippedFigure]] = {}

    def find(self, job: EvaluationJob) -> ShippedFigure | None:
        """Return the shipped figure of a job, None where there is none that holds here."""
        key = f"{job.config.hash}|{_digest(job.seeds)}"
        if key not in self._read:
            self._read[key] = _read_file(self._folder / file_name(job.config), key)
        own = file_sha256(job.policy)
        return next(
            (
                each
                for each in self._read[key]
                if (each.policy, each.file_sha256) == (job.policy, own)
            ),
            None,
        )


def file_name(config: EnvConfig) -> str:
    """Return the name of a configuration's file."""
    return f"{config.level}-{config.rows}x{config.cols}.json"


@cache
def file_sha256(policy: str) -> str | None:
    """Return SHA-256 (hex) of the file of a shipped policy; None for a policy that is code."""
    path = shipped().get(policy)
    return None if path is None else hashlib.sha256(path.read_bytes()).hexdigest()


def to_document(
    config: EnvConfig, seeds: Iterable[int], figures: Iterable[ShippedFigure], origin: Origin
) -> str:
    """Return the text of a configuration's file: JSON, a line for each policy."""
    head = {
        "format": FORMAT, "core_version": CORE_VERSION, **asdict(origin), "config": config.to_dict(),
        "depends_on": f"{config.hash}|{_digest(seeds)}",
    }  # fmt: skip
    rows = [
        {name: value for name, value in asdict(figure).items() if name != "origin"}
        for figure in figures
    ]
    lines = ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows)
    return json.dumps(head)[:-1] + f', "policies": [\n{lines}\n]}}\n'


def _read_file(path: Path, key: str) -> list[ShippedFigure]:
    """Return the figures of a file; none where there is no such file or where it is of other terrains or another core."""
    try:
        found = json.loads(path.read_bytes())
    except OSError:
        return []
    if (found["format"], found["core_version"], found["depends_on"]) != (FORMAT, CORE_VERSION, key):
        return []
    origin = Origin(found["version"], found["command"])
    return [
        ShippedFigure(row["policy"], row["file_sha256"], tuple(row["steps"]), row["figure"], origin)
        for row in found["policies"]
    ]  # fmt: skip


def _digest(seeds: Iterable[int]) -> str:
    return hashlib.sha256(",".join(map(str, seeds)).encode()).hexdigest()
