"""Answers about the daily terrain."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from humanplay.web.answers.base import Answer


class Day(Answer):
    """The terrain of a day (UTC)."""

    day: str = Field(description="like 2026-11-22")
    level: str
    size: tuple[int, int] | None = Field(description="rows and columns, cells; null without a grid")
    protocol: str = Field(description="canonical JSON for which the seed is drawn")
    commitment: str = Field(description="SHA-256 of the day's key")
    key: str | None = Field(description="null until the day is over")
    seed: int | None = Field(description="null until the day is over")
    older: str | None = Field(description="the nearest day before it with a terrain")
    newer: str | None = Field(description="the nearest day after it with a terrain, up to today")


class Attempt(Answer):
    """A player's attempt at a day's terrain."""

    state: Literal["open", "ended"]
    episode: str
    outcome: str | None
    moves: int = Field(description="made so far")
    coverage: float | None = Field(description="share of the cells, 0..1")
    score: float | None
    unranked: str | None = Field(description="why an ended attempt has no rank")


class CalendarDay(Answer):
    """What an attempt came to."""

    day: str
    outcome: str
    moves: int | None = Field(description="null without a success")


class Today(Day):
    """Today's terrain and your attempt at it."""

    now_ms: int = Field(description="server time, milliseconds since 1970")
    next_ms: int = Field(description="when the next day begins")
    max_steps: int
    attempt: Attempt | None
    players: int = Field(description="people whose attempt of today is over and has a rank")
    streak: int = Field(description="days in a row on which you came to the end")
    played: int = Field(description="attempts that are over")
    calendar: list[CalendarDay] = Field(description="your newest attempts, the oldest first")
    yesterday: Day | None


class Result(Answer):
    """A person's row of a day's table."""

    episode: str | None = Field(default=None, description="absent until the day is over")
    outcome: str
    moves: int | None = Field(description="null without a success")
    coverage: float | None = Field(
        description="share of the cells, 0..1; null where nothing is discovered"
    )
    you: bool
    rank: int


class PeopleOfDay(Answer):
    """What people came to on a day's terrain."""

    players: int
    unfinished: int = Field(description="without a success")
    moves: list[tuple[int, int]] = Field(description="moves, and how many people needed as many")
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
    policies: list[PolicyOfDay] = Field(description="the best first")
