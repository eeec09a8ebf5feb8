"""Answers about the server and what it offers."""

from __future__ import annotations

from typing import Literal

from humanplay.web.answers.base import Answer, absent, described


class Alive(Answer):
    """The server answers."""

    status: Literal["ok"]


class Health(Answer):
    """How the server is."""

    status: Literal["ok", "failing"]
    detail: str | None = absent("why it is failing")
    getting_ready: str | None = described("why a board takes longer than a moment at first")
    core_version: str = described("what a recorded episode replays with")
    sessions: int = described("in memory")
    database: str = described("name of its file")


class Metric(Answer):
    """A figure of an ended episode."""

    name: str
    unit: str
    lowest: float | None = described("null without a bound")
    highest: float | None = described("null without a bound")
    is_better: Literal["higher", "lower"]


class Task(Answer):
    """What is played."""

    name: str
    title: str
    instructions: str = described('what players are told; "" if the page says it')
    assets: str = described("folder of `static/task` that draws it")
    actions: list[str] = described("names, by their codes")
    keys: dict[str, list[str]] = described("default keys of each action (`event.code`)")
    clock: int | None = described(
        "frames a second where time runs; null where each move is waited for"
    )
    metrics: list[Metric] = described("the headline first")
    successes: list[str] = described("outcomes that are successes")
    expert: str | None = described("policy that moves are compared with; null without one")
    has_boards: bool = described("whether it has a daily instance and a leaderboard")


class Level(Answer):
    """A level whose terrains are drawn from seeds."""

    name: str
    summary: str
    topology: int | None
    morphology: int | None
    pays_bonus: bool
    example: list[int] = described(
        "a terrain of 21x21: a number a row, whose bit 0 is what blocks column 0"
    )


class Map(Answer):
    """A map that the server was started with."""

    name: str
    summary: str
    size: tuple[int, int] = described("rows and columns, cells")


class Offer(Answer):
    """A policy that can be watched or played against."""

    name: str
    summary: str
