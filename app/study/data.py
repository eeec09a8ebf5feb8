"""A study as the database holds it: its protocol, its people, their trials. What report, release and admin begin with.

Nothing here comes from the table of identities.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from app.storage.reader import Reader, config_of
from app.study.plausibility import pause_share, plausibility_labels
from app.study.protocol import Protocol, StudyError, checked
from marsexplorer.episode import Record
from marsexplorer.score import steps_to_target

Kind = Literal["human", "script"]
Phase = Literal["tutorial", "warm_up", "ranked"]


@dataclass(frozen=True)
class Person:
    """A participant, or a script that took part.

    script        what plays, for kind `script`
    joined_ms     milliseconds since 1970, as all times
    completed_ms  when the last ranked episode ended; None before
    settings      modality, palette, keys
    events        stage events: (at_ms, kind, detail), in order
    """

    id: str
    kind: Kind
    script: str | None
    stage: str
    joined_ms: int
    consent_version: str | None
    completed_ms: int | None
    settings: dict[str, Any]
    events: tuple[tuple[int, str, dict[str, Any]], ...] = field(default=(), repr=False)


@dataclass(frozen=True)
class StudyEpisode:
    """An episode of a study, finished or still running (`outcome` None, and no totals).

    kind         the participant's
    trial        0.. in the order played, within its phase
    terrain      index of its seed, within its phase
    driver       `human` when every move was a person's own key or touch
    steps_to_99  moves; `max_steps` for any ending but `explored`
    total        the return; discovered in cells
    pause_share  paused or out of sight, 0..1 of the time between first and last move
    labels       of `app.study.plausibility`
    """

    participant: str
    kind: Kind
    phase: Phase
    trial: int
    terrain: int
    episode: str
    driver: str
    outcome: str | None
    steps: int | None
    steps_to_99: int | None
    score: float | None
    total: float | None
    discovered: int | None
    started_ms: int
    ended_ms: int | None
    trajectory_hash: str | None
    seed: int | None = field(repr=False)
    config_hash: str = field(repr=False)
    core_version: str = field(repr=False)
    pause_share: float = 0.0
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class StudyData:
    """Everything figures are made from. `secret` is hex, known here once the study is closed."""

    protocol: Protocol
    protocol_hash: str
    commitment: str
    frozen_ms: int
    closed_ms: int | None
    secret: str | None = field(repr=False)
    people: tuple[Person, ...]
    trials: tuple[StudyEpisode, ...] = field(repr=False)

    def seeds(self) -> dict[int, int]:
        """Return the seeds of the ranked terrains that somebody has begun, by index; secret while the study is open."""
        return {each.terrain: each.seed for each in self.trials if each.phase == "ranked" and each.seed is not None}


def load(source: Reader | Path | str, study: str) -> StudyData:
    """Return a study's data as of one moment; StudyError when the database has no such study, StoreError when it is not ours.

    source  an open reader, or the path of a database
    """
    if isinstance(source, Reader):
        return _load(source, study)
    reader = Reader.open(source)
    try:
        with reader.snapshot():
            return _load(reader, study)
    finally:
        reader.close()


def records(reader: Reader, trials: Iterable[StudyEpisode]) -> Iterator[tuple[StudyEpisode, Record]]:
    """Yield each finished trial with its cause, ready to be replayed."""
    for trial in trials:
        if trial.ended_ms is not None:
            yield trial, reader.load_record(trial.episode)


def _load(reader: Reader, study: str) -> StudyData:
    found = reader.query("SELECT * FROM studies WHERE name = ?", [study])
    if not found:
        known = ", ".join(row["name"] for row in reader.query("SELECT name FROM studies ORDER BY name")) or "none"
        raise StudyError(f"nobody has joined a study {study!r} in {reader.path}; studies in it: {known}")
    row = found[0]
    people = _people(reader, study)
    kinds = {person.id: person.kind for person in people}
    return StudyData(
        checked(json.loads(row["protocol"])),
        row["protocol_hash"],
        row["commitment"],
        row["frozen_ms"],
        row["closed_ms"],
        row["secret"],
        people,
        _trials(reader, study, kinds),
    )


def _people(reader: Reader, study: str) -> tuple[Person, ...]:
    events = defaultdict(list)
    for row in reader.query(
        "SELECT v.* FROM stage_events v JOIN participants p ON p.id = v.participant_id WHERE p.study = ? ORDER BY number",
        [study],
    ):
        events[row["participant_id"]].append((row["at_ms"], row["kind"], json.loads(row["detail"])))
    names = ("id", "kind", "script", "stage", "joined_ms", "consent_version", "completed_ms")
    return tuple(
        Person(**{name: row[name] for name in names}, settings=json.loads(row["settings"]), events=tuple(events[row["id"]]))
        for row in reader.query("SELECT * FROM participants WHERE study = ? ORDER BY joined_ms, id", [study])
    )


def _trials(reader: Reader, study: str, kinds: dict[str, Kind]) -> tuple[StudyEpisode, ...]:
    rows = reader.query(
        """SELECT x.*, e.* FROM study_episodes x JOIN participants p ON p.id = x.participant_id
        JOIN episodes e ON e.id = x.episode_id WHERE p.study = ? ORDER BY e.started_ms, e.id""",
        [study],
    )
    return tuple(_with_input(reader, row, kinds[row["participant_id"]]) for row in rows)


def _with_input(reader: Reader, row: dict[str, Any], kind: Kind) -> StudyEpisode:
    """Return a trial, its input read and let go: a study's whole input may be larger than memory."""
    moves = reader.query("SELECT input, server_ms FROM steps WHERE episode_id = ? ORDER BY step", [row["id"]])
    inputs = reader.query("SELECT * FROM input_events WHERE episode_id = ? ORDER BY number", [row["id"]])
    return _trial(row, kind, moves, inputs)


def _trial(row: dict[str, Any], kind: Kind, moves: list[dict[str, Any]], inputs: list[dict[str, Any]]) -> StudyEpisode:
    ended = row["ended_ms"] is not None
    same = ("outcome", "steps", "score", "total", "discovered", "trajectory_hash", "seed", "config_hash", "core_version")
    return StudyEpisode(
        participant=row["participant_id"],
        kind=kind,
        phase=row["phase"],
        trial=row["trial"],
        terrain=row["terrain"],
        episode=row["episode_id"],
        driver=row["driver"],
        steps_to_99=steps_to_target(config_of(row), row["outcome"], row["steps"]) if ended else None,
        started_ms=row["started_ms"],
        ended_ms=row["ended_ms"],
        **{name: row[name] for name in same},
        pause_share=pause_share(moves, inputs),
        labels=plausibility_labels(moves, inputs),
    )
