"""Answers about people and the names that they chose."""

from __future__ import annotations

from humanplay.web.answers.base import Answer, described


class Person(Answer):
    """Somebody who chose a name."""

    name: str
    gap: float = described("moves more than Expert on terrains of the same configurations")
    episodes: int = described("ranked ones that count")
    you: bool


class OwnName(Answer):
    """The name of whoever asks."""

    name: str | None
    hidden: bool = described("an operator has hidden it")


class People(Answer):
    """People by their distance from Expert, the nearest first."""

    people: list[Person]
    you: OwnName | None = described("null without a cookie")
