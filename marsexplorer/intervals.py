"""Student's t and its intervals of a mean; Wilson's interval of a share.

They are written out here so that playing and evaluating do not need SciPy.
"""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist

import numpy as np
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
    """The two-sided quantile of Student's t: |T| stays below it with this probability.

    confidence  the probability, 0..1
    """
    return t_exceeded(degrees_of_freedom, (1 - confidence) / 2)


@lru_cache(10_000)
def t_exceeded(degrees_of_freedom: float, tail: float) -> float:
    """The number that Student's t exceeds with probability `tail`, in (0, 0.5]."""
    if math.isnan(degrees_of_freedom):
        return math.nan
    # The tail is convex and longer than the normal one, so Newton's method begins there, comes
    # nearer from below and never passes the value.
    quantile = -NormalDist().inv_cdf(tail)
    while True:
        above = t_tail(quantile, degrees_of_freedom) - tail
        step = above / _t_density(quantile, degrees_of_freedom)
        if not step > 1e-15 * quantile:
            return quantile
        quantile += step


def t_tail(threshold: float, degrees_of_freedom: float) -> float:
    """The probability that Student's t exceeds a threshold."""
    if threshold < 0:
        return 1 - t_tail(-threshold, degrees_of_freedom)
    half, square = degrees_of_freedom / 2, threshold * threshold
    density = _t_density(threshold, degrees_of_freedom)
    far = degrees_of_freedom / (degrees_of_freedom + square)
    near = square / (degrees_of_freedom + square)
    # the incomplete beta function, from whichever end its continued fraction is short
    if far < (half + 1) / (half + 2.5):
        return density * threshold / degrees_of_freedom * _beta_fraction(half, 0.5, far)
    return 0.5 - density * threshold * _beta_fraction(0.5, half, near)


def _t_density(t: float, degrees_of_freedom: float) -> float:
    half = degrees_of_freedom / 2
    shape = math.exp(-(half + 0.5) * math.log1p(t * t / degrees_of_freedom))
    return _gamma_ratio(half) / math.sqrt(degrees_of_freedom * math.pi) * shape


def _gamma_ratio(half: float) -> float:
    """gamma(half + 1/2) / gamma(half)."""
    if half < 20:
        return math.gamma(half + 0.5) / math.gamma(half)
    # Stirling's series: the difference of two large logarithms would leave too few digits
    inverse, square = 1 / half, 1 / half**2
    series = 1 / 8 - square * (1 / 192 - square * (1 / 640 - square * 17 / 14336))
    return math.sqrt(half) * math.exp(-inverse * series)


def _beta_fraction(a: float, b: float, share: float) -> float:
    """The continued fraction of the incomplete beta function, by Lentz's method."""
    tiny = 1e-300
    top, bottom = 1.0, 1 / (1 - (a + b) * share / (a + 1) or tiny)
    fraction, number = bottom, 0
    while True:
        number += 1
        change = 1.0
        twice = a + 2 * number
        for term in (
            number * (b - number) * share / ((twice - 1) * twice),
            -(a + number) * (a + b + number) * share / (twice * (twice + 1)),
        ):
            bottom = 1 / (1 + term * bottom or tiny)
            top = 1 + term / top or tiny
            change = top * bottom
            fraction *= change
        if abs(change - 1) < 1e-15:
            return fraction


def t_interval(values: Floats, confidence: float = CONFIDENCE) -> tuple[Floats, Floats]:
    """The t interval (low, high) of the mean along the last axis.

    values      float64[..., n], n at least 2; each result is float64[...]
    confidence  coverage, 0..1
    """
    count = values.shape[-1]
    half_width = t_quantile(count - 1, confidence) * values.std(-1, ddof=1) / np.sqrt(count)
    mean = values.mean(-1)
    return mean - half_width, mean + half_width


def wilson_interval(count: int, total: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Wilson's score interval (low, high) of the share `count` / `total`, 0..1 each.

    The cases must be independent.
    """
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    middle = (count + z * z / 2) / (total + z * z)
    half_width = z * math.sqrt(count * (total - count) / total + z * z / 4) / (total + z * z)
    low = middle - half_width if count else 0.0
    return low, middle + half_width if count < total else 1.0
