"""Answers about the server and what it offers."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from humanplay.web.answers.base import Answer, shown


class Alive(Answer):
    """The server answers."""

    status: Literal["ok"]


class Health(Answer):
    """How the server is."""

    status: Literal["ok", "failing"]
    detail: str | None = Field(default=None, description="why it is failing")
    getting_ready: str | None = shown("why a board takes longer than a moment at first")
    core_version: str = shown("what a recorded episode replays with")
    sessions: int = shown("in memory")
    database: str = shown("name of its file")


class Metric(Answer):
    """A figure of an ended episode."""

    name: str
    unit: str
    lowest: float | None = shown("null without a bound")
    highest: float | None = shown("null without a bound")
    is_better: Literal["higher", "lower"]


class Task(Answer):
    """What is played."""

    name: str
    title: str
    instructions: str = shown('what players are told; "" if the page says it')
    assets: str = shown("folder of `static/task` that draws it")
    actions: list[str] = shown("names, by their codes")
    keys: dict[str, list[str]] = shown("default keys of each action (`event.code`)")
    clock: int | None = shown("frames a second where time runs; null where each move is waited for")
    metrics: list[Metric] = shown("the headline first")


class Level(Answer):
    """A level whose terrains are drawn from seeds."""

    name: str
    summary: str
    topology: int | None
    morphology: int | None
    pays_bonus: bool
    example: list[int] = shown(
        "a terrain of 21x21: a number a row, whose bit 0 is a rock in column 0"
    )


class Map(Answer):
    """A map that the server was started with."""

    name: str
    summary: str
    size: list[int] = shown("rows and columns, cells")


class Offer(Answer):
    """A policy that can be watched or played against."""

    name: str
    summary: str
