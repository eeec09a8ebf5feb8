"""The command `marsexplorer puzzles`: make the puzzles that come with the package."""

from __future__ import annotations

import json
from collections.abc import Iterable
from concurrent.futures import Future
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click import echo, option

from humanplay.command.console import progress, written
from humanplay.command.options import path_option

if TYPE_CHECKING:
    from marsexplorer.evaluation.puzzles import Puzzle


@click.command(short_help="Make the puzzles that come with the package.")
@option("--count", type=click.IntRange(1), default=60, show_default=True, help="Puzzles.")
@path_option("--out", "JSON file to write.", required=True)
def puzzles(count: int, out: Path) -> None:
    """Make puzzles: positions in which one first move is clearly the best.

    A rule drives over terrains of seeds that nothing else draws, at most one puzzle a terrain, on all cores. Half a
    minute a terrain on one core. docs/evaluation.md says when a position is taken.

    \b
    Examples:
      marsexplorer puzzles --count 3 --out three.json
      marsexplorer puzzles --out data/puzzles/mars.json
    """
    from humanplay.jobs import Jobs, cores
    from marsexplorer.evaluation.puzzles import SEEDS, puzzle_on

    chosen: list[Puzzle] = []
    waiting: list[Future[Puzzle | None]] = []
    seeds = iter(SEEDS)
    with progress("Puzzles") as advance, Jobs() as jobs:
        while len(chosen) < count:
            while len(waiting) < 2 * cores():
                waiting.append(jobs.submit(puzzle_on, next(seeds)))
            puzzle = waiting.pop(
                0
            ).result()  # in the order of the seeds, however many cores there are
            if puzzle is not None:
                chosen.append(puzzle)
                advance(len(chosen), count)
    with written(f"to {out}", "--out"):
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(document(chosen, f"marsexplorer puzzles --count {count} --out {out}"))
    echo(f"wrote {count} puzzles to {out}")


def document(chosen: Iterable[Puzzle], command: str) -> str:
    """The text of a file of puzzles, a line for each."""
    lines = ",\n".join(
        json.dumps(_row(number, puzzle), separators=(",", ":"))
        for number, puzzle in enumerate(chosen, 1)
    )
    head = json.dumps({"command": command})
    return f'{head[:-1]}, "puzzles": [\n{lines}\n]}}\n'


def _row(number: int, puzzle: Puzzle) -> dict[str, object]:
    """A puzzle as the playground reads it: its frame, its trail, its answer."""
    from humanplay.tasks.mars.run import encode_grid
    from marsexplorer.config import UNKNOWN

    rows, cols = puzzle.codes.shape
    discovered = int((puzzle.codes != UNKNOWN).sum())
    frame = {
        "kind": "frame",
        "episode": f"puzzle-{number}",
        "step": len(puzzle.trail) - 1,
        "rows": rows,
        "cols": cols,
        "grid": encode_grid(puzzle.codes),
        "position": puzzle.trail[-1],
        "discovered": discovered,
        "cells": rows * cols,
        "coverage": discovered / (rows * cols),
        "heading": puzzle.heading,
        "reward": None,
        "return": None,
        "score": None,
        "outcome": None,
    }
    answer = {
        "best": puzzle.answer,
        "means": {action: round(moves, 2) for action, moves in puzzle.means.items()},
        "saves": round(puzzle.saves, 2),
        "error": round(puzzle.error, 2),
        "terrains": puzzle.terrains,
        "here": puzzle.here,
        "shows": puzzle.shows,
    }
    return {"id": str(number), "frame": frame, "trail": puzzle.trail, "answer": answer}
