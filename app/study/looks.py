"""What may be seen of an open study's figures: nothing before a planned look, then exactly what the look is at, until the next.

A figure that moves while people play tempts to stop where it pleases: looking after each player misses the truth in 10 to 22 %
of studies instead of 5 % (docs/study.md). So a study whose protocol hides its figures shows none while it is open. A study with
planned looks shows, once so many people have finished, the figure of exactly the first so many, at a level that
`app.statistics.sequential` adjusts for all looks. A look outside the plan is an explicit act that is logged with its reason.
Scripts are no people: theirs are always shown.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path

from app.study.data import LookTaken, StudyData, StudyEpisode, View
from app.study.folder import Folder
from app.study.protocol import StudyError
from marsexplorer.files import write_whole

LOOKS_FILE = "looks.json"
"""In the study's folder: the looks that were taken, in the order of time."""

SHORTEST_REASON = 10
"""Characters of the reason for a look outside the plan."""


def finishers(data: StudyData) -> list[str]:
    """Return the ids of the people who ended every ranked episode, the first first."""
    people = [person for person in data.people if person.kind == "human"]
    done = [
        (person.completed_ms, person.id) for person in people if person.completed_ms is not None
    ]
    return [ident for _, ident in sorted(done)]


def present(data: StudyData) -> StudyData:
    """Return the data with what may not be seen yet taken out: episodes of those people look as if they were still running."""
    if data.view is not None:
        return data
    view, finished = _view(data), finishers(data)
    if view.kind == "whole":
        return replace(data, view=view)
    if view.kind == "hidden":
        kept: set[str] = set()
    elif data.closed_ms is None:
        kept = set(finished[: view.players])
    else:  # closed: those who finished after the last look are in no figure, those who left are in the set of all
        kept = {person.id for person in data.people} - set(finished[view.players :])
    hidden = {person.id for person in data.people if person.kind == "human"} - kept
    trials = tuple(
        _as_running(trial) if trial.participant in hidden else trial for trial in data.trials
    )
    return replace(data, trials=trials, view=view)


def _view(data: StudyData) -> View:
    """Return what may be seen of a study at this moment."""
    protocol, finished = data.protocol, len(finishers(data))
    is_open = data.closed_ms is None
    if not protocol.hides_interim or (not is_open and not protocol.looks):
        return View("whole", finished)
    later = next((look for look in protocol.looks if look > finished), None) if is_open else None
    reached = [look for look in protocol.looks if look <= finished]
    if not is_open:
        at = min(finished, protocol.players)
        reached = [*(look for look in reached if look < at), *([at] if at else [])]
    if not reached:
        return View("hidden" if is_open else "whole", finished, next_look=later)
    fractions = tuple(look / protocol.players for look in reached)
    return View("look", finished, players=reached[-1], fractions=fractions, next_look=later)


def _as_running(trial: StudyEpisode) -> StudyEpisode:
    """Return an episode without anything that its end would tell."""
    if trial.phase == "tutorial":
        return trial
    return replace(
        trial,
        outcome=None,
        steps=None,
        steps_to_99=None,
        score=None,
        total=None,
        discovered=None,
        ended_ms=None,
        trajectory_hash=None,
        pause_share=0.0,
        labels=(),
    )


def emergency_view(data: StudyData) -> StudyData:
    """Return the data of an open study as if it hid nothing; StudyError where there is nothing hidden."""
    if data.closed_ms is not None or not data.protocol.hides_interim:
        raise StudyError(
            f"the study {data.protocol.name!r} hides no figure "
            f"({'it is closed' if data.closed_ms is not None else 'its protocol shows figures at any time'}): "
            "look without an emergency"
        )
    return replace(data, view=View("emergency", len(finishers(data))))


def take_look(folder: Folder, data: StudyData, reason: str | None = None) -> StudyData:
    """Return what may be seen of a study's people and log a look that shows something; nothing is shown that is not logged.

    reason  of a look outside the plan, which shows everything; StudyError where there is nothing hidden or no reason
    """
    if reason is not None:
        shown = emergency_view(data)
        return replace(shown, looks=(*shown.looks, note_emergency_look(folder, data, reason)))
    shown = present(data)
    note_planned_look(folder, shown)
    return shown


def view_sentence(data: StudyData) -> str:
    """Return what is shown, and when more will be; "" where nothing is hidden."""
    view, protocol = data.view, data.protocol
    if view is None or view.kind == "whole":
        return ""
    if view.kind == "emergency":
        return f"EMERGENCY LOOK, outside the plan, when {view.finished} of {protocol.players} players had finished."
    if view.kind == "hidden":
        until = (
            f"{view.next_look} players have finished, the first planned look"
            if protocol.looks
            else "the study is closed"
        )
        return f"No figure is shown until {until}: {view.finished} of {protocol.players} have finished."
    numbers = f"look {len(view.fractions)} of {max(len(protocol.looks), len(view.fractions))}"
    who = f"the first {view.players} of {protocol.players} players who finished"
    if data.closed_ms is not None:
        return f"Final analysis, {numbers}, of {who}."
    later = (
        f"; it does not change until {view.next_look} have finished"
        if view.next_look
        else "; it was the last planned look"
    )
    return f"Planned {numbers}, at {who}{later}."


def read_looks(path: Path) -> tuple[LookTaken, ...]:
    """Return the looks in a file of looks, none where there is no file; StudyError when it is damaged."""
    try:
        return tuple(LookTaken(**each) for each in json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return ()
    except (OSError, ValueError, TypeError) as error:
        raise StudyError(f"{path} cannot be read: {error}; restore it from a backup") from error


def with_looks_in(path: Path, data: StudyData) -> StudyData:
    """Return a study's data with the looks in a file beside those that its database knows; StudyError as `read_looks`."""
    return replace(data, looks=joined_looks(data.looks, read_looks(path)))


def joined_looks(*lists: Sequence[LookTaken]) -> tuple[LookTaken, ...]:
    """Return every look once, in the order of time."""
    return tuple(
        sorted(
            {look for looks in lists for look in looks}, key=lambda look: (look.at, look.finished)
        )
    )


def note_planned_look(folder: Folder, data: StudyData) -> None:
    """Log that the look which is shown was taken, once; nothing for a closed study or where no look is shown."""
    view, name = data.view, data.protocol.name
    if view is None or view.kind != "look" or data.closed_ms is not None:
        return
    with _appending(folder.path(name)) as looks:
        if not any(each.kind == "planned" and each.players == view.players for each in looks):
            looks.append(LookTaken("planned", _now(), view.finished, view.players, ""))


def note_emergency_look(folder: Folder, data: StudyData, reason: str) -> LookTaken:
    """Log a look outside the plan and return it; StudyError without a reason."""
    words = " ".join(reason.split())
    if len(words) < SHORTEST_REASON:
        raise StudyError(
            f"a look outside the plan needs a reason of at least {SHORTEST_REASON} characters, which the report prints; "
            f"got {words!r}"
        )
    look = LookTaken("emergency", _now(), len(finishers(data)), None, words)
    with _appending(folder.path(data.protocol.name)) as looks:
        looks.append(look)
    return look


@contextmanager
def _appending(path: Path) -> Iterator[list[LookTaken]]:
    """Yield the looks of a study's folder and write what was appended; no other process writes meanwhile."""
    try:
        lock = os.open(path, os.O_RDONLY)
    except OSError as error:
        raise StudyError(
            f"the look cannot be logged, so nothing is shown: no folder {path}; give the right --studies"
        ) from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        known = read_looks(path / LOOKS_FILE)
        looks = list(known)
        yield looks
        if len(looks) > len(known):
            write_looks(path / LOOKS_FILE, looks)
    finally:
        os.close(lock)


def write_looks(path: Path, looks: Sequence[LookTaken]) -> None:
    """Write looks to a file, whole and on disk; StudyError when it cannot be written."""
    text = json.dumps([asdict(look) for look in looks], indent=2, ensure_ascii=False) + "\n"
    try:
        with write_whole(path) as file:
            file.write(text.encode())
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise StudyError(
            f"the look cannot be logged, so nothing is shown: cannot write {path}: {reason}"
        ) from error


def _now() -> str:
    """Return the time in UTC, as in "2026-01-31T08:05:00Z"."""
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
