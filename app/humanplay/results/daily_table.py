"""What the daily terrain came to: people's ranks, the distribution of moves, a player's place and streak, the shipped policies.

A player sees the results of today when their own attempt is over; those of an earlier day are everybody's. Only attempts whose
every move is attested as a person's own key or touch, and that ended before their day did, have a rank. Those who came to 99 %
stand first, the fewest moves first; the others follow by how much they had mapped.
"""

from __future__ import annotations

import asyncio
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
from humanplay.task import PolicyOffer, drawn
from humanplay.task.registration import DEFAULT_TASK, environment_of

SHOWN = 10
"""Rows of the table of results."""
CALENDAR = 28
"""Days of a player's calendar."""
WAIT_S = 3.0
"""How long the evaluation waits after somebody has begun: the page that was just opened comes first."""
_SLOW = ("random", "lookahead")


class DayRow(TypedDict):
    """A row of the table of results.

    moves     to 99 %; None without
    coverage  0..1
    you       whether it is the player's who asks
    episode   its id, once the day is over
    """

    rank: int
    outcome: str
    moves: int | None
    coverage: float
    you: bool
    episode: NotRequired[str]


class PolicyResult(TypedDict):
    """What a policy came to on a day's terrain.

    moves     to 99 %; None if it was not reached or is not known yet
    coverage  0..1 at the end; None while it is not known
    """

    name: str
    state: State
    moves: int | None
    coverage: float | None


def people_on(
    reader: Reader, terrain: DailyTerrain, player_id: str | None, names_episodes: bool
) -> dict[str, object]:
    """Return what people came to on a terrain; no player is named.

    names_episodes  True once the day is over: the rows of the table then say which episode they are

    `moves` is the distribution, [moves, how many people] of those who came to 99 %; `unfinished` counts the others. `you` is
    the player's own row, None where they have none.
    """
    cells, ended = (_cells(terrain), results(reader, terrain.series.name, terrain.ends_ms))
    table = sorted((_row(result, cells, player_id) for result in ended), key=_order)
    for number, row in enumerate(table):
        before = table[number - 1] if number else None
        is_alike = before is not None and _order(before) == _order(row)
        row["rank"] = before["rank"] if before and is_alike else number + 1
        if not names_episodes:
            del row["episode"]
    counts = Counter(row["moves"] for row in table if row["moves"] is not None)
    return {
        "players": len(table),
        "unfinished": sum(row["moves"] is None for row in table),
        "moves": [[moves, counts[moves]] for moves in sorted(counts)],
        "table": table[:SHOWN],
        "you": next((row for row in table if row["you"]), None),
    }


def describe_attempt(attempt: Trial | None, terrain: DailyTerrain) -> dict[str, object] | None:
    """Return a player's attempt for their own page; None before it. `unranked` says why an ended one has no rank."""
    if attempt is None:
        return None
    ended = attempt.ended_ms is not None
    return {
        "state": "ended" if ended else "open",
        "episode": attempt.id,
        "outcome": attempt.outcome,
        "moves": attempt.moves,
        "coverage": attempt.discovered / _cells(terrain)
        if attempt.discovered is not None
        else None,
        "score": attempt.score,
        "unranked": _why_unranked(attempt, terrain) if ended else None,
    }


def streak(attempts: Sequence[Trial], today: str) -> int:
    """Return on how many days in a row a player came to the end of the daily terrain, up to today or to yesterday."""
    ended = (attempt for attempt in attempts if attempt.ended_ms is not None)
    played = {attempt.day for attempt in ended if attempt.outcome != "abandoned"}
    day = today if today in played else day_before(today)
    count = 0
    while day in played:
        count, day = count + 1, day_before(day)
    return count


def calendar(attempts: Sequence[Trial]) -> list[dict[str, object]]:
    """Return what a player's newest attempts came to, at most CALENDAR, the oldest first; `moves` is None without 99 %."""
    ended = [attempt for attempt in attempts if attempt.ended_ms is not None]
    return [
        {
            "day": attempt.day,
            "outcome": attempt.outcome,
            "moves": attempt.moves if attempt.outcome == "explored" else None,
        }
        for attempt in sorted(ended, key=_day)[-CALENDAR:]
    ]


def _day(attempt: Trial) -> str:
    return attempt.day or ""


def _why_unranked(attempt: Trial, terrain: DailyTerrain) -> str | None:
    if attempt.driver != "human":
        return "a move was a script's"
    if attempt.attestation not in ("attested", "supervised"):
        return "not every move could be matched with a key press or a touch of yours"
    if attempt.moves == 0:
        return "no move was made"
    if attempt.ended_ms is not None and attempt.ended_ms >= terrain.ends_ms:
        return "it ended after midnight UTC, when its day was over"
    return None


def _cells(terrain: DailyTerrain) -> int:
    """How many cells coverage refers to."""
    environment = environment_of(terrain.task)
    return environment.cells(drawn(environment, terrain.config, terrain.seed))


def _row(result: DayResult, cells: int, player_id: str | None) -> DayRow:
    return {
        "rank": 0,
        "outcome": result.outcome,
        "moves": result.steps if result.outcome == "explored" else None,
        "coverage": result.discovered / cells,
        "you": result.player_id == player_id,
        "episode": result.episode_id,
    }


def _order(row: DayRow) -> tuple[float, float]:
    """Return what rows are sorted by: moves to 99 %, then how little was mapped."""
    moves, mapped = row["moves"], row["coverage"]
    return (float("inf"), -mapped) if moves is None else (moves, 0.0)


class DailyPolicies:
    """Figures of the shipped policies among those on offer; `path` is the file that keeps them."""

    def __init__(
        self,
        path: Path,
        offers: Sequence[PolicyOffer],
        jobs: Jobs,
        task: str = DEFAULT_TASK,
    ) -> None:
        self._offers = [offer for offer in offers if offer.is_shipped]
        slow = {name: at for at, name in enumerate(_SLOW, 1)}
        self._offers.sort(key=lambda offer: slow.get(offer.name, 0))
        self._task = task
        self._evaluations = PolicyEvaluations(path, jobs, task=task)
        self._soon: asyncio.Task[None] | None = None

    def prepare(self, terrain: DailyTerrain) -> None:
        """Have the figures of a terrain made soon, so that they are there when somebody has finished it."""
        if self._soon is None or self._soon.done():
            self._soon = asyncio.create_task(self._later(terrain), name="daily policies")

    def results(self, terrain: DailyTerrain) -> list[PolicyResult]:
        """What each policy came to, the best first; what is missing is begun."""
        config, seeds = terrain.config, (terrain.seed,)
        offers = [offer for offer in self._offers if offer.plays(config)]
        wanted = [Evaluation(offer.source, config, seeds, self._task) for offer in offers]
        policies = [
            _described(offer.name, state)
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


def _described(name: str, state: FigureState) -> PolicyResult:
    figure = state["figure"]
    if figure is None:
        return {"name": name, "state": state["state"], "moves": None, "coverage": None}
    moves = round(figure["steps"]["mean"]) if figure["completed"] else None
    return {"name": name, "state": "ready", "moves": moves, "coverage": figure["curve"]["mean"][-1]}
