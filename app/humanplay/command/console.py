"""What the commands print and write: progress, tables, whole files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from click import ClickException, echo

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
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console, noted = Console(stderr=True), TextColumn("{task.fields[note]}")
    columns = (TextColumn(label), BarColumn(), noted, TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=total, note=note)

        def advance(done: float, note: str = "", line: str = "") -> None:
            bar.update(task, completed=done)
            if note:
                bar.update(task, note=note)
            if line and not console.is_terminal:
                echo(line, err=True)

        yield advance


@contextmanager
def progress(label: str) -> Iterator[Callable[[int, int], None]]:
    """Yield `advance(done, total)`, which moves a bar on stderr if that is a terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    bar: Progress
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table on stdout.

    The first column is on the left and never cut, the others are on the right.
    """
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title)
    table.add_column(columns[0], no_wrap=True)
    for name in columns[1:]:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*row)
    console = Console()
    if not console.is_terminal:
        console = Console(width=PRINTED_WIDTH)
    console.print(table)
