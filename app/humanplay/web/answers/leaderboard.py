"""Answers about how well people and policies play.

They are the leaderboard's, and the volunteers' figures.
"""

from __future__ import annotations

from typing import Literal

from humanplay.web.answers.base import Answer, Configuration, Interval, absent, described


class MissingPlayers(Answer):
    """What a mean of volunteers still needs."""

    players: int = described("who are missing")
    of: int = described("players that a mean needs")
    episodes: int = described("ranked episodes that each of them needs")


class PlayerCounts(Answer):
    """Players and their ranked episodes that count."""

    players: int
    episodes: int
    abandoned: int
    spoilt: int = described("whose moves were not a person's own; they count as abandoned")


class Means(Answer):
    """Means over players, without intervals."""

    score: float
    steps: float = described("moves of a success, the limit for any other ending")


class VolunteerFigure(PlayerCounts):
    """The figure of the volunteers on one configuration.

    `players` and the counts beside it are of all.
    """

    task: str
    level: str
    where: str = described("the configuration in words")
    rows: int | None = absent("cells; absent without a grid of given size")
    cols: int | None = absent("cells; absent without a grid of given size")
    config_hash: str
    config: Configuration = described("the environment's own configuration")
    population: Literal["volunteers"]
    entering: PlayerCounts = described("who are in the means: those with enough ranked episodes")
    missing: MissingPlayers | None = described("null once there are means")
    as_played: Means | None = described(
        "with spoilt episodes as they were played; null without any"
    )
    score: Interval | None = described("null while players are missing")
    steps: Interval | None = described("moves; null while players are missing")
    completed: float | None = described("share of the episodes that succeeded, 0..1")


class HumanLevel(Answer):
    """How well the volunteers of this playground play."""

    figures: list[VolunteerFigure] = described("the most played configuration first")
    sentence: str = described("the same in words")


class LeaderboardEntry(Answer):
    """What people and policies are compared on: a closed study, or a configuration."""

    id: str
    title: str
    study: str | None = described("null for a configuration of the playground")
    place: str = described("the configuration in words")
    max_steps: int
    config_hash: str
    terrains: int = described("that policies play")
    players: int
    episodes: int
    missing: MissingPlayers | None = described("null once there are means, and for a study")


class CoverageCurve(Answer):
    """Mean coverage after some numbers of moves, 0..1, with its 95 % interval."""

    steps: list[int] = described("moves")
    mean: list[float]
    low: list[float] = described("empty for a single player or terrain")
    high: list[float] = described("empty for a single player or terrain")


class TrialFigure(Answer):
    """The means of everybody's first, second, ... episode."""

    trial: int = described("from 1")
    players: int
    score: Interval
    steps: Interval = described("moves")


class StudyFigure(Answer):
    """An estimate of people in a study."""

    players: int
    episodes: int
    score: Interval | None
    steps: Interval | None = described("moves")


class LeaderboardPeople(Answer):
    """What people came to on an entry."""

    claim: str | None = absent("of a study: what its figure may be called")
    set: str | None = absent("of a study: whom its estimate is of")
    everybody: StudyFigure | None = absent("of a study: everybody who began")
    abandoned: int | None = absent("of the playground")
    spoilt: int | None = absent("of the playground")
    players: int
    episodes: int
    score: Interval
    steps: Interval = described("moves")
    completed: float = described("share of the episodes that succeeded, 0..1")
    curve: CoverageCurve | None
    visits: list[list[float]] | None = described("visits of each cell in a mean episode, by rows")
    trials: list[TrialFigure]


class PolicyFigure(Answer):
    """What a policy came to on the terrains of an entry."""

    groups: int = described("terrains")
    episodes: int
    score: Interval
    steps: Interval = described("moves")
    completed: float = described("share of the episodes that succeeded, 0..1")
    curve: CoverageCurve | None = absent("absent where nothing is discovered")
    visits: list[list[float]] | None = absent(
        "visits of each cell in a mean episode, by rows; absent without a grid"
    )


class Shipped(Answer):
    """Where a figure comes from that came with the package."""

    command: str = described("that made it")


class LeaderboardPolicy(Answer):
    """A policy on an entry, with its figure once it is evaluated."""

    name: str
    summary: str
    state: Literal["ready", "missing", "waiting", "computing", "failed"]
    done: int = described("episodes played")
    of: int = described("episodes in all")
    figure: PolicyFigure | None
    shipped: Shipped | None = described("null for a figure that was made here")
    error: str | None = described("why it failed")


class Leaderboard(Answer):
    """People and policies on one entry."""

    board: LeaderboardEntry
    people: LeaderboardPeople | None = described("null without a mean of people")
    policies: list[LeaderboardPolicy]
