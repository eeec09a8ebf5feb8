"""Replays and the cost of moves, for any reproducible environment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from humanplay.task import (
    Configuration,
    Environment,
    GhostError,
    PolicyError,
    PolicyOffer,
    Record,
)
from humanplay.task.registration import environment_of
from humanplay.tasks import costs
from humanplay.tasks.frames import FrameCourse

MOST_BYTES = 16 * 2**20
"""Bytes of pictures that a replay holds; of one with more every second, third, ... frame is left out."""


class FrameCourses:
    """Episodes as frames, beside a policy's (`humanplay.task.Courses`)."""

    kinds: tuple[str, ...] = (costs.LOSS, costs.ENDED_EARLY)
    ended_early: str = costs.ENDED_EARLY

    def __init__(self, environment: Environment) -> None:
        self._environment = environment

    def __reduce__(self) -> tuple[Callable[[str], FrameCourses], tuple[str]]:
        """Another process makes them of the same task."""
        return _of_task, (self._environment.name,)

    def course_of(self, name: str, record: Record) -> FrameCourse:
        """Replay a finished episode; ValueError if it cannot be played here."""
        environment = self._environment
        if record.core_version != environment.version:
            raise ValueError(f"the episode was played under {record.core_version}")
        frames = environment.frames(record, "")
        size = sum(len(str(frame.get("picture") or frame.get("text") or "")) for frame in frames)
        shown = (*frames[: -1 : 1 + size // MOST_BYTES], frames[-1])
        actions = tuple(environment.actions[action] for action in record.actions)
        return FrameCourse(name, environment.name, record.config, actions, shown)

    def choices(self, offers: Sequence[PolicyOffer], config: Configuration) -> list[str]:
        """The names of the policies that play a configuration."""
        return [offer.name for offer in offers if offer.plays(config)]

    def preferred(self, driver: str, names: Sequence[str] | None = None) -> str | None:
        """The expert, or the first other policy that did not drive."""
        names = names or []
        expert = self._environment.expert
        first = [expert] if expert in names else []
        return next((name for name in (*first, *names) if name and name != driver), None)

    def play_ghost(self, source: str, record: Record) -> FrameCourse:
        """Play a policy on an episode's instance; GhostError if it cannot be played."""
        policies = self._environment.policies
        if record.seed is None:
            raise GhostError("no policy plays an instance that was given")
        try:
            policy = policies.load(source, record.config)
            run = policies.play(policy, record.config, record.seed, 0)
        except PolicyError as error:
            raise GhostError(str(error)) from error
        return self.course_of(policy.name, run.record())

    def check_judged(self, config: Configuration) -> None:
        """Raise ValueError, saying why, if no move of a configuration is judged."""
        costs.check_judged(self._environment, config)

    def estimator(self, source: str, cache: Path | None) -> costs.MoveJudge:
        """What works out costs by a policy; nothing is worth keeping."""
        return costs.MoveJudge(self._environment, source)

    def explain(self, cache: Path, record: Record, source: str) -> dict[str, object]:
        """What a page shows of an episode's costs; ValueError if it cannot be replayed."""
        try:
            self.check_judged(record.config)
        except ValueError as error:
            return self.explain_without_costs(record, str(error))
        return costs.explained(self._environment, self.estimator(source, None).costs(record))

    def explain_without_costs(self, record: Record, reason: str) -> dict[str, object]:
        """What a page shows of an episode of which no move is judged, for this reason."""
        return costs.explained_without_costs(self._environment, record, reason)


def _of_task(name: str) -> FrameCourses:
    return FrameCourses(environment_of(name))
