"""The files of a study's folder, written whole and on disk, and the times in them."""

from __future__ import annotations

import fcntl
import json
import os
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from humanplay.study.protocol import StudyError


def read_object(path: Path) -> dict[str, object]:
    """The JSON object in a file; StudyError if the file cannot be read or holds none."""
    try:
        content = json.loads(read_bytes(path))
    except ValueError as error:
        raise StudyError(f"{path} is not JSON: {error}") from error
    if not isinstance(content, dict):
        raise StudyError(f"{path} must hold a JSON object, got {type(content).__name__}")
    return content


def read_toml(path: Path) -> dict[str, object]:
    """The table in a TOML file; StudyError if it cannot be read."""
    try:
        return tomllib.loads(read_bytes(path).decode())
    except ValueError as error:
        raise StudyError(f"{path} is not TOML: {error}") from error


def read_bytes(path: Path) -> bytes:
    """The content of a file; StudyError if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise StudyError(f"cannot read {path}: {(error.strerror or str(error)).lower()}") from error


def text_of(fields: Mapping[str, object], name: str) -> str:
    """A field of a JSON object that is a text.

    Raises:
        KeyError: If it is missing.
        TypeError: If it is something else.
    """
    text = fields[name]
    if not isinstance(text, str):
        raise TypeError(f"{name} must be text, got {type(text).__name__}")
    return text


def write_object(path: Path, content: object, private: bool = False) -> None:
    """Write a text as it is, and anything else as JSON; otherwise like `write_bytes`."""
    if not isinstance(content, str):
        content = json.dumps(content, indent=2, ensure_ascii=False)
    write_bytes(path, content.encode() + b"\n", private)


def write_bytes(path: Path, content: bytes, private: bool = False) -> None:
    """Write a file whole and to the disk; StudyError if it cannot be written.

    Args:
        private: Whether its owner alone can read it.
    """
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
    """Hold the folder's lock against other processes and threads, for a `with` block."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def stamp_of(path: Path) -> tuple[int, int, int] | None:
    """A mark that changes whenever the file is written; None if there is no file."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_size, stat.st_ino


def now_ms() -> int:
    """The time now, in milliseconds since 1970."""
    return int(datetime.now(UTC).timestamp() * 1000)


def iso(ms: int) -> str:
    """A time (milliseconds since 1970) as ISO 8601 in UTC, to the millisecond."""
    text = datetime.fromtimestamp(ms / 1000, UTC).isoformat(timespec="milliseconds")
    return text.replace("+00:00", "Z")


def ms_of(iso: str) -> int:
    """A time in ISO 8601, as milliseconds since 1970."""
    return round(datetime.fromisoformat(iso).timestamp() * 1000)
