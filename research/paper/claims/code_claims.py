"""The paper's findings, judged by trainings in the world of the authors' code.

They are on one level, that of the videos, so a finding is reached there in part at most: where all
seeds reach it with certainty. That none does counts after the paper's gradient steps alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from marsexplorer.intervals import wilson_interval
from research.difference.answers import MAJORITY, Record, Records, finished, results_of
from research.paper.claims.results import NOT_YET, PARTLY, Results, one_sided, surpasses
from research.paper.tables import Estimate, low_to_high, tenths

MOST = 0.9


def on_one_level(shares: Sequence[float], least: tuple[float, float], is_full: bool) -> str:
    """Judge a finding by the share of each seed's episodes that reach it.

    least  the share to surpass, as its 95 % interval
    """
    if not shares:
        return NOT_YET
    over_seeds = Estimate.of(shares)
    holds = surpasses((over_seeds.low, over_seeds.high), least)
    return PARTLY if holds else one_sided(holds, is_full)


def trained(records: Records) -> tuple[list[Record], bool]:
    """The finished trainings by the code in its world, with full passes if possible."""
    code = {"world": "code", "estimates": "code", "leaving": "free"}
    full = finished(records, passes="full", **code)
    return full or finished(records, passes="light", **code), bool(full)


def judged(results: Results, column: str, least: tuple[float, float], words: str) -> str:
    """A judgement by a column of the results on terrains kept apart, with the shares."""
    records, is_full = trained(results.trainings)
    shares = results_of(records, column)
    verdict = on_one_level(shares, least, is_full)
    return f"{verdict}: {words} in {low_to_high(shares, tenths)}" if shares else verdict


def generalises(results: Results) -> str:
    """Most new terrains are mostly covered."""
    return judged(results, "covers_most", (MOST, MOST), "90 % of a new terrain")


def hilbert(results: Results) -> str:
    """A U without going back is a majority, and more than either rule makes there."""
    rules = results.code_rules
    if not rules or not trained(results.trainings)[0]:
        return NOT_YET
    intervals = [
        wilson_interval(round(line["clean_u"] * line["terrains"]), line["terrains"])
        for line in rules
    ]
    low, high = (max(MAJORITY, *limits) for limits in zip(*intervals, strict=True))
    words = ", ".join(f"`{line['policy']}` {tenths(line['clean_u'])}" for line in rules)
    judgement = judged(results, "clean_u", (low, high), "a U without going back")
    return f"{judgement}; {words}"


BY_CODE: dict[str, Callable[[Results], str]] = {"generalises": generalises, "hilbert": hilbert}
"""Finding -> its judge; the others are not measured there."""


def by_code(name: str, results: Results) -> str:
    """Judge a finding in the world of the code; empty if not measured there."""
    return BY_CODE[name](results) if name in BY_CODE else ""
