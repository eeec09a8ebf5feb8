"""The coverage of each combination, the effect of each factor, and the verdicts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from statistics import fmean
from textwrap import fill
from typing import Any

from research.difference.design import SEEDS, Training
from research.paper.jobs import read_lines
from research.paper.tables import Estimate, low_to_high, per_cent, tenths, without_constants

DATA = Path(__file__).parent / "data" / "trainings.jsonl"
RULE_RESULTS = DATA.with_name("rules.jsonl")
"""Of the frontier rules on the terrains kept apart of the videos' level, in the code's world."""
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


def verdict(effect: Estimate | None) -> str:
    """The verdict on a factor; its effect is None until all trainings are finished."""
    if effect is None:
        return "undecided"
    if effect.low > LARGE or effect.high < -LARGE:
        return "makes the difference"
    if effect.low > -LARGE and effect.high < LARGE:
        return "makes no difference"
    return "undecided" if effect.low < 0 < effect.high else "undecided whether enough to count"


def sweeps(coverages: Sequence[float]) -> bool:
    """Return whether trainings of one kind cover SWEEPS with certainty."""
    return Estimate.of(coverages).low > SWEEPS  # NaN of one training is not above


def effect_of(factor: str, records: Records) -> Estimate | None:
    """A factor's effect on coverage; None until all trainings are finished."""
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
    return Estimate.of([fmean(differences) for differences in by_seed.values()])


def effect_of_passes(records: Records) -> Estimate | None:
    """Return full less light passes in the code's corner; None until all are finished."""
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
    return Estimate.of(differences)


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
    """What the trainings came to, as a table in Markdown."""
    head = ["level", "passes", "world", "estimates", "leaving", "seeds", "moves"]
    rows = []
    ordered = sorted(records.values(), key=lambda record: kind_of(record.training), reverse=True)
    for kind, group in groupby(ordered, lambda record: kind_of(record.training)):
        same_kind = list(group)
        moves = low_to_high([record.lines[-1]["moves"] for record in same_kind], "{:,}".format)
        columns = [
            low_to_high([record.last(name) for record in same_kind], per_cent) for name in COLUMNS
        ]
        results = [record.result for record in same_kind if record.result]
        for name in HELD_OUT:
            shares = [result[name] for result in results]
            span = low_to_high(shares, tenths) if results else ""
            ended = f" ({len(results)} of {len(same_kind)} seeds)"
            columns.append(span + ended * (0 < len(results) < len(same_kind)))
        is_sweep = sweeps([record.last("coverage") for record in same_kind])
        rows.append([*kind, str(len(same_kind)), moves, *columns, "yes" if is_sweep else ""])
    return without_constants([*head, *COLUMNS, *HELD_OUT, "sweeps"], rows)


FACTORS = {
    "world": "the world",
    "estimates": "the discount and lambda",
    "leaving": "what leaving the grid costs",
    "passes": "the gradient steps",
}
"""Factor -> what the page calls it."""


def reasons(records: Records) -> str:
    """Which factors make the difference, with their effects, as a list in Markdown."""
    by_verdict: dict[str, list[str]] = {}
    effects = {factor: effect_of(factor, records) for factor in LEVELS}
    for factor, effect in {**effects, "passes": effect_of_passes(records)}.items():
        size = effect.span("{:+.2f}") if effect is not None else "not all finished"
        by_verdict.setdefault(verdict(effect), []).append(f"{FACTORS[factor]} {size}")
    return "\n".join(f"- {words}: {'; '.join(factors)}" for words, factors in by_verdict.items())


MAJORITY = 0.5
"""Of a training's episodes: more of them are most."""


def in_short(records: Records) -> str:
    """What PPO does by the letter in either world, and by the code in the code's.

    Empty until the trainings of the design in light passes and those in full passes are finished.
    """
    letter = {
        world: finished(records, world=world, estimates="text", passes="light")
        for world in LEVELS["world"]
    }
    full = finished(records, world="code", estimates="code", passes="full")
    if not full or not all(letter.values()):
        return ""
    covered = {
        world: low_to_high(results_of(group, "coverage"), per_cent)
        for world, group in letter.items()
    }
    completed = low_to_high(results_of(letter["text"], "explored"), per_cent)
    started = [
        record
        for training, record in records.items()
        if (training.world, training.passes, training.level) == ("text", "full", "videos")
    ]
    makers = [record for record in full if record.result and record.result["clean_u"] > MAJORITY]
    others = [record for record in full if record not in makers]
    sentences = [
        f"On terrains kept apart, of the level of the videos (preset `videos`), PPO by the letter, with 48 gradient "
        f"steps an update where the authors' code makes 960, covers {covered['text']} of the text's world and "
        f"completes {completed} of its terrains; of the code's it covers {covered['code']}.",
        *stopped(started),
        "With the code's discount and lambda and 960 gradient steps an update it covers "
        f"{low_to_high(results_of(full, 'coverage'), per_cent)} of the code's.",
        f"Most episodes are a U without going back, as in the videos, for {len(makers)} of these {len(full)} seeds"
        + (f": {ends_of(makers)}." if makers else "."),
    ]
    if makers and others:
        sentences.append(f"For the others it is {ends_of(others)}.")
    text = fill(" ".join(sentences), 110, break_on_hyphens=False)
    return text.replace("\N{NO-BREAK SPACE}", " ")


def stopped(records: Sequence[Record]) -> list[str]:
    """What full passes in the text's world covered when they were stopped."""
    if not records or any(record.result is not None for record in records):
        return []
    moves = min(record.lines[-1]["moves"] for record in records)
    shares = low_to_high([record.last("coverage") for record in records], per_cent)
    return [
        f"With 960 in the text's, stopped after {moves:,} of 800,000 moves, it covered {shares} in training."
    ]


def ends_of(records: Sequence[Record]) -> str:
    """How often trainings make a U, complete the terrain, and leave the grid."""
    with_u, completed, left = (
        " and ".join(f"{100 * share:.1f}" for share in results_of(records, name))
        + "\N{NO-BREAK SPACE}%"
        for name in ("clean_u", "explored", "out_of_bounds")
    )
    return f"{with_u}, where {completed} complete the terrain and {left} leave the grid"


def finished(records: Records, **kind: str) -> list[Record]:
    """The finished trainings of a kind on the level of the videos, by seed."""
    of_kind = [
        record
        for training, record in records.items()
        if training.level == "videos"
        and record.result is not None
        and all(getattr(training, name) == setting for name, setting in kind.items())
    ]
    return sorted(of_kind, key=lambda record: record.training.seed)


def results_of(records: Sequence[Record], name: str) -> list[float]:
    """A column of the results on terrains kept apart, of finished trainings."""
    return [record.result[name] for record in records if record.result is not None]
