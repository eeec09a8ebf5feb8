"""What commands share: reading sizes, configurations and settings, a progress bar, Ctrl-C, printing a table.

Whatever a user got wrong becomes a click.UsageError here; `app.cli.main.main` turns those into one sentence and exit code 2.
"""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from rich.progress import Progress

    from app.settings import Settings
    from marsexplorer.config import EnvConfig

T = TypeVar("T")
PATH = click.Path(path_type=Path)
PRINTED_WIDTH = 140
"""Characters of a table that goes to a file or a pipe."""

TIDY_S = 5.0
"""Seconds that work whose processes were killed may take to notice."""


class Size(click.ParamType):  # type: ignore[type-arg]
    """`21` for a square, `42x84` for rows x columns."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | tuple[int, int]:
        """Return a side or (rows, cols)."""
        if isinstance(value, (int, tuple)):
            return value
        parts = str(value).lower().split("x")
        if not 1 <= len(parts) <= 2 or not all(part.isascii() and part.isdigit() for part in parts):
            self.fail(f"expected a side like 21 or ROWSxCOLS like 42x84, got {value!r}", param, ctx)
        return (int(parts[0]), int(parts[1])) if len(parts) == 2 else int(parts[0])


def check_more(more: Sequence[object], policies: Sequence[object]) -> None:
    """Return when words without an option follow --policy NAME, as in `--policy a b c`; UsageError otherwise."""
    if more and not policies:
        raise click.UsageError(f"unexpected argument {str(more[0])!r}: name policies with --policy")


def settings_of(**flags: Any) -> Settings:
    """Return the settings from flags and MARS_* variables; UsageError naming the first wrong one."""
    from pydantic import ValidationError

    from app.settings import Settings

    try:
        return Settings(**flags)
    except ValidationError as error:
        first = error.errors()[0]
        name = "_".join(str(part) for part in first["loc"])
        raise click.UsageError(f"setting {name}: {first['msg'].lower()}, got {first['input']!r}") from error


def config_of(level: str, size: int | tuple[int, int]) -> EnvConfig:
    """Return the configuration of a level and size; UsageError when there is none."""
    from marsexplorer.config import EnvConfig

    try:
        return EnvConfig.of(level, size)
    except ValueError as error:
        raise click.UsageError(str(error)) from error


def reason(error: OSError) -> str:
    """Return why the system refused, in lower case: `permission denied`."""
    return (error.strerror or str(error)).lower()


def interruptible(work: Callable[[], T]) -> T:
    """Return what `work()` gives; Ctrl-C ends it and the processes it started at once.

    It is done in a thread that Ctrl-C does not reach. Its processes inherit that, else each would print a traceback of
    its own; they are killed instead of doing their work to the end.
    """
    done: Future[T] = Future()

    def body() -> None:
        resource_tracker.ensure_running()  # its start, at the first process, would undo the next line
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            done.set_result(work())
        except BaseException as error:
            done.set_exception(error)

    thread = threading.Thread(target=body, daemon=True)
    thread.start()
    try:
        return done.result()
    except KeyboardInterrupt:
        killed = False
        while workers := multiprocessing.active_children():
            killed = True
            for worker in workers:
                worker.kill()
            thread.join(0.1)
        if killed:
            thread.join(TIDY_S)  # else the pool's semaphores are still being given back when this process ends
        raise


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Yield `advance(done, total)` moving a bar on stderr; nothing is drawn where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    bar: Progress
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table on stdout, numbers to the right; the first column's names are never cut."""
    from rich.console import Console
    from rich.table import Table

    grid = Table(title=title)
    grid.add_column(columns[0], no_wrap=True)
    for name in columns[1:]:
        grid.add_column(name, justify="right")
    for row in rows:
        grid.add_row(*row)
    console = Console()
    if not console.is_terminal:
        console = Console(width=PRINTED_WIDTH)
    console.print(grid)
