"""The shipped results, in `data/*.jsonl`, and the verdicts on claims.

environment.jsonl               the findings of `checks`
figure5-*.jsonl                 how hard the levels are, see `play`
generalisation.jsonl            policies on levels that they were not trained on, see
                                `generalisation`
figure6-*.jsonl, figure7-*.jsonl  episodes of policies and walks of the null, see `quadrants`,
                                  `walks` and `scale`
every other file                finished trials, see `curves`

The statistics that decide a claim are here too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from marsexplorer.intervals import Floats, t_interval, t_quantile
from research.difference import answers
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
    walks      results of the untrained walks of figure 6
    trainings  those in both worlds, see `research.difference`
    code_rules  results of the rules in the code's world
    unfinished  the progress of trainings, see `trial.read_unfinished`
    """

    checks: dict[str, Line] = field(default_factory=dict)
    records: list[Record] = field(default_factory=list)
    plays: dict[int, list[Line]] = field(default_factory=lambda: {5: [], 6: [], 7: [], 8: []})
    walks: list[Line] = field(default_factory=list)
    trainings: answers.Records = field(default_factory=dict)
    code_rules: list[Line] = field(default_factory=list)
    unfinished: list[Line] = field(default_factory=list)

    def trials(self, **wanted: Any) -> list[Record]:
        """The `longest` finished trials with these values (algorithm, variant, ...)."""
        return longest(chosen(self.records, **wanted))


def read(folder: Path = FOLDER) -> Results:
    """The results in a folder; ValueError for a file that holds no such results.

    With the trainings in both worlds as they are stored.
    """
    results = Results(
        unfinished=read_unfinished(folder / "checkpoints"),
        trainings=answers.read_stored(),
        code_rules=read_lines(answers.RULE_RESULTS),
    )
    for path in sorted(folder.glob("*.jsonl")):
        if path.name == CHECKS_FILE:
            results.checks.update({line["claim"]: line for line in read_lines(path)})
        elif path.name.startswith(("figure5-", "figure6-", "figure7-", "generalisation")):
            for line in read_lines(path):
                group = results.plays[line["figure"]] if "policy" in line else results.walks
                group.append(line)
        else:
            results.records.extend(read_exported(path))
    return results


REPRODUCED, PARTLY, NOT_REPRODUCED = "reproduced", "in part", "not reproduced"
CONTRARY, UNDECIDED = "undecided, here the contrary", "undecided"
SLIP = "a slip of the paper"
DIFFERENT, PEOPLE, NOT_YET = "done differently", "cannot be tested here: people", "not yet measured"
VERDICTS = (
    REPRODUCED,
    PARTLY,
    NOT_REPRODUCED,
    CONTRARY,
    UNDECIDED,
    SLIP,
    DIFFERENT,
    PEOPLE,
    NOT_YET,
)


@dataclass(frozen=True)
class Judgement:
    """What was measured, as Markdown for a table's cell, and one of VERDICTS.

    brief  what it comes to, for the summary; may be empty
    """

    measured: str
    verdict: str
    brief: str = ""


NOTHING = Judgement("", NOT_YET)
Decide = Callable[[Results], Judgement]


Holds = bool | None
"""Whether a statement holds, None where it is certain neither that it does nor that it does not."""


def verdict(holds: Holds) -> str:
    """The verdict on a statement that was measured."""
    if holds is None:
        return UNDECIDED
    return REPRODUCED if holds else NOT_REPRODUCED


def one_sided(holds: Holds, decides: bool) -> str:
    """The verdict on a statement that trainings measured.

    decides  whether they are such as to decide it, either way; those that are not can still show
             the contrary of it, which is said and decides nothing about the paper
    """
    if decides:
        return verdict(holds)
    return CONTRARY if holds is False else UNDECIDED


def all_of(parts: Iterable[Holds]) -> Holds:
    """Whether every part of a statement holds.

    One that does not decides it, one that is open leaves it open.
    """
    distinct = {*parts}
    if False in distinct:
        return False
    return None if None in distinct else True


def partly(held: Sequence[Holds]) -> str:
    """The verdict on a statement about several places, in part where it holds in some."""
    return PARTLY if any(held) and not all(held) else verdict(all_of(held))


def surpasses(numbers: tuple[float, float], others: tuple[float, float]) -> Holds:
    """Whether one number is above another, of which there are intervals (low, high).

    None if they overlap or are unknown.
    """
    if numbers[0] > others[1]:
        return True
    return False if numbers[1] < others[0] else None


def is_above(ours: Floats, theirs: Floats) -> bool:
    """Whether the 95 % interval of the difference of means lies above 0.

    By Welch's t; a point if nothing varies.
    """
    if np.ptp(ours) == np.ptp(theirs) == 0:
        return bool(ours[0] > theirs[0])
    return bool(stats.ttest_ind(ours, theirs, equal_var=False).confidence_interval(0.95).low > 0)


def certainly_above(ours: Floats, theirs: Floats) -> Holds:
    """Whether one mean is above another, None if neither `is_above` the other."""
    if is_above(ours, theirs):
        return True
    return False if is_above(theirs, ours) else None


def above_by_seed(ours: Floats, theirs: Floats, least: float = 0.0) -> Holds:
    """Whether the mean of ours less theirs is above `least`, paired by seed.

    By its 95 % t interval over seeds; None if that contains `least`.
    """
    low, high = t_interval(ours - theirs)
    if low > least:
        return True
    return False if high < least else None


def ratio_of_means(ours: Floats, theirs: Floats) -> Estimate:
    """The ratio of the means of independent values with Fieller's 95 % interval.

    The variances may differ: the degrees of freedom are Satterthwaite's at the ratio (Tamhane and
    Logan 2004). The interval is from -inf to inf if that of the mean of theirs contains 0, since
    then no ratio is excluded on both sides. At least two values of each.
    """
    top, bottom = float(ours.mean()), float(theirs.mean())
    ratio = top / bottom if bottom else np.nan
    of_top, of_bottom = (float(values.var(ddof=1)) / len(values) for values in (ours, theirs))
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
