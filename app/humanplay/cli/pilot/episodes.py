"""The episodes of a pilot that count.

They are played alone, on instances that the person had not chosen and not met before.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from humanplay.cli.pilot.errors import PilotError
from humanplay.db.checks import tasks
from humanplay.db.database import reading
from humanplay.db.names import own
from humanplay.db.playground import ExclusionCounts, left_out_plays, open_plays
from humanplay.db.reader import Reader
from humanplay.db.trial import LEFT, Trial

State = Literal["ended", "left", "failed", "open"]


@dataclass(frozen=True)
class PilotEpisode:
    """An episode that counts.

    person    whose
    score     None where it was not played to its end
    """

    person: str
    trial: Trial
    state: State
    score: float | None


@dataclass(frozen=True)
class Pilot:
    """What was played of a task.

    names     of people, by their ids
    left_out  ended episodes that do not count
    """

    episodes: list[PilotEpisode]
    names: dict[str, str]
    left_out: ExclusionCounts


def only_task(database: Path) -> str:
    """The task that a database has plays of; PilotError unless there is exactly one."""
    with reading(database) as conn:
        names = tasks(conn)
    if len(names) != 1:
        raise PilotError(
            f"expected plays of one environment in {database}, found {len(names)}: {', '.join(names) or 'none'}"
        )
    return names[0]


def read(database: Path, task: str) -> Pilot:
    """Read what was played of a task in a database; StoreError if it is none of ours."""
    with closing(Reader.open(database)) as reader, reader.snapshot():
        ended = [Trial.of(row) for row in reader.finished("human") if row["task"] == task]
        running = [trial for trial in open_plays(reader) if trial.task == task]
        episodes = [_counted(trial) for trial in [*ended, *running]]
        people = {episode.person for episode in episodes}
        names = {person: own(reader, person)["name"] or person[:8] for person in people}
        return Pilot(episodes, names, left_out_plays(reader, task))


def _counted(trial: Trial) -> PilotEpisode:
    assert trial.owner_id is not None
    state: State = "ended"
    if trial.outcome is None:
        state = "open"
    elif trial.outcome == "environment_failed":
        state = "failed"
    elif trial.outcome in LEFT or trial.attestation == "spoilt":
        state = "left"
    return PilotEpisode(trial.owner_id, trial, state, trial.score if state == "ended" else None)
