"""Answers about people and the names that they chose."""

from __future__ import annotations

from humanplay.web.answers.base import Answer, described


class Person(Answer):
    """Somebody on the people's board."""

    place: int
    name: str | None = described("null where none was chosen")
    behind: float = described("mean moves more than Expert")
    worse: float = described("the worse end of its 95 % interval, by which people are ranked")
    terrains: int = described("ranked ones that count")
    you: bool


class Challenger(Answer):
    """Somebody who succeeded on the terrain that a link challenged them to."""

    name: str | None = described("null where none was chosen")
    moves: int


class OwnName(Answer):
    """The name of whoever asks."""

    name: str | None
    hidden: bool = described("an operator has hidden it")


class OwnStanding(OwnName):
    """Where whoever asks stands on the people's board."""

    place: int | None = described("null below `fewest` terrains")
    behind: float | None = described("null before the first terrain")
    worse: float | None = described("null below `fewest` terrains")
    terrains: int
    missing: int = described("terrains before there is a place")


class People(Answer):
    """The people's board: the nearest to Expert first."""

    title: str = described("of the board's terrains")
    people: list[Person] = described("the first hundred")
    ranked: int = described("how many people have a place")
    comparing: int = described("terrains on which Expert has not driven yet")
    fewest: int = described("terrains from which on somebody has a place")
    most_behind: int = described(
        "moves that a terrain counts at most, and one that was not finished"
    )
    you: OwnStanding | None = described("null without a cookie")
