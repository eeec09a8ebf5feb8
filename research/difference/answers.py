"""What the trainings say: coverage of each combination, effect of each factor, and the verdicts of the design."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from statistics import fmean, stdev
from textwrap import fill
from typing import Any

from marsexplorer.intervals import t_quantile
from research.difference.design import SEEDS, Training
from research.paper.jobs import read_lines

DATA = Path(__file__).parent / "data" / "trainings.jsonl"
COLUMNS = ("coverage", "out_of_bounds", "collided")
"""Of the curve, that the table prints."""
HELD_OUT = ("covers_most", "explored", "clean_u")
"""Of the terrains kept apart, that the table prints."""
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


def effect_of(factor: str, records: Records) -> Interval | None:
    """Return the effect of a factor on coverage; None until all trainings are finished."""
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
        by_seed[training.seed].append(record.last("coverage") - other.last("coverage"))
    if any(len(differences) != 4 for differences in by_seed.values()):
        return None
    return Interval.of([fmean(differences) for differences in by_seed.values()])


def effect_of_passes(records: Records) -> Interval | None:
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
        differences.append(full_record.last("coverage") - light_record.last("coverage"))
    return Interval.of(differences)


def read_stored(path: Path = DATA) -> Records:
    """Return the stored trainings."""
    records: dict[Training, Record] = {}
    for stored in read_lines(path):
        rows = zip(*stored["curve"].values(), strict=True)
        curve = tuple(dict(zip(stored["curve"], row, strict=True)) for row in rows)
        training = Training(**stored["training"])
        records[training] = Record(training, tuple(stored["machines"]), curve, stored["result"])
    return records


def read_records(paths: Iterable[Path]) -> Records:
    """Return the trainings of some logs."""
    records: dict[Training, Record] = {}
    for path in paths:
        head, *lines = read_lines(path) or [{}]
        curve = tuple(line for line in lines if line["kind"] == "curve")
        result = next((line for line in lines if line["kind"] == "result"), None)
        if curve:
            training = Training(**head["training"])
            records[training] = Record(training, tuple(head["machines"]), curve, result)
    return records


def kind_of(training: Training) -> tuple[str, ...]:
    """Return what trainings of one combination share."""
    return (
        training.level,
        training.passes,
        training.world,
        training.estimates,
        training.leaving,
    )


def table(records: Records) -> str:
    """Return the answers as two tables in Markdown."""
    head = ["level", "passes", "world", "estimates", "leaving", "seeds", "moves"]
    rows = [[*head, *COLUMNS, *HELD_OUT, "sweeps"], ["---"] * 14]
    ordered = sorted(records.values(), key=lambda record: kind_of(record.training), reverse=True)
    for kind, group in groupby(ordered, lambda record: kind_of(record.training)):
        own = list(group)
        moves = min(record.lines[-1]["moves"] for record in own)
        columns = [spread([record.last(name) for record in own]) for name in COLUMNS]
        results = [record.result for record in own if record.result]
        for name in HELD_OUT:
            columns.append(spread([result[name] for result in results]) if results else "")
        is_sweep = sweeps([record.last("coverage") for record in own])
        rows.append([*kind, str(len(own)), f"{moves:,}", *columns, "yes" if is_sweep else ""])
    effects = [["factor", "effect on coverage", "verdict"], ["---"] * 3]
    measured = {factor: effect_of(factor, records) for factor in LEVELS}
    for factor, effect in {**measured, "passes": effect_of_passes(records)}.items():
        if effect is None:
            effects.append([factor, "not all finished", "undecided"])
        else:
            effects.append([factor, words(effect), verdict(effect)])
    return "\n\n".join("\n".join(f"|{'|'.join(row)}|" for row in part) for part in (rows, effects))


def in_short(records: Records) -> str:
    """What PPO does by the letter in either world, and by the code in the code's."""
    groups: dict[str, list[Record]] = {"text": [], "code": [], "full": []}
    for training, record in records.items():
        if training.level == "videos" and record.result is not None:
            if (training.estimates, training.passes) == ("text", "light"):
                groups[training.world].append(record)
            if (training.world, training.estimates, training.passes) == ("code", "code", "full"):
                groups["full"].append(record)
    text, code, full = (
        spread([record.last("coverage") for record in group]) for group in groups.values()
    )
    completed = max(_results(groups["text"], "explored"))
    share = f"{completed:.1%}" if completed else "none"
    u_shares, explored = (_results(groups["full"], name) for name in ("clean_u", "explored"))
    number = u_shares.index(max(u_shares))
    record = groups["full"][number]
    assert record.result is not None
    coverage, left = record.result["coverage"], record.result["out_of_bounds"]
    others = [share for i, share in enumerate(explored) if i != number]
    sentences = (
        f"On the level of the videos, PPO by the letter covers {text} of the text's world and completes "
        f"{share} of its terrains; of the code's it covers {code}. With the code's discount and lambda and as many "
        f"gradient steps as the authors' it covers {full} of the code's. Of its episodes on terrains kept apart, "
        f"seed {record.training.seed} makes a U as in the videos, mirrored, in {u_shares[number]:.1%}, covers "
        f"{coverage:.0%} in the mean, and leaves the grid in {left:.1%}; the other seeds complete "
        f"{' and '.join(f'{share:.1%}' for share in sorted(others))}."
    )
    return fill(re.sub(r"(?<=\d)%", " %", sentences), 110, break_on_hyphens=False)


def _results(records: Sequence[Record], name: str) -> list[float]:
    """A column of the results on terrains kept apart, of finished trainings."""
    return [record.result[name] for record in records if record.result is not None]


def spread(values: list[float]) -> str:
    """Return the smallest and the largest of some values."""
    low, high = (f"{limit(values):.2f}" for limit in (min, max))
    return low if low == high else f"{low} to {high}"


def words(effect: Interval) -> str:
    """Return an effect with its interval."""
    return f"{effect.mean:+.2f} ({effect.low:+.2f} to {effect.high:+.2f})"
