"""The null of figure 6 as jobs: the courses of walks that nobody trained, which `sweeps` draws."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from marsexplorer.config import CORE_VERSION
from marsexplorer.paper.episodes.play import SAVE_EVERY_S, Line, read_lines, write_lines
from marsexplorer.paper.episodes.quadrants import quadrant_course
from marsexplorer.paper.episodes.sweeps import (
    BLOCKS,
    RADIUS,
    SEEN_SHARE,
    hamiltonian_paths,
    nearest_walk,
    random_hamiltonian_path,
)
from marsexplorer.paper.job import OnProgress

NULLS = {
    "cells": "random Hamiltonian path through every cell",
    "blocks": f"all Hamiltonian paths through {BLOCKS} x {BLOCKS} blocks",
    "nearest": "nearest cell not yet visited, random ties",
    "lidar": f"nearest cell not yet seen with radius {RADIUS}, random ties",
}
"""The walks by name, in words."""

WALKS = 1000
"""Of each kind, but for `blocks`, where there are 52 paths in all."""

SECONDS_PER_WALK = {"cells": 0.06, "blocks": 0.0001, "nearest": 0.04, "lidar": 0.006}
"""CPU seconds at 21 x 21."""


@dataclass(frozen=True)
class NullWalks:
    """The courses of walks of one kind, as a job.

    kind  a name in NULLS
    size  side of the square grid, cells
    """

    kind: str
    size: int = 21
    walks: int = WALKS

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"figure6-null-{self.kind}-{self.size}"

    @property
    def forecast(self) -> float:
        """CPU seconds, about."""
        return 1.0 + self.walks * SECONDS_PER_WALK[self.kind] * (self.size / 21) ** 2

    @property
    def identity(self) -> Line:
        """What is walked, JSON-ready."""
        is_complete = self.kind == "blocks"
        return {
            "kind": "null",
            "figure": 6,
            "null": self.kind,
            "core_version": CORE_VERSION,
            "rows": self.size,
            "cols": self.size,
            "walks": None if is_complete else self.walks,
            "is_complete": is_complete,
        }

    def is_done(self, folder: Path) -> bool:
        """Return whether the result of these walks lies under `folder / name`."""
        lines = read_lines(folder / self.name / "result.jsonl")
        return len(lines) == 1 and self.identity.items() <= lines[0].items()

    def run(self, folder: Path, on_progress: OnProgress) -> None:
        """Walk what has not been walked yet; `moves` of the result is the mean length of a walk, in moves between cells."""
        own, identity = folder / self.name, self.identity
        own.mkdir(parents=True, exist_ok=True)
        if self.kind == "blocks":
            courses = [
                quadrant_course(path, BLOCKS, BLOCKS).code
                for path in hamiltonian_paths(BLOCKS, BLOCKS)
            ]
            write_lines(own / "result.jsonl", [{**identity, "moves": None, "courses": courses}])
            return
        head, *walked = read_lines(own / "walks.jsonl") or [identity]
        if head != identity:
            walked = []
        saved = time.monotonic()
        for seed in range(len(walked), self.walks):
            path = self._walk(seed)
            walked.append(
                {"moves": len(path) - 1, "course": quadrant_course(path, self.size, self.size).code}
            )
            if time.monotonic() - saved > SAVE_EVERY_S:
                write_lines(own / "walks.jsonl", [identity, *walked])
                saved = time.monotonic()
            on_progress(len(walked) / self.walks)
        write_lines(own / "walks.jsonl", [identity, *walked])
        moves = round(sum(walk["moves"] for walk in walked) / len(walked), 2)
        write_lines(
            own / "result.jsonl",
            [{**identity, "moves": moves, "courses": [walk["course"] for walk in walked]}],
        )

    def _walk(self, seed: int) -> list[int]:
        """Return the cells of the walk of a seed."""
        if self.kind == "cells":
            path: list[int] = random_hamiltonian_path(self.size, self.size, seed).tolist()
            return path
        reach, share = (RADIUS, SEEN_SHARE) if self.kind == "lidar" else (0, 1.0)
        return nearest_walk(self.size, self.size, reach, share, seed)
