"""How coverage grows with the moves, at several sizes: the measures of figure 7 (section 3.5).

A result has over its episodes

    stride        moves from one point of the curves to the next
    mean, sd      of the coverage after 0, stride, 2 stride, ... moves, 0..1; an episode keeps what it had when it ended
    reached       "50", "75", "90", "95", "99" -> for each terrain, the moves until so many per cent were known, null for never

The lists of `reached` have one entry for each terrain, in the order of the seeds, so policies are compared terrain by terrain.

Claims: "the learning-based approach requires the robot to travel less distance to explore the same percentage of terrain", and
the "knee": rules leave distant parts that take extra effort at the end. Its measure is the **share of the last per cents**, the
moves from 90 % to 99 % over all moves to 99 %, which is 9 / 99 = 0.09 where coverage grows at a constant pace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from marsexplorer.evaluation import RULES, Result
from marsexplorer.evaluation.intervals import Floats, t_interval
from marsexplorer.evaluation.plots import coverage_curves
from marsexplorer.evaluation.table import ratio_interval
from research.informed import INFORMED
from research.paper.episodes.play import Line, Play

PER_CENT = (50, 75, 90, 95, 99)
"""Coverages whose moves are kept."""

KNEE = 90
"""Coverage (%) from which the last per cents count."""


@dataclass(frozen=True)
class Coverage(Play):
    """The episodes of one policy on one level and size, for figure 7."""

    figure: ClassVar[int] = 7
    kind: ClassVar[str] = "coverage"

    def measure(self, results: Sequence[Result]) -> Line:
        """Return the curve and what was reached when, JSON-ready."""
        config, stride = self.config, max(1, self.size // 21)
        moves = stride * -(-max((result.steps for result in results), default=0) // stride)
        curves = coverage_curves(results, moves)[:, ::stride]
        by_seed = {result.seed: result for result in results}
        seeds = range(self.first_seed, self.first_seed + self.episodes)
        needed = {per_cent: cells_for(per_cent, config.n) for per_cent in PER_CENT}
        return {
            "stride": stride,
            "mean": _rounded(curves.mean(axis=0)) if results else [],
            "sd": _rounded(curves.std(axis=0, ddof=1)) if len(results) > 1 else [],
            "reached": {
                str(per_cent): [moves_until(by_seed.get(seed), cells) for seed in seeds]
                for per_cent, cells in needed.items()
            },
        }


@dataclass(frozen=True)
class Estimate:
    """A mean, a ratio or a share over terrains, with its 95 % interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class ScaleRow:
    """One policy on one level and size.

    terrains     that it played
    completion   share of them that it explored, 0..1
    steps        moves to 99 %, an episode that ended otherwise counting the limit
    to_rule      mean steps over those of the better frontier rule, on the terrains that both played; None where no rule played
    to_informed  the same over those of the informed search
    last_share   share of the last per cents (see the module), over the episodes that reached 99 %
    """

    policy: str
    level: str
    size: int
    terrains: int
    completion: float
    steps: Estimate
    to_rule: Estimate | None
    to_informed: Estimate | None
    last_share: Estimate | None


def cells_for(per_cent: int, cells: int) -> int:
    """Return the fewest cells that are at least so many per cent of all."""
    return -(-per_cent * cells // 100)


def moves_until(result: Result | None, cells: int) -> int | None:
    """Return the moves after which so many cells were known, None where they never were or nothing was played."""
    if result is None:
        return None
    assert result.trace is not None
    enough = np.asarray(result.trace.discovered) >= cells
    return int(enough.argmax()) if enough.any() else None


def steps_of(line: Line, per_cent: int = 99) -> Floats:
    """Return float64[episodes], the moves to a share of PER_CENT by terrain: the limit where missed, NaN where not played."""
    limit = line["rows"] * line["cols"]
    steps = np.array(
        [limit if each is None else each for each in line["reached"][str(per_cent)]], np.float64
    )
    if line["policy"] == INFORMED:  # it reaches 99 % or finds no walk at all
        steps[steps == limit] = np.nan
    return steps


def last_shares(line: Line) -> Floats:
    """Return float64[...], for each episode that reached 99 % the share of its moves that it made from 90 % on."""
    reached = np.array(
        [line["reached"][str(per_cent)] for per_cent in (KNEE, 99)], np.float64
    )  # None becomes NaN
    before, whole = reached[:, ~np.isnan(reached[1])]
    return np.asarray((whole - before)[whole > 0] / whole[whole > 0])


def compare(line: Line, reference: Line | None, per_cent: int = 99) -> Estimate | None:
    """Return the ratio of the mean moves to a share to those of a reference, paired; None without two common terrains."""
    if reference is None:
        return None
    pair = np.stack([steps_of(line, per_cent), steps_of(reference, per_cent)])
    values, references = pair[:, ~np.isnan(pair).any(axis=0)]
    return Estimate(*ratio_interval(values, references)) if len(values) > 1 else None


def estimate(values: Floats) -> Estimate | None:
    """Return the mean of independent values with its t interval, None for fewer than two."""
    if len(values) < 2:
        return None
    low, high = t_interval(values)
    return Estimate(float(values.mean()), float(low), float(high))


def group_by_place(lines: Sequence[Line]) -> dict[tuple[str, int], dict[str, Line]]:
    """Return level and size -> policy -> result."""
    groups: dict[tuple[str, int], dict[str, Line]] = {}
    for line in lines:
        groups.setdefault((line["level"], line["rows"]), {})[line["policy"]] = line
    return groups


def scale_rows(lines: Sequence[Line]) -> list[ScaleRow]:
    """Return a row for each result, compared with the better rule and with the informed search on the same terrains."""
    rows = []
    for group in group_by_place(lines).values():
        rules = [group[rule] for rule in RULES if rule in group]
        better = min(rules, key=lambda line: float(steps_of(line).mean()), default=None)
        rows += [_row(line, better, group.get(INFORMED)) for line in group.values()]
    return rows


def _row(line: Line, better: Line | None, informed: Line | None) -> ScaleRow:
    steps = steps_of(line)
    steps = steps[~np.isnan(steps)]
    mean = estimate(steps) or Estimate(float("nan"), float("nan"), float("nan"))
    explored = line["outcomes"].get("explored", 0)
    return ScaleRow(
        policy=line["policy"],
        level=line["level"],
        size=line["rows"],
        terrains=len(steps),
        completion=explored / max(1, len(steps)),
        steps=mean,
        to_rule=compare(line, better),
        to_informed=compare(line, informed),
        last_share=estimate(last_shares(line)),
    )


def _rounded(values: NDArray[np.float64]) -> list[float]:
    return [round(float(value), 5) for value in values]
