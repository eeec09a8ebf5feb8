"""Answers about the daily terrain."""

from __future__ import annotations

from typing import Literal

from humanplay.web.answers.base import Answer, absent, described


class Day(Answer):
    """The terrain of a day (UTC)."""

    day: str = described("like 2026-11-22")
    level: str
    size: tuple[int, int] | None = described("rows and columns, cells; null without a grid")
    protocol: str = described("canonical JSON for which the seed is drawn")
    commitment: str = described("SHA-256 of the day's key")
    key: str | None = described("null until the day is over")
    seed: int | None = described("null until the day is over")


class Attempt(Answer):
    """A player's attempt at a day's terrain."""

    state: Literal["open", "ended"]
    episode: str
    outcome: str | None
    moves: int = described("made so far")
    coverage: float | None = described("share of the cells, 0..1")
    score: float | None
    unranked: str | None = described("why an ended attempt has no rank")


class CalendarDay(Answer):
    """What an attempt came to."""

    day: str
    outcome: str
    moves: int | None = described("null without a success")


class Today(Day):
    """Today's terrain and your attempt at it."""

    now_ms: int = described("server time, milliseconds since 1970")
    next_ms: int = described("when the next day begins")
    max_steps: int
    attempt: Attempt | None
    players: int = described("people whose attempt of today is over and has a rank")
    streak: int = described("days in a row on which you came to the end")
    played: int = described("attempts that are over")
    calendar: list[CalendarDay] = described("your newest attempts, the oldest first")
    yesterday: Day | None


class Result(Answer):
    """A person's row of a day's table."""

    episode: str | None = absent("absent until the day is over")
    outcome: str
    moves: int | None = described("null without a success")
    coverage: float | None = described("share of the cells, 0..1; null where nothing is discovered")
    you: bool
    rank: int


class PeopleOfDay(Answer):
    """What people came to on a day's terrain."""

    players: int
    unfinished: int = described("without a success")
    moves: list[tuple[int, int]] = described("moves, and how many people needed as many")
    table: list[Result]
    you: Result | None


class PolicyOfDay(Answer):
    """What a policy came to on a day's terrain."""

    name: str
    state: Literal["ready", "waiting", "computing", "failed"]
    moves: int | None
    coverage: float | None


class Results(Answer):
    """People and policies on the terrain of a day."""

    day: str
    attempt: Attempt | None
    people: PeopleOfDay
    policies: list[PolicyOfDay] = described("the best first")
