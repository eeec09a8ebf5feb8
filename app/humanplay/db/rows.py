"""The rows of an episode's moves and input events, and what is noted of people, as they are read."""

from __future__ import annotations

from typing import Literal, NamedTuple, TypedDict

Input = Literal["key", "touch"]
AskedBy = Literal["participant", "operator", "review board"]
"""Who asked for an erasure."""


class MoveTime(TypedDict):
    """When the server made a move (ms since 1970), by what, and what was discovered then."""

    input: Input | None
    server_ms: int
    discovered: int


class MoveRow(MoveTime):
    """A row of the table `steps`."""

    episode_id: str
    step: int
    action: int
    reward: float
    client_ms: float | None
    key_down_ms: float | None
    key_up_ms: float | None
    driver: str


class EventRow(TypedDict):
    """A row of the table `input_events`; `repeat` and `trusted` are 0 or 1."""

    episode_id: str
    number: int
    tab: int
    page_load: int
    kind: str
    code: str | None
    repeat: int | None
    trusted: int | None
    client_ms: float
    step: int | None
    round_trip_ms: float | None
    server_ms: int


class PlayerSettings(TypedDict, total=False):
    """What a participant has chosen; `keys` are codes by action."""

    modality: str
    palette: str
    keys: dict[str, list[str]]


class StageEvent(NamedTuple):
    """Something that happened to a participant; `detail` depends on the kind."""

    at_ms: int
    kind: str
    detail: dict[str, object]


class ErasedPerson(TypedDict):
    """What is noted of a person whose rows were erased from a study.

    stage         where they were
    after_closing whether the study was closed by then
    ranked_begun, ranked_ended  ranked episodes
    completed     whether they had ended the study
    asked_by      who asked for it, if that was said
    """

    at_ms: int
    stage: str
    after_closing: bool
    ranked_begun: int
    ranked_ended: int
    completed: bool
    asked_by: AskedBy | None


class NotedArrivals(TypedDict, total=False):
    """Counts of people whom a release left out (`humanplay.study.flow.Arrivals`)."""

    declined: int
    undecided: int
    issued: int | None
    revoked: int | None
    unopened: int | None
