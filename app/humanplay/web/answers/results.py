"""Answers about episodes that have ended, and whoever looks on while they run."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from humanplay.db.rows import Attestation
from humanplay.web.answers.base import Answer, Configuration, Frame, History, file_of
from humanplay.web.answers.server import Task


class Move(Answer):
    """A move of an ended episode.

    Client times are of the page's own clock, in milliseconds.
    """

    action: str
    step: int = Field(description="moves made before it")
    reward: float
    discovered: int
    server_ms: int = Field(description="server time, milliseconds since 1970")
    client_ms: float | None
    key_down_ms: float | None
    key_up_ms: float | None
    input: Literal["key", "touch"] | None
    driver: str = Field(description="human, script or policy:NAME")


class ListedEpisode(Answer):
    """An ended episode; docs/data.md says more of each field."""

    episode: str
    task: str
    level: str
    rows: int | None = Field(default=None, description="cells; absent without a grid of given size")
    cols: int | None = Field(default=None, description="cells; absent without a grid of given size")
    config: Configuration = Field(description="the environment's own configuration")
    daily: str | None = Field(description="the day whose terrain it was")
    start: tuple[int, int] = Field(description="row and column")
    seed: int | None = Field(description="null for a given terrain")
    driver: str = Field(description="human, script or policy:NAME")
    assisted: bool = Field(description="a policy played the same terrain on a second board")
    seed_chosen: bool
    terrain_met_before: bool
    counts: bool = Field(description="for the volunteers' figure")
    config_hash: str
    core_version: str
    started_ms: int = Field(description="server time, milliseconds since 1970")
    ended_ms: int = Field(description="server time, milliseconds since 1970")
    outcome: str
    steps: int
    discovered: int
    score: float | None
    attestation: Attestation | None
    attestation_reason: str | None
    coverage: float | None = Field(description="share of the cells, 0..1")
    steps_to_target: int | None = Field(
        description="moves of a success, the limit for any other ending"
    )
    trajectory_hash: str
    return_: float = Field(alias="return", description="sum of the rewards")
    actions: list[str]


class Episode(ListedEpisode):
    """An ended episode with its moves."""

    moves: list[Move]


class OwnEpisode(Answer):
    """An ended episode of your own."""

    episode: str
    kind: Literal["daily", "ranked", "practice"]
    counts: bool = Field(description="whether it enters the volunteers' figures")
    day: str | None = Field(description="the day whose terrain it was")
    place: str = Field(description="where it was played, in words")
    outcome: str
    moves: int
    coverage: float | None = Field(description="share of the cells, 0..1")
    score: float | None
    ended_ms: int = Field(description="server time, milliseconds since 1970")
    not_attested: str | None = Field(description="why it is not attested")
    met_before: bool = Field(description="whether the terrain was known from an earlier episode")
    expert_moves: int | None = Field(
        description="Expert's on the same terrain, of ranked ones of the people's board that it finishes"
    )


class Standing(Answer):
    """Your ranked episodes among the volunteers'."""

    means: list[float] = Field(
        description="mean moves of the volunteers with enough episodes, sorted"
    )
    you: float | None = Field(description="your own mean; null while episodes are missing")
    ranked: int = Field(description="your ranked episodes that count")
    missing: int = Field(description="how many more you need for a place")


class Best(Answer):
    """Your best on a configuration."""

    place: str = Field(description="the configuration in words")
    max_steps: int
    episodes: int
    successes: int
    best: OwnEpisode | None = Field(description="the fewest moves on a terrain that was new to you")
    people: Standing


class OwnHistory(Answer):
    """What you have driven."""

    comparing: int = Field(
        description="of these episodes, on whose terrains Expert has yet to drive"
    )
    total: int
    episodes: list[OwnEpisode] = Field(description="the newest first")
    bests: list[Best] = Field(description="the most played configuration first")


class Watched(Answer):
    """An episode that anybody with its link can watch."""

    episode: str
    player: str = Field(description='"you", "human", "script", or a policy')
    task: Task
    level: str
    size: int | tuple[int, int] | None = Field(
        description="cells: one number for a square, or rows and columns"
    )
    frame: Frame
    history: History
    frames: list[Frame] | None = Field(description="every frame, once it has ended")


CSV = file_of("text/csv", meaning="a table")
ZIP = file_of("application/zip", meaning="two tables and their datasheet")
