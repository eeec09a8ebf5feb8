"""Answers about people and the names that they chose."""

from __future__ import annotations

from humanplay.web.answers.base import Answer, shown


class Person(Answer):
    """Somebody who chose a name."""

    name: str
    gap: float = shown("moves more than Expert on terrains of the same configurations")
    episodes: int = shown("ranked ones that count")
    you: bool


class OwnName(Answer):
    """The name of whoever asks."""

    name: str | None
    hidden: bool = shown("an operator has hidden it")


class People(Answer):
    """People by their distance from Expert, the nearest first."""

    people: list[Person]
    you: OwnName | None = shown("null without a cookie")
