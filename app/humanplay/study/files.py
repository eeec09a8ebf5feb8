"""The JSON files of a study's folder: read, written whole and on disk, and the times in them."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from humanplay.study.protocol import StudyError


def read_object(path: Path) -> dict[str, object]:
    """Return the JSON object in a file; StudyError when it cannot be read or holds something else."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StudyError(f"cannot read {path}: {(error.strerror or str(error)).lower()}") from error
    except ValueError as error:
        raise StudyError(f"{path} is not JSON: {error}") from error
    if not isinstance(value, dict):
        raise StudyError(f"{path} must hold a JSON object, got {type(value).__name__}")
    return value


def text_of(values: Mapping[str, object], name: str) -> str:
    """Return a text of a JSON object; KeyError or TypeError when there is none of this name."""
    text = values[name]
    if not isinstance(text, str):
        raise TypeError(f"{name} must be text, got {type(text).__name__}")
    return text


def write_object(path: Path, value: object, private: bool = False) -> None:
    """Write the value to the file, whole and on disk; a private file is readable by its owner alone."""
    text = value if isinstance(value, str) else json.dumps(value, indent=2, ensure_ascii=False)
    write_bytes(path, text.encode() + b"\n", private)


def write_bytes(path: Path, content: bytes, private: bool = False) -> None:
    """Write a file of a study's folder, whole and on disk; StudyError when it cannot be written."""
    from marsexplorer.files import write_whole

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with write_whole(path) as file:
            if private:
                os.fchmod(file.fileno(), 0o600)
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise StudyError(
            f"cannot write {path}: {(error.strerror or str(error)).lower()}; choose another place with --database"
        ) from error


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes and threads that ask for the folder's lock out until the block ends."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def stamp_of(path: Path) -> tuple[int, int, int] | None:
    """Return what differs once a file has been written anew; None when it is not there."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_size, stat.st_ino


def now_ms() -> int:
    """Return milliseconds since 1970."""
    return int(datetime.now(UTC).timestamp() * 1000)


def iso(ms: int) -> str:
    """Return ISO 8601 in UTC, to the millisecond."""
    at = datetime.fromtimestamp(ms / 1000, UTC).isoformat(timespec="milliseconds")
    return at.replace("+00:00", "Z")


def ms_of(iso: str) -> int:
    """Return milliseconds since 1970 of a time in ISO 8601."""
    return round(datetime.fromisoformat(iso).timestamp() * 1000)
