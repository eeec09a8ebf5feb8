"""Zip archives of weights, read so that nothing in them can run, fill the memory or land on the disk.

Nothing is ever extracted: members are read by name into memory, up to a size.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

from marsexplorer.policies.base import PolicyFileError
from marsexplorer.policies.files.card import refuse

LARGEST = 64 << 20
"""Bytes of a file, and of everything in it unpacked."""

MOST_MEMBERS = 1000


class Archive:
    """A zip file whose names and sizes are as they should be; PolicyFileError otherwise."""

    def __init__(self, path: Path, data: bytes, advice: str, what: str = "a zip file") -> None:
        self.path, self.advice = path, advice
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(data))
            members = self._zip.infolist()
        except (zipfile.BadZipFile, ValueError, NotImplementedError, EOFError) as error:
            raise self.refuse(f"{what} that is whole", str(error)[:80] or "none") from error
        if len(members) > MOST_MEMBERS:
            raise self.refuse(f"at most {MOST_MEMBERS} files in {what}", f"{len(members)}")
        for member in members:
            if (
                member.filename.startswith(("/", "\\"))
                or ".." in Path(member.filename.replace("\\", "/")).parts
            ):
                raise self.refuse("names that stay inside the archive", repr(member.filename)[:60])
        unpacked = sum(member.file_size for member in members)
        if unpacked > LARGEST:
            raise self.refuse(
                f"{what} of at most {LARGEST >> 20} MiB unpacked", f"{unpacked >> 20} MiB"
            )
        self.names = [member.filename for member in members]

    def refuse(self, expected: str, came: str) -> PolicyFileError:
        """Return the error for this file."""
        return refuse(self.path, expected, came, self.advice)

    def read(self, name: str, most: int = LARGEST) -> bytes:
        """Return a member's bytes; one that is absent, longer than it says, or longer than `most` is refused."""
        if self.names.count(name) != 1:
            raise self.refuse(f"one file {name} inside", f"{self.names.count(name)}")
        try:
            with self._zip.open(name) as member:
                data = member.read(most + 1)
        except (
            zipfile.BadZipFile,
            ValueError,
            NotImplementedError,
            EOFError,
            RuntimeError,
            OSError,
        ) as error:
            raise self.refuse(f"{name} whole", f"{type(error).__name__}: {error}"[:80]) from error
        except Exception as error:  # zlib, lzma and bz2 each have an error of their own
            raise self.refuse(f"{name} whole", f"{type(error).__name__}: {error}"[:80]) from error
        if len(data) > most:
            raise self.refuse(f"{name} of at most {most} bytes", "more")
        return data


def read_file(path: Path, advice: str) -> bytes:
    """Return a policy file's bytes; PolicyFileError when it is too large or cannot be read."""
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise refuse(
                path, f"a file of at most {LARGEST >> 20} MiB", f"{size >> 20} MiB", advice
            )
        return path.read_bytes()
    except OSError as error:
        raise refuse(
            path, "a file that can be read", f"{type(error).__name__}: {error.strerror}", advice
        ) from error
