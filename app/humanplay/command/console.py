"""What the commands print and write: progress, tables, whole files."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from click import ClickException, echo

if TYPE_CHECKING:
    from tqdm import tqdm

PRINTED_WIDTH = 140
"""Width in characters of a table that is printed to a file or a pipe."""


def write_file(path: Path, content: bytes, option: str = "file", private: bool = False) -> None:
    """Write a file, whole or not at all.

    Args:
        option: That names another place, for the error.
        private: For its owner alone.

    Raises:
        ClickException: If it cannot be written.
    """
    from marsexplorer.files import write_whole

    try:
        with write_whole(path) as file:
            if private:
                os.fchmod(file.fileno(), 0o600)
            file.write(content)
    except OSError as error:
        raise ClickException(
            f"cannot write {path}: {reason(error)}; choose another {option}"
        ) from error


def reason(error: OSError) -> str:
    """The operating system's reason in lower case, such as `permission denied`."""
    return (error.strerror or str(error)).lower()


@contextmanager
def written(place: Path | str, option: str = "--out") -> Iterator[None]:
    """Turn an error of the disk into one sentence.

    Args:
        place: That cannot be written.
        option: That names another place.
    """
    try:
        yield
    except OSError as error:
        raise ClickException(
            f"cannot write {place}: {reason(error)}; choose another {option}"
        ) from error


@contextmanager
def noted_progress(label: str, total: int, note: str = "") -> Iterator[Callable[..., None]]:
    """Yield `advance(done, note, line)`, which moves a bar with a note on stderr.

    If stderr is no terminal it prints the line instead. An empty note leaves the one before, and an
    empty line is not printed.
    """
    with _bar(label, total, stays=True) as bar:
        if bar is not None:
            bar.set_postfix_str(note)

        def advance(done: float, note: str = "", line: str = "") -> None:
            if bar is None:
                if line:
                    echo(line, err=True)
                return
            if note:
                bar.set_postfix_str(note, refresh=False)
            bar.update(done - bar.n)

        yield advance


@contextmanager
def progress(label: str) -> Iterator[Callable[[int, int], None]]:
    """Yield `advance(done, total)`, which moves a bar on stderr if that is a terminal."""
    with _bar(label, None, stays=False) as bar:

        def advance(done: int, total: int) -> None:
            if bar is not None:
                bar.total = total
                bar.update(done - bar.n)

        yield advance


@contextmanager
def _bar(label: str, total: int | None, stays: bool) -> Iterator[tqdm | None]:
    """Yield a bar on stderr with the time remaining; None if that is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    tqdm.monitor_interval = 0  # no thread of its own beside the jobs' processes
    parts = "{percentage:3.0f}%|{bar}| {remaining} {desc}{postfix}"
    # the label comes last: what a narrow terminal has no room for is its end
    with tqdm(desc=label, total=total, leave=stays, bar_format=parts, dynamic_ncols=True) as bar:
        yield bar


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table on stdout that fits a terminal.

    The first column is on the left and never wrapped, the others are on the right. If they do not
    fit side by side, the cells of a row stand below each other.
    """
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else PRINTED_WIDTH
    widths = _column_widths([columns, *rows], width)
    echo(title)
    if widths is None:
        for row in rows:
            echo(row[0])
            for name, cell in zip(columns[1:], row[1:], strict=True):
                echo(f"  {name}: {cell}")
        return
    from tabulate import tabulate

    heads, *cells = [_wrapped(row, widths) for row in (columns, *rows)]
    alignment = ["left", *["right"] * (len(columns) - 1)]
    echo(tabulate(cells, heads, tablefmt="pretty", colalign=alignment))


def _wrapped(row: Sequence[str], widths: Sequence[int]) -> list[str]:
    """A row's cells in lines that break no word; tabulate's own cannot wrap "1,579"."""
    wrap = partial(textwrap.wrap, break_long_words=False, break_on_hyphens=False)
    return ["\n".join(wrap(cell, width)) for cell, width in zip(row, widths, strict=True)]


def _column_widths(rows: Sequence[Sequence[str]], width: int) -> list[int] | None:
    """Widths of a table's columns that break no word; None if they do not fit."""
    columns = list(zip(*rows, strict=True))
    widths = [max(map(len, column)) for column in columns]
    narrowest = [
        max(len(word) for cell in column for word in cell.split() or [""]) for column in columns
    ]
    narrowest[0] = widths[0]
    # a line at the left of each column with a space on both sides of the text, and one at the end
    room = width - 3 * len(columns) - 1
    if sum(narrowest) > room:
        return None
    while sum(widths) > room:
        spare = [number for number, least in enumerate(narrowest) if widths[number] > least]
        widths[max(spare, key=widths.__getitem__)] -= 1
    return widths
