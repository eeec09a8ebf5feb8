"""What the trainings say: coverage of each combination, effect of each factor, and the verdicts of the design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean, stdev
from typing import Any

from marsexplorer.intervals import t_quantile
from research.difference.design import SEEDS, Training

LAST_LINES = 5
"""Of the curve, whose mean is a training's coverage."""
LARGE = 0.10
"""Of coverage: a smaller effect is none."""
SWEEPS = 0.70
"""Of coverage: what lies above it with certainty sweeps."""
LEVELS = {
    "world": ("code", "text"),
    "estimates": ("code", "text"),
    "leaving": ("free", "costs"),
}
"""Factor -> its levels: the effect is the first less the second."""


@dataclass(frozen=True)
class Interval:
    """A mean over seeds with its 95 % t interval."""

    mean: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Interval:
        """Return the interval of at least two values."""
        mean = fmean(values)
        half = t_quantile(len(values) - 1) * stdev(values) / len(values) ** 0.5
        return cls(mean, mean - half, mean + half)


@dataclass(frozen=True)
class Record:
    """A training with what its log says.

    lines   of the curve
    result  on the terrains kept apart; None of one that is not finished
    """

    training: Training
    machines: tuple[str, ...]
    lines: tuple[Mapping[str, Any], ...]
    result: Mapping[str, Any] | None

    def last(self, name: str) -> float:
        """Return the mean of a column over the last lines."""
        return fmean(line[name] for line in self.lines[-LAST_LINES:])


Records = Mapping[Training, Record]


def verdict(effect: Interval) -> str:
    """Return what an effect on coverage says of its factor."""
    if effect.low > LARGE or effect.high < -LARGE:
        return "makes the difference"
    if effect.low > -LARGE and effect.high < LARGE:
        return "makes no difference"
    return "undecided"


def sweeps(coverages: Sequence[float]) -> bool:
    """Return whether trainings of one kind cover so much with certainty; that they do not shows nothing."""
    return len(coverages) > 1 and Interval.of(coverages).low > SWEEPS


def effect_of(factor: str, records: Records, name: str = "coverage") -> Interval | None:
    """Return the effect of a factor on a column of the curve; None until all trainings are finished."""
    high, low = LEVELS[factor]
    by_seed: dict[int, list[float]] = {seed: [] for seed in SEEDS}
    for record in records.values():
        training = record.training
        if getattr(training, factor) != high or (training.passes, training.level) != (
            "light",
            "videos",
        ):
            continue
        changed: dict[str, Any] = {factor: low}
        other = records.get(replace(training, **changed))
        if other is None or other.result is None or record.result is None:
            return None
        by_seed[training.seed].append(record.last(name) - other.last(name))
    if any(len(differences) != 4 for differences in by_seed.values()):
        return None
    return Interval.of([fmean(differences) for differences in by_seed.values()])


def effect_of_passes(records: Records, name: str = "coverage") -> Interval | None:
    """Return full less light passes in the code's corner; None until the trainings are finished."""
    differences = []
    for seed in SEEDS:
        light = Training("code", "code", "free", seed)
        pair = [records.get(replace(light, passes=passes)) for passes in ("full", "light")]
        if any(record is None or record.result is None for record in pair):
            return None
        full_record, light_record = pair
        assert full_record is not None
        assert light_record is not None
        differences.append(full_record.last(name) - light_record.last(name))
    return Interval.of(differences)
