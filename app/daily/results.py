"""People's results on a daily terrain: ranks, the distribution of moves, and a player's place and streak.

Only attempts whose every move is attested as a person's own key or touch, and that ended before their day did, have a rank.
Those who came to 99 % stand first, the fewest moves first; the others follow by how much they had mapped.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from app.play.daily_terrain import cells_of_daily, day_before, day_start_ms
from app.storage.playground import DailyAttempt, DailyTerrain, results
from app.storage.reader import Reader
from app.storage.store import DAY_MS

SHOWN = 10
"""Rows of the table of results."""


def day_end_ms(day: str) -> int:
    """Return when a day is over (UTC), in milliseconds since 1970."""
    return day_start_ms(day) + DAY_MS


def people_on(
    reader: Reader, terrain: DailyTerrain, player_id: str | None, names_episodes: bool
) -> dict[str, Any]:
    """Return what people came to on a terrain; no player is named.

    names_episodes  True once the day is over: the rows of the table then say which episode they are

    `moves` is the distribution, [moves, how many people] of those who came to 99 %; `unfinished` counts the others. `you` is
    the player's own row, None where they have none.
    """
    cells, ended = (
        cells_of_daily(terrain),
        results(reader, terrain.commitment, day_end_ms(terrain.day)),
    )
    found = [_row(each, cells, player_id) for each in ended]
    found.sort(key=_order)
    for number, row in enumerate(found):
        before = found[number - 1] if number else None
        row["rank"] = (
            before["rank"] if before is not None and _order(before) == _order(row) else number + 1
        )
        if not names_episodes:
            del row["episode"]
    counts = Counter(row["moves"] for row in found if row["moves"] is not None)
    return {
        "players": len(found),
        "unfinished": sum(row["moves"] is None for row in found),
        "moves": [[moves, counts[moves]] for moves in sorted(counts)],
        "table": found[:SHOWN],
        "you": next((row for row in found if row["you"]), None),
    }


def describe_attempt(attempt: DailyAttempt | None, terrain: DailyTerrain) -> dict[str, Any] | None:
    """Return a player's attempt for their own page; None before it. `unranked` says why an ended one has no rank."""
    if attempt is None:
        return None
    ended = attempt.ended_ms is not None
    return {
        "state": "ended" if ended else "open",
        "episode": attempt.episode_id,
        "outcome": attempt.outcome,
        "moves": attempt.moves,
        "coverage": attempt.discovered / cells_of_daily(terrain)
        if attempt.discovered is not None
        else None,
        "score": attempt.score,
        "unranked": _why_unranked(attempt) if ended else None,
    }


def streak(attempts: Sequence[DailyAttempt], today: str) -> int:
    """Return on how many days in a row a player came to the end of the daily terrain, up to today or to yesterday."""
    played = {
        each.day for each in attempts if each.ended_ms is not None and each.outcome != "abandoned"
    }
    day = today if today in played else day_before(today)
    count = 0
    while day in played:
        count, day = count + 1, day_before(day)
    return count


def _why_unranked(attempt: DailyAttempt) -> str | None:
    if attempt.driver != "human":
        return "a move was a script's"
    if attempt.attestation not in ("attested", "supervised"):
        return "not every move could be matched with a key press or a touch of yours"
    if attempt.moves == 0:
        return "no move was made"
    if attempt.ended_ms is not None and attempt.ended_ms >= day_end_ms(attempt.day):
        return "it ended after midnight UTC, when its day was over"
    return None


def _row(row: dict[str, Any], cells: int, player_id: str | None) -> dict[str, Any]:
    return {
        "episode": row["episode_id"],
        "outcome": row["outcome"],
        "moves": row["steps"] if row["outcome"] == "explored" else None,
        "coverage": row["discovered"] / cells,
        "you": row["player_id"] == player_id,
    }


def _order(row: dict[str, Any]) -> tuple[float, float]:
    """Return what rows are sorted by: moves to 99 %, then how little was mapped."""
    return (
        float("inf") if row["moves"] is None else row["moves"],
        -row["coverage"] if row["moves"] is None else 0.0,
    )
