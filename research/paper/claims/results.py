"""The results that are shipped, in `data/*.jsonl`, as the claims of the paper are decided from them.

environment.jsonl               what `checks` found
figure5-*.jsonl                 how hard the levels are, see `play`
generalisation.jsonl            policies on levels that they were not trained on, see `generalisation`
figure6-*.jsonl, figure7-*.jsonl  episodes of policies and walks of the null, see `quadrants`, `walks` and `scale`
every other file                finished trials, see `curves`

And what a claim can turn out to be, with the statistics that decide it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from marsexplorer.intervals import Floats, t_interval, t_quantile
from research.paper.figures.curves import Record, chosen, longest, read_exported
from research.paper.jobs import Line, read_lines
from research.paper.tables import Estimate
from research.paper.trial import read_unfinished

FOLDER = Path(__file__).resolve().parents[1] / "data"
CHECKS_FILE = "environment.jsonl"


@dataclass(frozen=True)
class Results:
    """Everything that is shipped.

    checks     claim -> the line of its check
    records    finished trials
    plays      figure (5, 6 or 7; 8: generalisation) -> results of policies
    walks      results of the walks of figure 6 that nobody trained
    unfinished  how far trainings are, see `trial.read_unfinished`
    """

    checks: dict[str, Line] = field(default_factory=dict)
    records: list[Record] = field(default_factory=list)
    plays: dict[int, list[Line]] = field(default_factory=lambda: {5: [], 6: [], 7: [], 8: []})
    walks: list[Line] = field(default_factory=list)
    unfinished: list[Line] = field(default_factory=list)

    def trials(self, **wanted: Any) -> list[Record]:
        """Return the `longest` finished trials with these values (algorithm, variant, level, size)."""
        return longest(chosen(self.records, **wanted))


def read(folder: Path = FOLDER) -> Results:
    """Return what lies in the folder, the shipped one by default; ValueError for a file that holds no such results."""
    results = Results(unfinished=read_unfinished(folder / "checkpoints"))
    for path in sorted(folder.glob("*.jsonl")):
        if path.name == CHECKS_FILE:
            results.checks.update({line["claim"]: line for line in read_lines(path)})
        elif path.name.startswith(("figure5-", "figure6-", "figure7-", "generalisation")):
            for line in read_lines(path):
                kept = results.plays[line["figure"]] if "policy" in line else results.walks
                kept.append(line)
        else:
            results.records.extend(read_exported(path))
    return results


REPRODUCED, PARTLY, NOT_REPRODUCED = "reproduced", "in part", "not reproduced"
UNDECIDED, SLIP = "undecided", "a slip of the paper"
DIFFERENT, PEOPLE, NOT_YET = "done differently", "cannot be tested here: people", "not yet measured"
VERDICTS = (REPRODUCED, PARTLY, NOT_REPRODUCED, UNDECIDED, SLIP, DIFFERENT, PEOPLE, NOT_YET)


@dataclass(frozen=True)
class Judgement:
    """What was measured, as Markdown for a cell of a table, and the verdict, one of VERDICTS."""

    measured: str
    verdict: str


NOTHING = Judgement("", NOT_YET)
Decide = Callable[[Results], Judgement]


Holds = bool | None
"""Whether a statement holds, None where it is certain neither that it does nor that it does not."""


def verdict(holds: Holds) -> str:
    """Return the verdict on a statement that was measured."""
    if holds is None:
        return UNDECIDED
    return REPRODUCED if holds else NOT_REPRODUCED


def all_of(parts: Iterable[Holds]) -> Holds:
    """Return whether every part of a statement holds: one that does not decides it, one that is open leaves it open."""
    found = {*parts}
    if False in found:
        return False
    return None if None in found else True


def partly(held: Sequence[bool]) -> str:
    """Return the verdict on a statement that was measured in several places."""
    return PARTLY if any(held) and not all(held) else verdict(all(held))


def is_above(ours: Floats, theirs: Floats) -> bool:
    """Return whether the 95 % interval of the difference of means (Welch's t; a point where nothing varies) lies above 0."""
    if np.ptp(ours) == np.ptp(theirs) == 0:
        return bool(ours[0] > theirs[0])
    return bool(stats.ttest_ind(ours, theirs, equal_var=False).confidence_interval(0.95).low > 0)


def certainly_above(ours: Floats, theirs: Floats) -> Holds:
    """Return whether the mean of independent values is above another, None where neither `is_above` the other."""
    if is_above(ours, theirs):
        return True
    return False if is_above(theirs, ours) else None


def above_by_seed(ours: Floats, theirs: Floats, least: float = 0.0) -> Holds:
    """Return whether the mean of ours less theirs is above `least`, by its 95 % t interval over seeds, which they share."""
    low, high = t_interval(ours - theirs)
    if low > least:
        return True
    return False if high < least else None


def ratio_of_means(ours: Floats, theirs: Floats) -> Estimate:
    """Return the ratio of the means of independent values with Fieller's 95 % interval, at least two of each.

    The variances may differ: the degrees of freedom are Satterthwaite's at the ratio (Tamhane and Logan 2004). The interval is
    from -inf to inf where that of the mean of theirs contains 0, since then no ratio is excluded on both sides.
    """
    top, bottom = float(ours.mean()), float(theirs.mean())
    ratio = top / bottom if bottom else np.nan
    of_top, of_bottom = (float(each.var(ddof=1)) / len(each) for each in (ours, theirs))
    of_both = of_top + ratio**2 * of_bottom
    if of_both == 0:
        return Estimate(ratio, ratio, ratio)
    parts = of_top**2 / (len(ours) - 1), (ratio**2 * of_bottom) ** 2 / (len(theirs) - 1)
    squared = t_quantile(of_both**2 / sum(parts)) ** 2
    divisor = bottom**2 - squared * of_bottom
    if not divisor > 0:
        return Estimate(ratio, -np.inf, np.inf)
    centre = top * bottom / divisor
    half = np.sqrt(centre**2 - (top**2 - squared * of_top) / divisor)
    return Estimate(ratio, float(centre - half), float(centre + half))
