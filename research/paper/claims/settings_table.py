"""The settings of the four algorithms in one table: the paper's appendix, the authors' repository, and what ran here.

`settings.tsv` has a row for each setting: `key` is where a trial's `settings` have it; `paper` is what the appendix prints and
`repository` what the authors' script or RLlib's default has, both empty where they say nothing; `ours`, `works` and `tuned` are
its values in the variants, as JSON; `reason` says why ours differs, or where a value comes from that the paper leaves open.

The table is never the source of a run. The trainers have configurations of their own and write them into the first line of a
trial's log; `differences` compares such a line with the table, so that the table cannot say anything else than what ran.

The repository's values are those of `trainners/runners/{PPO,A2C,DQN}.py` and `trainners/runners_legacy/SAC.py`. What these
scripts leave alone is RLlib 1's default (`rllib/agents/{ppo,a3c,dqn,sac}`), marked so.
"""

from __future__ import annotations

import csv
import json
from functools import cache
from pathlib import Path
from typing import Any

from research.paper.algorithms import ALGORITHMS
from research.paper.tables import markdown_table

COLUMNS = {"paper": "ours", "works": "works", "tuned": "tuned"}
"""Variant -> the column that has its values."""


@cache
def rows_of(algorithm: str) -> tuple[dict[str, str], ...]:
    """Return the rows of an algorithm, in the order of the page."""
    with (Path(__file__).parent / "settings.tsv").open(newline="") as file:
        rows = csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE)
        return tuple(row for row in rows if row["algorithm"] == algorithm)


def differences(algorithm: str, variant: str, settings: dict[str, Any]) -> list[str]:
    """Return a sentence for each row that a trial's `settings` do not confirm; none for variants that the table has not.

    settings  as the first line of a trial's log has them
    """
    if variant not in COLUMNS:
        return []
    found, settings = [], json.loads(json.dumps(settings))  # as the log has them: tuples are lists
    for row in rows_of(algorithm):
        key, wanted = row["key"], json.loads(row[COLUMNS[variant]])
        if key not in settings:
            came = f"the run logged no {key!r}"
        elif settings[key] != wanted:
            came = f"was {settings[key]!r} in the run"
        else:
            continue
        found.append(
            f"{algorithm} {variant}: {row['parameter']} is {wanted!r} in the table, and {came}"
        )
    return found


def words(value: Any) -> str:
    """Return a value as a cell of a table."""
    if isinstance(value, bool):
        return "used" if value else "not used"
    if isinstance(value, int):
        return f"{value:,}"
    return "none" if value is None or value == [] else str(value)


def as_table(name: str) -> str:
    """Return the rows of an algorithm as a table in Markdown; "shared" has those that are the same for all."""
    every = {algorithm: rows_of(algorithm) for algorithm in ALGORITHMS}
    of_all = [_cells(row) for row in every["ppo"]]
    shared = [each for each in of_all if all(each in map(_cells, rows) for rows in every.values())]
    found = shared if name == "shared" else [_cells(row) for row in every[name]]
    rows = [each for each in found if name == "shared" or each not in shared]
    return markdown_table(("setting", "paper", "repository", "ours", "why"), rows)


def _cells(row: dict[str, str]) -> tuple[str, ...]:
    paper, works, tuned = (words(json.loads(row[name])) for name in COLUMNS.values())
    ours = paper
    if works != paper:
        ours += f"; works: {works}"
    if tuned != works:
        ours += f"; tuned: {tuned}"
    return (row["parameter"], row["paper"], row["repository"], ours, row["reason"])
