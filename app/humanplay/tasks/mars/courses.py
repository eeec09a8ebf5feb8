"""Replays of MarsExplorer's episodes, and the cost of their moves beside Expert's."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from humanplay.task import Configuration, EpisodeCosts, PolicyOffer, Record
from humanplay.tasks.mars.course import Course, course_of, play_ghost, preferred
from humanplay.tasks.mars.explanation import explain, explain_without_costs
from humanplay.tasks.mars.narrowing import own_config, own_record
from marsexplorer.evaluation import cost
from marsexplorer.evaluation.mistakes import MistakeKind


class CostEstimator:
    """What works out costs by a file of Expert (`humanplay.task.CostEstimator`)."""

    def __init__(self, source: str, cache: Path | None) -> None:
        self._estimator = cost.CostEstimator(source, cache)

    def costs(self, record: Record) -> EpisodeCosts:
        """The costs of an episode's moves."""
        return self._estimator.costs(own_record(record))


class MarsCourses:
    """The courses of MarsExplorer, and Expert's judgement (`humanplay.task.Courses`)."""

    kinds: tuple[str, ...] = tuple(MistakeKind)
    ended_early: str = MistakeKind.ENDED_EARLY

    def course_of(self, name: str, record: Record) -> Course:
        """A finished episode's course; ValueError if these rules cannot replay it."""
        return course_of(name, own_record(record))

    def choices(self, offers: Sequence[PolicyOffer], config: Configuration) -> list[str]:
        """The names of the policies that play boards of this size."""
        return [offer.name for offer in offers if offer.plays(config)]

    def preferred(self, driver: str, names: Sequence[str] | None = None) -> str | None:
        """The policy to show beside a driver; None if only the driver itself is on offer."""
        return preferred(driver, names)

    def play_ghost(self, source: str, record: Record) -> Course:
        """A policy's course from the start of a record; GhostError if it has none."""
        return play_ghost(source, own_record(record))

    def check_judged(self, config: Configuration) -> None:
        """Raise ValueError for large boards and maps, of which no move is judged."""
        cost.check_judged(own_config(config))

    def estimator(self, source: str, cache: Path | None) -> CostEstimator:
        """What works out costs by a file of Expert."""
        return CostEstimator(source, cache)

    def explain(self, cache: Path, record: Record, source: str) -> dict[str, object]:
        """What a page shows of an episode's costs; ValueError if it cannot be replayed."""
        return explain(cache, own_record(record), source)

    def explain_without_costs(self, record: Record, reason: str) -> dict[str, object]:
        """What a page shows of an episode of which no move is judged, for this reason."""
        return explain_without_costs(own_record(record), reason)
