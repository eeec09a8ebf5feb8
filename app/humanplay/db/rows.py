"""The rows of moves, input events and people, as they are read."""

from __future__ import annotations

from typing import Literal, NamedTuple, TypedDict

Input = Literal["key", "touch"]
Phase = Literal["tutorial", "warm_up", "ranked"]
Attestation = Literal["unattested", "spoilt", "attested", "supervised"]
"""Lowest first.

unattested  the first move has no input event of its own that fits it, or its presses are a copy
spoilt      the first move has one, and a later one does not: it counts as abandoned
            (`Trial.forfeited`)
attested    every move fits an input event of its own
supervised  attested, and the operator had typed their code shortly before
"""
AskedBy = Literal["participant", "operator", "review board"]
"""Who asked for an erasure."""


class MoveTime(TypedDict):
    """When the server made a move (ms since 1970), by what, and what it discovered."""

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


class EpisodeRow(TypedDict):
    """A row of the table `episodes`.

    While it runs, the columns from `ended_ms` on are None.
    """

    id: str
    session_id: str
    number: int
    driver: str
    attestation: Attestation | None
    attestation_reason: str | None
    assisted: int
    seed_chosen: int
    terrain_met_before: int
    task: str
    config: str
    level: str
    config_hash: str
    seed: int | None
    start_row: int
    start_col: int
    terrain: bytes
    terrain_hash: str
    policy_seed: int
    core_version: str
    started_ms: int
    ended_ms: int | None
    outcome: str | None
    failure: str | None
    steps: int | None
    discovered: int | None
    total: float | None
    score: float | None
    trajectory_hash: str | None


class PlacedEpisode(EpisodeRow):
    """An episode with its place in a series, its player, and whose page it ran on."""

    series: str
    phase: Phase
    trial: int
    terrain_index: int
    player_id: str | None
    owner_id: str | None


class CountedEpisode(EpisodeRow):
    """A finished episode, its page's owner and its series.

    Attributes:
        counts: Whether it counts for the volunteers' estimate.
    """

    owner_id: str | None
    series: str | None
    counts: int


class EndedEpisode(EpisodeRow):
    """An episode that has ended, with what moves its session."""

    control: str | None


class FailureRow(TypedDict):
    """What an environment raised; no seed, time or step while a study is open."""

    episode: str
    ended_ms: int | None
    seed: int | None
    report: str


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
    language: str


class StageEvent(NamedTuple):
    """Something that happened to a participant; `detail` depends on the kind."""

    at_ms: int
    kind: str
    detail: dict[str, object]


class ErasedPerson(TypedDict):
    """What is noted of a person whose rows were erased from a study.

    Attributes:
        stage: Where they were.
        after_closing: Whether the study was closed by then.
        ranked_begun, ranked_ended: Numbers of ranked episodes.
        completed: Whether they had ended the study.
        asked_by: Who asked for it, if that was said.
        arm: To which they were assigned; None if to none.
        arm_number: Their number among the people assigned to arms, from 0. No release has it.
    """

    at_ms: int
    stage: str
    after_closing: bool
    ranked_begun: int
    ranked_ended: int
    completed: bool
    asked_by: AskedBy | None
    arm: str | None
    arm_number: int | None


class NotedArrivals(TypedDict, total=False):
    """Counts of people whom a release left out (`humanplay.study.flow.Arrivals`)."""

    declined: int
    undecided: int
    unfit: int
    over_quota: int
    dry_runs: int
    dry_run_people: int
    issued: int | None
    revoked: int | None
    unopened: int | None
