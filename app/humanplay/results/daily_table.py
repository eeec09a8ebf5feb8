"""The results of the daily terrain: ranks, moves, streaks, the shipped policies.

A player sees the results of today when their own attempt is over; those of an earlier day are everybody's. Only attempts whose
every move is attested as a person's own key or touch, and that ended before their day did, have a rank. Successes stand
first, the fewest moves first; the others follow by how much they had discovered, or else by their score.
"""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NotRequired, TypedDict

from humanplay.db.reader import Reader
from humanplay.db.series import DayResult, results
from humanplay.db.trial import Trial
from humanplay.jobs import Jobs
from humanplay.results.evaluations import Evaluation, FigureState, PolicyEvaluations, State
from humanplay.study.days import DailyTerrain, day_before
from humanplay.task import Environment, PolicyOffer, counted, draw_instance
from humanplay.task.registration import DEFAULT_TASK, environment_of

SHOWN = 10
"""Rows of the table of results."""
CALENDAR = 28
"""Days of a player's calendar."""
WAIT_S = 3.0
"""How long the evaluation waits after somebody has begun: the page that was just opened comes first."""


class DayRow(TypedDict):
    """A row of the table of results.

    moves     of a success; None without
    coverage  0..1; None where nothing is discovered
    you       whether it is the player's who asks
    episode   its id, once the day is over
    """

    rank: int
    outcome: str
    moves: int | None
    coverage: float | None
    you: bool
    episode: NotRequired[str]


class PeopleOfDay(TypedDict):
    """What people came to on a terrain.

    moves       [moves, how many people] of those who succeeded
    unfinished  how many did not
    table       the first rows
    you         the row of the player who asks; None where they have none
    """

    players: int
    unfinished: int
    moves: list[tuple[int, int]]
    table: list[DayRow]
    you: DayRow | None


class PolicyResult(TypedDict):
    """What a policy came to on a day's terrain.

    moves     of a success; None without, or if it is not known yet
    coverage  0..1 at the end; None while it is not known, and where nothing is discovered
    """

    name: str
    state: State
    moves: int | None
    coverage: float | None


def people_on(
    reader: Reader, terrain: DailyTerrain, player_id: str | None, names_episodes: bool
) -> PeopleOfDay:
    """Return what people came to on a terrain; no player is named.

    names_episodes  True once the day is over: the rows of the table then say which episode they are
    """
    environment = environment_of(terrain.task)
    cells = environment.cells(draw_instance(environment, terrain.config, terrain.seed))
    ended = sorted(
        results(reader, terrain.series.name, terrain.ends_ms),
        key=lambda result: _order(result, environment),
    )
    table: list[DayRow] = []
    for number, result in enumerate(ended):
        is_alike = number and _order(ended[number - 1], environment) == _order(result, environment)
        row = _row(result, environment, cells, player_id)
        row["rank"] = table[-1]["rank"] if is_alike else number + 1
        if not names_episodes:
            del row["episode"]
        table.append(row)
    counts = Counter(row["moves"] for row in table if row["moves"] is not None)
    return {
        "players": len(table),
        "unfinished": sum(row["moves"] is None for row in table),
        "moves": sorted(counts.items()),
        "table": table[:SHOWN],
        "you": next((row for row in table if row["you"]), None),
    }


def people_text(people: PeopleOfDay) -> str:
    """Return how a day came out, in a sentence for a preview of its link."""
    if not people["players"]:
        return "Nobody has a rank on this day."
    players = counted(people["players"], "person", "people")
    best = people["moves"][0][0] if people["moves"] else None
    return (
        f"{players}, and nobody finished."
        if best is None
        else (f"{players}, the best with {counted(best, 'move')}.")
    )


def describe_attempt(attempt: Trial | None, terrain: DailyTerrain) -> dict[str, object] | None:
    """Return a player's attempt for their own page; None before it.

    `unranked` says why a finished attempt has no rank.
    """
    if attempt is None:
        return None
    ended = attempt.ended_ms is not None
    return {
        "state": "ended" if ended else "open",
        "episode": attempt.id,
        "outcome": attempt.outcome,
        "moves": attempt.moves,
        "coverage": attempt.coverage,
        "score": attempt.score,
        "unranked": _unranked_reason(attempt, terrain) if ended else None,
    }


def streak(attempts: Sequence[Trial], today: str) -> int:
    """How many days in a row, to today or yesterday, a player finished the daily.

    An abandoned episode ends a streak.
    """
    ended = (attempt for attempt in attempts if attempt.ended_ms is not None)
    played = {attempt.day for attempt in ended if attempt.outcome != "abandoned"}
    day = today if today in played else day_before(today)
    count = 0
    while day in played:
        count, day = count + 1, day_before(day)
    return count


def calendar(attempts: Sequence[Trial]) -> list[dict[str, object]]:
    """Return a player's newest results, at most CALENDAR, the oldest first.

    `moves` is None without success.
    """
    ended = [attempt for attempt in attempts if attempt.ended_ms is not None]
    return [
        {
            "day": attempt.day,
            "outcome": attempt.outcome,
            "moves": attempt.moves if attempt.succeeded else None,
        }
        for attempt in sorted(ended, key=_day)[-CALENDAR:]
    ]


def _day(attempt: Trial) -> str:
    return attempt.day or ""


def _unranked_reason(attempt: Trial, terrain: DailyTerrain) -> str | None:
    if attempt.driver != "human":
        return "a move was a script's"
    if attempt.attestation not in ("attested", "supervised"):
        return "not every move could be matched with a key press or a touch of yours"
    if attempt.moves == 0:
        return "no move was made"
    if attempt.ended_ms is not None and attempt.ended_ms >= terrain.ends_ms:
        return "it ended after midnight UTC, when its day was over"
    return None


def _row(result: DayResult, environment: Environment, cells: int, player_id: str | None) -> DayRow:
    return {
        "rank": 0,
        "outcome": result.outcome,
        "moves": result.steps if result.outcome in environment.successes else None,
        "coverage": result.discovered / cells if cells else None,
        "you": result.player_id == player_id,
        "episode": result.episode_id,
    }


def _order(result: DayResult, environment: Environment) -> tuple[float, float, float]:
    """Sort by a success's moves; without success by discovery, then by score."""
    if result.outcome in environment.successes:
        return result.steps, 0, 0
    return math.inf, -result.discovered, -result.score


class DailyPolicies:
    """Figures of the shipped policies on offer; `path` is the file that keeps them."""

    def __init__(
        self,
        path: Path,
        offers: Sequence[PolicyOffer],
        jobs: Jobs,
        task: str = DEFAULT_TASK,
    ) -> None:
        self._offers = [offer for offer in offers if offer.is_shipped]
        slow = {name: at for at, name in enumerate(environment_of(task).policies.slow, 1)}
        self._offers.sort(key=lambda offer: slow.get(offer.name, 0))
        self._task = task
        self._evaluations = PolicyEvaluations(path, jobs, task=task)
        self._soon: asyncio.Task[None] | None = None

    def prepare(self, terrain: DailyTerrain) -> None:
        """Begin a terrain's figures soon, so that they are ready for whoever finishes it."""
        if self._soon is None or self._soon.done():
            self._soon = asyncio.create_task(self._later(terrain), name="daily policies")

    def results(self, terrain: DailyTerrain) -> list[PolicyResult]:
        """What each policy came to, the best first; what is missing is begun."""
        config, seeds = terrain.config, (terrain.seed,)
        offers = [offer for offer in self._offers if offer.plays(config)]
        wanted = [Evaluation(offer.source, config, seeds, self._task) for offer in offers]
        policies = [
            _policy_result(offer.name, state)
            for offer, state in zip(offers, self._evaluations.request(wanted), strict=True)
        ]
        policies.sort(key=lambda policy: (policy["moves"] or 0, -(policy["coverage"] or 0)))
        return sorted(policies, key=lambda policy: policy["moves"] is None)

    def close(self) -> None:
        """Begin nothing any more."""
        if self._soon is not None:
            self._soon.cancel()

    async def _later(self, terrain: DailyTerrain) -> None:
        await asyncio.sleep(WAIT_S)
        self.results(terrain)


def _policy_result(name: str, state: FigureState) -> PolicyResult:
    figure = state["figure"]
    if figure is None:
        return {"name": name, "state": state["state"], "moves": None, "coverage": None}
    moves = round(figure["steps"]["mean"]) if figure["completed"] else None
    coverage = figure["curve"]["mean"][-1] if "curve" in figure else None
    return {"name": name, "state": "ready", "moves": moves, "coverage": coverage}
