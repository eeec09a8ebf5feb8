"""What `docs/paper.md` shows of trainings besides the claims: tables of trained policies, and what each change is worth.

Policies are measured on terrains kept for evaluation. A change is judged by the completion that is lost without it, so its
importance is that of a part of the paper's setting for an algorithm: what holds it back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from marsexplorer.paper.algorithms import ALGORITHMS
from marsexplorer.paper.claims.shipped import Results
from marsexplorer.paper.claims.training_claims import SEEDS
from marsexplorer.paper.figures.curves import NAMES, TITLES, Record
from marsexplorer.paper.figures.trained_table import TABLE_COLUMNS, Mean, cells_of, rows_of
from marsexplorer.paper.plan import LEVEL, SIZE

AIM = 0.9
"""Share of the 21x21 terrains of level `random` that each algorithm should complete as it works, 0..1."""
NONE_YET = "No such trainings are shipped yet."
WITHOUT = ("works", "tuned")
"""The variants from which a change can be taken out."""
STARTS = (*(f"{variant}-no-" for variant in WITHOUT), "paper+", "paper-no-")
"""What the names of variants begin with that leave a change out, make it alone, and leave a part of the paper's out."""


def completion(results: Results, algorithm: str, variant: str) -> Mean | None:
    """Return the completion on held-out terrains over seeds, None without a training."""
    trials = of_figure_4(results, algorithm, variant)
    return Mean.of([record.result["completion"] for record in trials]) if trials else None


def percent(share: Mean) -> str:
    """Return a share in per cent with half of its interval."""
    half = "" if share.high is None else f" ± {100 * (share.high - share.mean):.0f}"
    return f"{100 * share.mean:.0f}{half} %"


def as_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown; NONE_YET without rows."""
    lines = ["| " + " | ".join(each) + " |" for each in (columns, *rows)]
    return "\n".join([lines[0], "|---" * len(columns) + "|", *lines[1:]]) if rows else NONE_YET


def trained(results: Results) -> str:
    """Return the table of the policies of figure 4: all four algorithms, by the letter, as they work, and tuned."""
    found = [
        each
        for name in ALGORITHMS
        for variant in TITLES
        for each in of_figure_4(results, name, variant)
    ]
    return as_table(TABLE_COLUMNS, [cells_of(row) for row in rows_of(found)])


def of_figure_4(results: Results, algorithm: str, variant: str) -> list[Record]:
    """Return the trainings of one algorithm and variant on the level of figure 4."""
    return results.trials(algorithm=algorithm, variant=variant, level=LEVEL, size=SIZE)


def levels(results: Results) -> str:
    """Return the table of the policies of figure 5: PPO on the 12 levels, with the better rule's moves for the difficulty."""
    names = sorted({record.trial.level for record in results.records} - {LEVEL})
    found = [
        each
        for variant in ("paper", "works")
        for level in names
        for each in results.trials(algorithm="ppo", variant=variant, level=level, size=SIZE)
    ]
    rule = {record.trial.level: f"{record.result['best_rule_steps']:.0f}" for record in found}
    rows = [[*cells_of(row), rule[row.level]] for row in rows_of(found)]
    return as_table((*TABLE_COLUMNS, "steps of the better rule"), rows)


def aims(results: Results) -> str:
    """Return which algorithms complete the share of terrains that is aimed at, as a table; SEEDS seeds decide it."""
    rows = []
    for name in ALGORITHMS:
        letter, works, tuned = (completion(results, name, variant) for variant in TITLES)
        if works is not None:
            seeds = len(of_figure_4(results, name, "works"))
            reached = "too few seeds" if seeds < SEEDS else "yes" if works.mean >= AIM else "no"
            shown = [percent(each) if each else "" for each in (letter, works, tuned)]
            rows.append([NAMES[name], *shown, str(seeds), reached])
    columns = (
        "algorithm",
        "completes by the letter",
        "completes as it works",
        "completes tuned",
        "seeds as it works",
    )
    return as_table((*columns, f"{AIM:.0%} reached"), rows)


def changes_of(results: Results, algorithm: str) -> list[str]:
    """Return the changes of which an algorithm has trainings without them, or with them alone."""
    variants = {
        record.trial.variant for record in results.records if record.trial.algorithm == algorithm
    }
    found = {
        each.removeprefix(start) for each in variants for start in STARTS if each.startswith(start)
    }
    return sorted(each for each in found if "+" not in each)


def ablations(results: Results) -> str:
    """Return what each change does to completion, as a table, the one whose lack costs most first."""
    rows: list[tuple[float, list[str]]] = []
    for name in ALGORITHMS:
        whole = [completion(results, name, variant) for variant in WITHOUT]
        for change in changes_of(results, name):
            others = [completion(results, name, start + change) for start in STARTS]
            lost = max(
                (
                    both.mean - one.mean
                    for both, one in zip(whole, others, strict=False)
                    if both and one
                ),
                default=0.0,
            )
            shown = [percent(each) if each else "" for each in others]
            rows.append((lost, [NAMES[name], f"`{change}`", *shown]))
    columns = (
        "algorithm",
        "change",
        "works without it",
        "tuned without it",
        "the letter with it alone",
        "the letter without it",
    )
    return as_table(
        columns, [row for _, row in sorted(rows, key=lambda each: (each[1][0], -each[0]))]
    )


BLOCKS: dict[str, Callable[[Results], str]] = {
    "trained policies": trained,
    "trained levels": levels,
    "aims": aims,
    "ablations": ablations,
}
"""Name of a drawn block of the document -> what draws it."""
