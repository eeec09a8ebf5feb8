"""Looks at an open study that keep its error rates: alpha spending, boundaries, and the level of the interval at each look.

Lan and DeMets 1983, Biometrika 70(3): each look spends a part of alpha that depends only on the share of the players who have
finished, so looks may come at other numbers than planned. The boundaries are those of Brownian motion, by the recursive
integration of Armitage, McPherson and Rowe 1969, J. R. Statist. Soc. A 132(2). An interval that is made at each look with the
level of its boundary covers the truth at all looks together with 95 % (repeated confidence intervals: Jennison and Turnbull
1989, J. R. Statist. Soc. B 51(3)), so it holds however the study is stopped.

The boundaries are for normal means with a known spread. For few players the level is kept and the quantile is Student's with
players - 1 degrees of freedom (Jennison and Turnbull 2000, Group Sequential Methods, section 3.8): an approximation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import scipy

from app.study.data import StudyData
from marsexplorer.evaluation.intervals import CONFIDENCE, Floats

Spending = Literal["obrien-fleming", "pocock"]
ALPHA = 1 - CONFIDENCE
"""Of both sides and all looks together."""

POINTS_PER_SD = 60
"""Points of the grid on which a density is held, for each standard deviation of the next increment."""

FARTHEST = 8.3
"""Standard deviations beyond which a boundary is called infinite: less than 1e-16 lies there."""


@dataclass(frozen=True)
class Boundary:
    """The boundary of one look.

    fraction    of the planned players who had finished, in (0, 1]
    spent       alpha that was spent up to and with this look, both sides
    z           |Z| from which the boundary is crossed; infinite where too little alpha is spent
    confidence  level of the interval at this look, in [0.95, 1): it leaves out what crosses the boundary
    """

    fraction: float
    spent: float
    z: float
    confidence: float


def look_boundary(data: StudyData) -> Boundary | None:
    """Return the boundary of the look that is shown of a study (`app.study.looks.present`); None where none is."""
    if data.view is None or data.view.kind != "look" or data.protocol.spending == "none":
        return None
    return boundaries(data.protocol.spending, data.view.fractions)[-1]


def spent_alpha(spending: Spending, fraction: float, alpha: float = ALPHA) -> float:
    """Return the two-sided alpha spent when a fraction (0..1) of the information is there; each side spends half of it.

    O'Brien and Fleming's kind: 2 - 2 Phi(z / sqrt(t)) a side; Pocock's kind: a ln(1 + (e - 1) t), a of a side (Lan and DeMets).
    """
    if not 0 <= fraction <= 1:
        raise ValueError(f"the fraction must be in 0..1, got {fraction}")
    side = alpha / 2
    if fraction == 0:
        return 0.0
    if spending == "pocock":
        return 2 * side * float(np.log(1 + (np.e - 1) * fraction))
    return 4 * float(scipy.special.ndtr(scipy.special.ndtri(side / 2) / np.sqrt(fraction)))


def boundaries(
    spending: Spending, fractions: Sequence[float], alpha: float = ALPHA
) -> tuple[Boundary, ...]:
    """Return the two-sided boundary of each look; `fractions` rise and lie in (0, 1]."""
    return _boundaries(spending, tuple(float(each) for each in fractions), alpha)


@lru_cache(maxsize=256)
def _boundaries(
    spending: Spending, fractions: tuple[float, ...], alpha: float
) -> tuple[Boundary, ...]:
    if not fractions or min(fractions) <= 0 or max(fractions) > 1 or any(np.diff(fractions) <= 0):
        raise ValueError(f"looks must rise within (0, 1], got {fractions}")
    found: list[Boundary] = []
    reached: tuple[Floats, Floats] | None = (
        None  # grid and density of the Brownian motion that has crossed no boundary yet
    )
    before, spent = 0.0, 0.0
    for fraction in fractions:
        target = spent_alpha(spending, fraction, alpha)
        z = _boundary(reached, before, fraction, target - spent)
        tail = 2 * float(scipy.special.ndtr(-z))
        found.append(Boundary(fraction, target, z, 1 - tail))
        reached = _survived(reached, before, fraction, z)
        before, spent = fraction, target
    return tuple(found)


def _boundary(
    reached: tuple[Floats, Floats] | None, before: float, fraction: float, alpha: float
) -> float:
    """Return the z that is first crossed at this look with probability `alpha`, both sides together."""
    if alpha < 1e-15:
        return float("inf")
    if reached is None:
        return -float(scipy.special.ndtri(alpha / 2))

    def excess(z: float) -> float:
        return _crossing(reached, before, fraction, z) - alpha

    return (
        float("inf")
        if excess(FARTHEST) > 0
        else float(scipy.optimize.brentq(excess, 0.0, FARTHEST, xtol=1e-10))
    )


def _crossing(reached: tuple[Floats, Floats], before: float, fraction: float, z: float) -> float:
    """Return the probability of getting this far and then crossing +-z at `fraction`."""
    grid, density = reached
    scale, edge = np.sqrt(fraction - before), z * np.sqrt(fraction)
    beyond = scipy.special.ndtr((grid - edge) / scale) + scipy.special.ndtr((-edge - grid) / scale)
    return float((density * beyond).sum() * (grid[1] - grid[0]))


def _normal_density(x: Floats, scale: float) -> Floats:
    """Return the density at x of the normal distribution with mean 0 and the standard deviation `scale`."""
    density: Floats = np.exp(-((x / scale) ** 2) / 2) / np.sqrt(2 * np.pi) / scale
    return density


def _survived(
    reached: tuple[Floats, Floats] | None, before: float, fraction: float, z: float
) -> tuple[Floats, Floats]:
    """Return the grid (midpoints) and the density of the Brownian motion at `fraction` that has crossed no boundary."""
    edge = min(z, FARTHEST) * np.sqrt(fraction)
    scale = np.sqrt(fraction - before)
    count = int(np.ceil(2 * edge / scale * POINTS_PER_SD))
    grid = -edge + 2 * edge * (np.arange(count) + 0.5) / count
    if reached is None:
        return grid, _normal_density(grid, scale)
    old, held = reached
    density = np.concatenate(
        [
            _normal_density(part[:, None] - old, scale) @ held
            for part in np.array_split(grid, 1 + count // 500)
        ]
    )
    return grid, density * (old[1] - old[0])
