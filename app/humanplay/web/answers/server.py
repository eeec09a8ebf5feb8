"""Answers about the server and what it offers."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from humanplay.web.answers.base import Answer


class Alive(Answer):
    """The server answers."""

    status: Literal["ok"]


class Health(Answer):
    """How the server is."""

    status: Literal["ok", "failing"]
    detail: str | None = Field(default=None, description="why it is failing")
    getting_ready: str | None = Field(description="why a board takes longer than a moment at first")
    core_version: str = Field(description="what a recorded episode replays with")
    sessions: int = Field(description="in memory")
    database: str = Field(description="name of its file")


class Metric(Answer):
    """A figure of an ended episode."""

    name: str
    unit: str
    lowest: float | None = Field(description="null without a bound")
    highest: float | None = Field(description="null without a bound")
    is_better: Literal["higher", "lower"]


class Task(Answer):
    """What is played."""

    name: str
    title: str
    instructions: str = Field(description='what players are told; "" if the page says it')
    assets: str = Field(description="folder of `static/task` that draws it")
    actions: list[str] = Field(description="names, by their codes")
    keys: dict[str, list[str]] = Field(description="default keys of each action (`event.code`)")
    clock: int | None = Field(
        description="frames a second where time runs; null where each move is waited for"
    )
    metrics: list[Metric] = Field(description="the headline first")
    successes: list[str] = Field(description="outcomes that are successes")
    expert: str | None = Field(description="policy that moves are compared with; null without one")
    has_boards: bool = Field(description="whether it has a daily instance and a leaderboard")


class Level(Answer):
    """A level whose terrains are drawn from seeds."""

    name: str
    summary: str
    topology: int | None
    morphology: int | None
    pays_bonus: bool
    example: list[int] = Field(
        description="a terrain of 21x21: a number a row, whose bit 0 is what blocks column 0"
    )


class Map(Answer):
    """A map that the server was started with."""

    name: str
    summary: str
    size: tuple[int, int] = Field(description="rows and columns, cells")


class Offer(Answer):
    """A policy that can be watched or played against."""

    name: str
    summary: str
