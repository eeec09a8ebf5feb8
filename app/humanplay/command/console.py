"""What the commands print and write: a progress bar, a table, a file that is whole or not there."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from click import ClickException, echo

PRINTED_WIDTH = 140
"""Width in characters of a table that is printed to a file or a pipe."""


def write_file(path: Path, content: bytes, option: str = "file", private: bool = False) -> None:
    """Write a file, whole or not at all; ClickException with the way out, which is another
    `option`.

    Args:
        private: For its owner alone.
    """
    from marsexplorer.files import write_whole

    try:
        with write_whole(path) as file:
            if private:
                os.fchmod(file.fileno(), 0o600)
            file.write(content)
    except OSError as error:
        why = f"{reason(error)}; choose another {option}"
        raise ClickException(f"cannot write {path}: {why}") from error


def reason(error: OSError) -> str:
    """Return the operating system's reason in lower case, such as `permission denied`."""
    return (error.strerror or str(error)).lower()


@contextmanager
def written(place: Path | str, option: str = "--out") -> Iterator[None]:
    """Turn an error of the disk into one sentence: what cannot be written, why, and the option to
    give another of."""
    try:
        yield
    except OSError as error:
        why = f"{reason(error)}; choose another {option}"
        raise ClickException(f"cannot write {place}: {why}") from error


@contextmanager
def noted_progress(what: str, total: int, note: str = "") -> Iterator[Callable[..., None]]:
    """Yield `advance(done, note, line)`: it moves a bar with a note on stderr, or prints the line
    where that is no terminal.

    An empty note leaves the one before, and of an empty line nothing is printed.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console, noted = Console(stderr=True), TextColumn("{task.fields[note]}")
    columns = (TextColumn(what), BarColumn(), noted, TimeRemainingColumn())
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
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Yield `advance(done, total)` that moves a bar on stderr; nothing is drawn where stderr is no
    terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    bar: Progress
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table on stdout: the first column to the left and never cut, the others to the right."""
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
