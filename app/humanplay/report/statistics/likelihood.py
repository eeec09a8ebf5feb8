"""The lowest mean still likely: empirical likelihood, calibrated to Student's t.

A mean of values could as well have come from other weights on them than equal ones. Weights w are
as unlikely as the sum of -log(w / w0) is large, w0 being the weights that the mean has (Owen 1988,
Biometrika 75(2)). The lowest mean within a radius of that sum has weights in proportion to
w0 / (value - a number below the least value). No weight is below 0 and the radius does not depend
on the values, so no end moves up when a value goes down.

The radius for n values is the one whose lowest mean of n normal scores is Student's end: on values
that lie as normal ones do the interval is Student's, and with a long tail on one side it reaches
further on that side. It cannot leave the values' range, which with n values excludes the truth on
one side with a probability of up to 2^-n.
"""

from __future__ import annotations

from functools import cache
from statistics import NormalDist

import numpy as np

from marsexplorer.intervals import CONFIDENCE, Floats, t_exceeded

TAIL = (1 - CONFIDENCE) / 2
LEVELS: Floats = np.unique(np.append(np.geomspace(1e-6, 0.5, 34), TAIL))[::-1]
"""One-sided levels at which a p value is looked for, falling from 0.5."""


@cache
def radii(count: int, stretch: float = 1.0) -> Floats:
    """The radius for so many values at each of LEVELS.

    It is infinite if the lowest mean is the least value.

    Args:
        count: of the values, at least 2.
        stretch: by how much further than Student's end the lowest mean of normal scores lies.
    """
    normal = NormalDist()
    scores = np.array([normal.inv_cdf((rank + 0.625) / (count + 0.25)) for rank in range(count)])
    quantiles = np.array([t_exceeded(count - 1, float(level)) for level in LEVELS])
    reach = stretch * quantiles / np.sqrt(count)
    above = scores - scores[0]
    near, far = np.full_like(reach, -60.0), np.full_like(reach, 60.0)
    for _ in range(100):
        middle = (near + far) / 2
        inverse = 1 / (above + np.exp(middle)[:, None])
        is_beyond = -(inverse * scores).sum(-1) / inverse.sum(-1) > reach
        near, far = np.where(is_beyond, middle, near), np.where(is_beyond, far, middle)
    distances = above + np.exp(near)[:, None]
    radius = np.log(distances).sum(-1) + count * np.log((1 / distances).mean(-1))
    return np.asarray(np.where(reach < -scores[0], np.maximum(radius, 0.0), np.inf))


def lowest_mean(values: Floats, weights: Floats, radius: Floats) -> Floats:
    """The lowest mean of values within a radius of their weights.

    Args:
        values: float64[..., n].
        weights: float64[..., n], at least 0, their sum 1.
        radius: float64[...], above 0; infinite for the least value.
    """
    count = values.shape[-1]
    least = np.where(weights > 0, values, np.inf).min(-1)
    middle = (weights * values).sum(-1)
    spread = np.sqrt((weights * (values - middle[..., None]) ** 2).sum(-1))
    is_flat = spread <= 1e-12 * np.abs(values).max(-1)
    is_sought = np.isfinite(radius) & ~is_flat
    unit = np.where(is_flat, 1.0, spread)
    above = np.maximum(values - least[..., None], 0.0) / unit[..., None]
    wanted = np.where(is_sought, radius, 1.0)
    # Newton's method for the logarithm of the gap below the least value: both logarithms are
    # nearly linear in one another. It starts where the radius is that of small changes.
    gap = np.log(count / (2 * wanted)) / 2
    for _ in range(60):
        inverse, slope, unlikely = _tilt(above, weights, gap)
        away = np.log(np.maximum(count * unlikely, 1e-300)) - np.log(wanted)
        step = np.divide(away * unlikely, slope, out=np.zeros_like(gap), where=is_sought)
        step = np.clip(step, -3.0, 3.0)
        gap = gap - step
        if np.abs(step).max(initial=0.0) < 1e-10:
            break
    inverse, _, _ = _tilt(above, weights, gap)
    lowest = least + unit * (inverse * above).sum(-1) / inverse.sum(-1)
    return np.asarray(np.where(is_flat, middle, np.where(is_sought, lowest, least)))


def _tilt(above: Floats, weights: Floats, gap: Floats) -> tuple[Floats, Floats, Floats]:
    """Weights by inverse distance, how unlikely they are for each value, its slope."""
    distances = above + np.exp(gap)[..., None]
    inverse = weights / distances
    total = inverse.sum(-1)
    unlikely = (weights * np.log(distances)).sum(-1) + np.log(total)
    slope = np.exp(gap) * (total - (inverse / distances).sum(-1) / total)
    return inverse, slope, unlikely
