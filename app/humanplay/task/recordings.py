"""What was told of episodes that nothing can step again, beside the database.

A folder holds one of each task, named after it, with a file an episode. Such a file is read as far as it was written: a
program may be killed at any byte.
"""

from __future__ import annotations

import json
import os
import shutil
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NotRequired, TypedDict

if TYPE_CHECKING:
    from humanplay.task import AgentObservation

FOLDERS = "HUMANPLAY_RECORDINGS"
"""The variable that tells a worker of this process where to look."""
_looked_in = [Path(folder) for folder in os.environ.get(FOLDERS, "").split(os.pathsep) if folder]
_SIZES = struct.Struct(">II")
"""What a moment begins with: how many bytes of JSON it has, and how many others."""


class MomentFields(TypedDict):
    """What was told of a moment, ready for JSON.

    rewards, scores, allowed  those since the moment before
    action                    that led to it; None at the start
    """

    rewards: Sequence[float]
    scores: Sequence[float]
    allowed: Sequence[Sequence[int] | None]
    outcome: str
    total: float
    digest: str
    shown: AgentObservation | None
    action: NotRequired[int | None]


@dataclass(frozen=True)
class Moment:
    """What was told of an episode at its start, or after a move.

    content  the observation, packed; empty if it was not recorded
    """

    fields: MomentFields
    content: bytes


class Recording:
    """The file of an episode that is being played."""

    def __init__(self, path: Path) -> None:
        self._file: BinaryIO = path.open("xb")

    def add(self, moment: Moment) -> int:
        """Write a moment, and return how many bytes that took."""
        fields = json.dumps(moment.fields, separators=(",", ":")).encode()
        written = _SIZES.pack(len(fields), len(moment.content)) + fields + moment.content
        self._file.write(written)
        self._file.flush()  # before anybody sees it: a kill loses nothing that was shown
        return len(written)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def look_in(folder: Path) -> None:
    """Look for recordings in a folder too."""
    if folder.absolute() not in _looked_in:
        _looked_in.append(folder.absolute())


def looked_in() -> str:
    """The folders that are looked in, as the variable `FOLDERS` holds them."""
    return os.pathsep.join(map(str, _looked_in))


def folder_of(folder: Path, task: str) -> Path:
    """The folder of one task's recordings."""
    return folder / task.rpartition(":")[2]


def files_of(folder: Path, task: str, seed: int) -> list[Path]:
    """The recordings of a task on a seed in a folder, the oldest first."""
    return sorted(folder_of(folder, task).glob(f"{seed}-*.bin"), key=_number)


def new(folder: Path, seed: int) -> Recording:
    """Begin the file of an episode on a seed."""
    return Recording(_next_path(folder, seed))


def copy(path: Path, folder: Path) -> None:
    """Copy a recording, with what describes its task, into a task's folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for description in path.parent.glob("*.json"):
        if not (folder / description.name).exists():
            shutil.copyfile(description, folder / description.name)
    shutil.copyfile(path, _next_path(folder, int(path.stem.rpartition("-")[0])))


def of_seed(task: str, seed: int) -> list[list[Moment]]:
    """The episodes of a task that were recorded on a seed, the newest first."""
    paths = [path for folder in _looked_in for path in files_of(folder, task, seed)]
    paths.sort(key=_number, reverse=True)
    return [episode for path in paths if (episode := list(_moments(path)))]


def of_instance(folder: Path, task: str, seed: int) -> dict[Path, list[Moment]]:
    """What each recording of a task on a seed in a folder holds, the oldest first."""
    return {path: list(_moments(path)) for path in files_of(folder, task, seed)}


def holding(
    recorded: Mapping[Path, Sequence[Moment]], actions: bytes, digest: str | None
) -> Path | None:
    """The recording of an episode; None if there is none.

    The shortest that holds all of it; of equals, the oldest.
    """
    lengths = {
        path: len(moments) for path, moments in recorded.items() if holds(moments, actions, digest)
    }
    return min(lengths, key=lengths.__getitem__, default=None)


def holds(moments: Sequence[Moment], actions: bytes, digest: str | None = None) -> bool:
    """Whether a recording holds all of an episode.

    Args:
        digest: Of an episode that has ended; without one its moves are enough.
    """
    digests = {moment.fields["digest"] for moment in moments}
    return actions_of(moments).startswith(actions) and (digest is None or digest in digests)


def actions_of(moments: Sequence[Moment]) -> bytes:
    """The actions of an episode."""
    actions = [moment.fields.get("action") for moment in moments]
    return bytes(action for action in actions if action is not None)


def find(task: str, name: str) -> Path | None:
    """A file of this name beside the recordings of a task; None if there is none."""
    paths = [folder_of(folder, task) / name for folder in _looked_in]
    return next((path for path in paths if path.is_file()), None)


def size_of(folder: Path) -> int:
    """The bytes of all recordings in a folder."""
    return sum(path.stat().st_size for path in folder.glob("*/*.bin"))


def _next_path(folder: Path, seed: int) -> Path:
    numbers = [_number(path) for path in folder.glob(f"{seed}-*.bin")]
    return folder / f"{seed}-{max(numbers, default=-1) + 1}.bin"


def _number(path: Path) -> int:
    return int(path.stem.rpartition("-")[2])


def _moments(path: Path) -> Iterator[Moment]:
    written, start = path.read_bytes(), 0
    while start + _SIZES.size <= len(written):
        fields, content = _SIZES.unpack_from(written, start)
        start += _SIZES.size
        end = start + fields + content
        if end > len(written):
            return
        yield Moment(json.loads(written[start : start + fields]), written[start + fields : end])
        start = end
