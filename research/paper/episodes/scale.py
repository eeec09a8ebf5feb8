"""How coverage grows with the moves, at several sizes: figure 7 (section 3.5).

A result has over its episodes

    stride        moves from one point of the curves to the next
    mean, sd      of the coverage after 0, stride, 2 stride, ... moves, 0..1; an episode keeps what
                  it had when it ended
    reached       "50", "75", "90", "95", "99" -> for each terrain, the moves until so many per cent
                  were known, null for never

The lists of `reached` have one number for each terrain, in the order of the seeds, so policies are
compared terrain by terrain.

Claims: "the learning-based approach requires the robot to travel less distance to explore the same
percentage of terrain", and the "knee": rules leave distant parts that take extra effort at the end.
Its measure is the **share of the last per cents**, the moves from 90 % to 99 % over all moves to 99
%, which is 9 / 99 = 0.09 where coverage grows at a constant pace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from marsexplorer.evaluation import RULES, Result
from marsexplorer.evaluation.plots import coverage_curves
from marsexplorer.evaluation.table import ratio_interval
from marsexplorer.intervals import Floats
from research.informed.informed import INFORMED
from research.paper.episodes.play import Play
from research.paper.jobs import Line
from research.paper.tables import UNKNOWN, Estimate

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
        """The curve, and the moves to each share, JSON-ready."""
        config, stride = self.config, max(1, self.size // 21)
        moves = stride * -(-max((result.steps for result in results), default=0) // stride)
        curves = coverage_curves(results, moves)[:, ::stride]
        by_seed = {result.seed: result for result in results}
        seeds = range(self.first_seed, self.first_seed + self.episodes)
        return {
            "stride": stride,
            "mean": _rounded(curves.mean(axis=0)) if results else [],
            "sd": _rounded(curves.std(axis=0, ddof=1)) if len(results) > 1 else [],
            "reached": {
                str(share): [
                    moves_until(by_seed.get(seed), share * config.n / 100) for seed in seeds
                ]
                for share in PER_CENT
            },
        }


@dataclass(frozen=True)
class ScaleRow:
    """One policy on one level and size.

    terrains     that it played
    completion   share of them that it explored, 0..1
    steps        moves to 99 %, an episode that ended otherwise counting the limit
    to_rule      mean steps over those of the better frontier rule, on the terrains that both
                 played; UNKNOWN without a rule
    to_informed  the same over those of the informed search
    last_share   share of the last per cents (see above), over the episodes that reached 99 %
    """

    policy: str
    level: str
    size: int
    terrains: int
    completion: float
    steps: Estimate
    to_rule: Estimate
    to_informed: Estimate
    last_share: Estimate


def moves_until(result: Result | None, cells: float) -> int | None:
    """The moves after which so many cells were known, or None.

    None if they never were, or if nothing was played.
    """
    if result is None:
        return None
    assert result.trace is not None
    enough = np.asarray(result.trace.discovered) >= cells
    return int(enough.argmax()) if enough.any() else None


def steps_of(line: Line, per_cent: int = 99) -> Floats:
    """The moves to a share of PER_CENT by terrain: float64[episodes].

    The limit if it was missed, NaN if it was not played.
    """
    steps = np.array(line["reached"][str(per_cent)], np.float64)  # None becomes NaN
    if line["policy"] != INFORMED:  # which reaches 99 % or finds no walk at all
        steps[np.isnan(steps)] = line["rows"] * line["cols"]
    return steps


def last_shares(line: Line) -> Floats:
    """The share of its moves from 90 % on, by episode that reached 99 %: float64[...]."""
    before, whole = (np.array(line["reached"][str(share)], np.float64) for share in (KNEE, 99))
    is_reached = whole > 0  # not so where NaN stands for never
    return np.asarray((whole - before)[is_reached] / whole[is_reached])


def compare(line: Line, reference: Line | None, per_cent: int = 99) -> Estimate:
    """The ratio of the mean moves to a share to a reference's, paired by terrain.

    UNKNOWN without two common terrains.
    """
    if reference is None:
        return UNKNOWN
    pair = np.stack([steps_of(line, per_cent), steps_of(reference, per_cent)])
    values, references = pair[:, ~np.isnan(pair).any(axis=0)]
    return Estimate(*ratio_interval(values, references)) if len(values) > 1 else UNKNOWN


def group_by_place(lines: Sequence[Line]) -> dict[tuple[str, int], dict[str, Line]]:
    """Group results: level and size -> policy -> result."""
    groups: dict[tuple[str, int], dict[str, Line]] = {}
    for line in lines:
        groups.setdefault((line["level"], line["rows"]), {})[line["policy"]] = line
    return groups


def scale_rows(lines: Sequence[Line]) -> list[ScaleRow]:
    """A row a result, compared with the better rule and with the informed search."""
    rows = []
    for group in group_by_place(lines).values():
        rules = [group[rule] for rule in RULES if rule in group]
        better = min(rules, key=lambda line: float(steps_of(line).mean()), default=None)
        rows += [_row(line, better, group.get(INFORMED)) for line in group.values()]
    return rows


def _row(line: Line, better: Line | None, informed: Line | None) -> ScaleRow:
    steps = steps_of(line)
    steps = steps[~np.isnan(steps)]
    explored = line["outcomes"].get("explored", 0)
    return ScaleRow(
        policy=line["policy"],
        level=line["level"],
        size=line["rows"],
        terrains=len(steps),
        completion=explored / max(1, len(steps)),
        steps=Estimate.of(steps),
        to_rule=compare(line, better),
        to_informed=compare(line, informed),
        last_share=Estimate.of(last_shares(line)),
    )


def _rounded(values: NDArray[np.float64]) -> list[float]:
    return [round(float(number), 5) for number in values]
