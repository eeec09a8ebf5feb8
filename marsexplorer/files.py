"""Files and folders that appear whole or not at all; cells of CSV files."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

_FORMULA = re.compile(r"[=@＝＠\t\r\n]|[+＋－-](?![\w.-]*\Z)")
"""How a text begins that a spreadsheet would run. A number with its sign is none, and neither is
an id that begins with "-".
"""


def to_cell(content: Any) -> Any:
    """Convert content to a cell of a CSV file that no spreadsheet runs as a formula.

    Such text gets an apostrophe in front; numbers stay numbers. A program that wants the text
    itself reads the Parquet or the database, where nothing is changed.
    """
    return f"'{content}" if isinstance(content, str) and _FORMULA.match(content) else content


@contextmanager
def replace_whole(path: Path) -> Iterator[Path]:
    """Yield a hidden path that is renamed to `path` when the block ends well.

    The block may write a file there (a database too) or make a folder. A file replaces the one that
    was there, a folder only an empty one. If the block raises, nothing is left.
    """
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield unfinished
        unfinished.replace(path)
    finally:
        if unfinished.is_dir():
            shutil.rmtree(unfinished, ignore_errors=True)
        for suffix in ("", "-wal", "-shm"):  # the last two are SQLite's
            unfinished.with_name(unfinished.name + suffix).unlink(missing_ok=True)


@contextmanager
def write_whole(path: Path) -> Iterator[IO[bytes]]:
    """Yield a binary file that is renamed to `path` when the block ends well.

    IsADirectoryError if `path` is a folder.
    """
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder")
    with replace_whole(path) as unfinished, unfinished.open("wb") as file:
        yield file
