"""Answers about people and the names that they chose."""

from __future__ import annotations

from pydantic import Field

from humanplay.web.answers.base import Answer


class Person(Answer):
    """Somebody on the people's board."""

    place: int
    name: str | None = Field(description="null where none was chosen")
    behind: float = Field(description="mean moves more than Expert")
    worse: float = Field(
        description="the worse end of its 95 % interval, by which people are ranked"
    )
    terrains: int = Field(description="ranked ones that count")
    you: bool


class Challenger(Answer):
    """Somebody who succeeded on the terrain that a link challenged them to."""

    name: str | None = Field(description="null where none was chosen")
    moves: int


class OwnName(Answer):
    """The name of whoever asks."""

    name: str | None
    hidden: bool = Field(description="an operator has hidden it")


class OwnStanding(OwnName):
    """Where whoever asks stands on the people's board."""

    place: int | None = Field(description="null below `fewest` terrains")
    behind: float | None = Field(description="null before the first terrain")
    worse: float | None = Field(description="null below `fewest` terrains")
    terrains: int
    missing: int = Field(description="terrains before there is a place")
    comparing: int = Field(description="yours on which Expert has not driven yet")


class People(Answer):
    """The people's board: the nearest to Expert first."""

    title: str = Field(description="of the board's terrains")
    people: list[Person] = Field(description="the first hundred")
    ranked: int = Field(description="how many people have a place")
    comparing: int = Field(description="terrains on which Expert has not driven yet")
    fewest: int = Field(description="terrains from which on somebody has a place")
    most_behind: int = Field(
        description="moves that a terrain counts at most, and one that was not finished"
    )
    you: OwnStanding | None = Field(description="null without a cookie")
