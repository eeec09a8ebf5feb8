"""Student's t intervals, the one place where the repository takes a t quantile for the mean of independent values; and
Wilson's interval of a share."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Floats = NDArray[np.float64]

CONFIDENCE = 0.95
"""Coverage of the intervals that the tables print."""

FEWEST = 5
"""Participants, and terrains that are drawn, below which a report gives no interval for others.

With n values on a side of the truth every interval that follows (a worse episode moves no end
towards better) misses it, which four values do in one study of eight.
"""


def t_quantile(degrees_of_freedom: float, confidence: float = CONFIDENCE) -> float:
    """Return the two-sided quantile of Student's t: |T| stays below it with probability `confidence` (0..1)."""
    return float(scipy.special.stdtrit(degrees_of_freedom, (1 + confidence) / 2))


def t_interval(values: Floats, confidence: float = CONFIDENCE) -> tuple[Floats, Floats]:
    """Return (low, high) of the t interval for the mean along the last axis.

    values      float64[..., n], n at least 2; each result is float64[...]
    confidence  coverage, 0..1
    """
    count = values.shape[-1]
    half_width = t_quantile(count - 1, confidence) * values.std(-1, ddof=1) / np.sqrt(count)
    mean = values.mean(-1)
    return mean - half_width, mean + half_width


def wilson_interval(count: int, total: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return (low, high) of Wilson's score interval for a share, 0..1 each, from `count` of `total` independent cases."""
    interval = scipy.stats.binomtest(count, total).proportion_ci(confidence, "wilson")
    return float(interval.low), float(interval.high)
