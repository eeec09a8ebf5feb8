"""What a claim of the paper can turn out to be, and the statistics that decide it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from marsexplorer.evaluation.intervals import t_interval
from marsexplorer.paper.claims.shipped import Results

REPRODUCED, PARTLY, NOT_REPRODUCED = "reproduced", "in part", "not reproduced"
DIFFERENT, PEOPLE, NOT_YET = "done differently", "cannot be tested here: people", "not yet measured"
VERDICTS = (REPRODUCED, PARTLY, NOT_REPRODUCED, DIFFERENT, PEOPLE, NOT_YET)
Values = NDArray[np.float64]


@dataclass(frozen=True)
class Judgement:
    """What was measured, as Markdown for a cell of a table, and the verdict, one of VERDICTS."""

    measured: str
    verdict: str


NOTHING = Judgement("", NOT_YET)
Decide = Callable[[Results], Judgement]


def verdict(holds: bool) -> str:
    """Return the verdict on a statement that was measured."""
    return REPRODUCED if holds else NOT_REPRODUCED


def partly(held: Sequence[bool]) -> str:
    """Return the verdict on a statement that was measured in several places."""
    return PARTLY if any(held) and not all(held) else verdict(all(held))


def mean_of(values: Values) -> str:
    """Return "mean ± half of the 95 % t interval" of values float64[seeds], two seeds or more."""
    low, high = t_interval(values)
    return f"{values.mean():.3f} ± {(high - low) / 2:.3f}"


def is_above(ours: Values, theirs: Values) -> bool:
    """Return whether the 95 % interval of the difference of means (Welch's t) lies above 0."""
    return bool(stats.ttest_ind(ours, theirs, equal_var=False).confidence_interval(0.95).low > 0)
