"""The settings of the four algorithms in one table: paper, repository, and ours.

`settings.tsv` has a row for each setting: `key` is its name in a trial's `settings`, empty where
there is nothing to set and `fixed` has what the trainer always does (earlier logs have a value for
these); `paper` is what the appendix prints and `repository` what the authors' script or RLlib's
default has, both empty where they are silent; `reason` tells why ours differs, or where a value
comes from that the paper leaves open. What ran is what the shipped trials logged, but for what is
fixed.

The repository's values are those of `trainners/runners/{PPO,A2C,DQN}.py` and
`trainners/runners_legacy/SAC.py`. What these scripts leave alone is RLlib 1's default
(`rllib/agents/{ppo,a3c,dqn,sac}`), marked so.
"""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path
from typing import Any

from research.paper.algorithms import ALGORITHMS
from research.paper.claims.results import Results
from research.paper.figures.curves import NAMES, TITLES
from research.paper.plan import LEVEL
from research.paper.tables import markdown_table

COLUMNS = ("algorithm", "setting", "paper", "repository", "ours", "why")


@cache
def rows_of(algorithm: str) -> tuple[dict[str, str], ...]:
    """The rows of an algorithm, in the order of the page."""
    with (Path(__file__).parent / "settings.tsv").open(newline="") as file:
        rows = csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE, restval="")
        return tuple(row for row in rows if row["algorithm"] == algorithm)


def words(setting: Any) -> str:
    """A setting as a cell of a table."""
    if isinstance(setting, bool):
        return "used" if setting else "not used"
    if isinstance(setting, int):
        return f"{setting:,}"
    return "none" if setting is None or setting == [] else str(setting)


def as_table(results: Results) -> str:
    """The rows on which the paper speaks, or ours have a reason, as Markdown.

    Those come first that are the same for all. The others are RLlib's defaults by the letter.
    """
    logged = {
        (name, variant): trials[0].settings
        for name in NAMES
        for variant in TITLES
        if (trials := results.trials(algorithm=name, variant=variant, level=LEVEL))
    }
    if len(logged) < len(NAMES) * len(TITLES):
        return "Trainings are missing, so there is no table."
    every = {
        name: [
            _cells(row, [logged[name, variant] for variant in TITLES])
            for row in rows_of(name)
            if row["paper"] or row["reason"]
        ]
        for name in ALGORITHMS
    }
    shared = [row for row in every["ppo"] if all(row in rows for rows in every.values())]
    rows = [("all", *row) for row in shared]
    rows += [(NAMES[name], *row) for name in NAMES for row in every[name] if row not in shared]
    return markdown_table(COLUMNS, rows)


def _cells(row: dict[str, str], logged: list[dict[str, Any]]) -> tuple[str, ...]:
    """The cells of a row.

    logged  the settings by the letter, as it works and tuned
    """
    paper, works, tuned = (row["fixed"] or words(settings[row["key"]]) for settings in logged)
    ours = paper
    if works != paper:
        ours += f"; works: {works}"
    if tuned != works:
        ours += f"; tuned: {tuned}"
    return (row["parameter"], row["paper"], row["repository"], ours, row["reason"])
