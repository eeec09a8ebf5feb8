"""Answers about how well people and policies play.

They are the leaderboard's, and the volunteers' figures.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from humanplay.web.answers.base import Answer, Configuration, Interval


class MissingPlayers(Answer):
    """What a mean of volunteers still needs."""

    players: int = Field(description="who are missing")
    of: int = Field(description="players that a mean needs")
    episodes: int = Field(description="ranked episodes that each of them needs")


class PlayerCounts(Answer):
    """Players and their ranked episodes that count."""

    players: int
    episodes: int
    abandoned: int
    spoilt: int = Field(description="whose moves were not a person's own; they count as abandoned")


class Means(Answer):
    """Means over players, without intervals."""

    score: float
    steps: float = Field(description="moves of a success, the limit for any other ending")


class VolunteerFigure(PlayerCounts):
    """The figure of the volunteers on one configuration.

    `players` and the counts beside it are of all.
    """

    task: str
    level: str
    where: str = Field(description="the configuration in words")
    rows: int | None = Field(default=None, description="cells; absent without a grid of given size")
    cols: int | None = Field(default=None, description="cells; absent without a grid of given size")
    config_hash: str
    config: Configuration = Field(description="the environment's own configuration")
    population: Literal["volunteers"]
    entering: PlayerCounts = Field(
        description="who are in the means: those with enough ranked episodes"
    )
    missing: MissingPlayers | None = Field(description="null once there are means")
    as_played: Means | None = Field(
        description="with spoilt episodes as they were played; null without any"
    )
    score: Interval | None = Field(description="null while players are missing")
    steps: Interval | None = Field(description="moves; null while players are missing")
    completed: float | None = Field(description="share of the episodes that succeeded, 0..1")


class HumanLevel(Answer):
    """How well the volunteers of this playground play."""

    figures: list[VolunteerFigure] = Field(description="the most played configuration first")
    sentence: str = Field(description="the same in words")


class LeaderboardEntry(Answer):
    """What people and policies are compared on: a closed study, or a configuration."""

    id: str
    title: str
    study: str | None = Field(description="null for a configuration of the playground")
    place: str = Field(description="the configuration in words")
    max_steps: int
    config_hash: str
    terrains: int = Field(description="that policies play")
    players: int
    episodes: int
    missing: MissingPlayers | None = Field(description="null once there are means, and for a study")


class CoverageCurve(Answer):
    """Mean coverage after some numbers of moves, 0..1, with its 95 % interval."""

    steps: list[int] = Field(description="moves")
    mean: list[float]
    low: list[float] = Field(description="empty for a single player or terrain")
    high: list[float] = Field(description="empty for a single player or terrain")


class TrialFigure(Answer):
    """The means of everybody's first, second, ... episode."""

    trial: int = Field(description="from 1")
    players: int
    score: Interval
    steps: Interval = Field(description="moves")


class StudyFigure(Answer):
    """An estimate of people in a study."""

    players: int
    episodes: int
    score: Interval | None
    steps: Interval | None = Field(description="moves")


class LeaderboardPeople(Answer):
    """What people came to on an entry."""

    claim: str | None = Field(default=None, description="of a study: what its figure may be called")
    set: str | None = Field(default=None, description="of a study: whom its estimate is of")
    everybody: StudyFigure | None = Field(
        default=None, description="of a study: everybody who began"
    )
    abandoned: int | None = Field(default=None, description="of the playground")
    spoilt: int | None = Field(default=None, description="of the playground")
    players: int
    episodes: int
    score: Interval
    steps: Interval = Field(description="moves")
    completed: float = Field(description="share of the episodes that succeeded, 0..1")
    curve: CoverageCurve | None
    visits: list[list[float]] | None = Field(
        description="visits of each cell in a mean episode, by rows"
    )
    trials: list[TrialFigure]


class PolicyFigure(Answer):
    """What a policy came to on the terrains of an entry."""

    groups: int = Field(description="terrains")
    episodes: int
    score: Interval
    steps: Interval = Field(description="moves")
    completed: float = Field(description="share of the episodes that succeeded, 0..1")
    curve: CoverageCurve | None = Field(
        default=None, description="absent where nothing is discovered"
    )
    visits: list[list[float]] | None = Field(
        default=None,
        description="visits of each cell in a mean episode, by rows; absent without a grid",
    )


class Shipped(Answer):
    """Where a figure comes from that came with the package."""

    command: str = Field(description="that made it")


class LeaderboardPolicy(Answer):
    """A policy on an entry, with its figure once it is evaluated."""

    name: str
    summary: str
    state: Literal["ready", "missing", "waiting", "computing", "failed"]
    done: int = Field(description="episodes played")
    of: int = Field(description="episodes in all")
    figure: PolicyFigure | None
    shipped: Shipped | None = Field(description="null for a figure that was made here")
    error: str | None = Field(description="why it failed")


class Leaderboard(Answer):
    """People and policies on one entry."""

    board: LeaderboardEntry
    people: LeaderboardPeople | None = Field(description="null without a mean of people")
    policies: list[LeaderboardPolicy]
