"""Functions that the commands share: settings, errors as sentences, files, a progress bar, tables; `options` has their options.

A user's mistake becomes a UsageError here; `humanplay.cli.main.main` turns those into one sentence and exit code 2.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click import BadParameter, ClickException, UsageError

if TYPE_CHECKING:
    from rich.progress import Progress

    from humanplay.task import Configuration
    from humanplay.web.settings import Place, Settings

PRINTED_WIDTH = 140
"""Width in characters of a table that is printed to a file or a pipe."""


def settings_of(**flags: Any) -> Settings:
    """Return a server's settings from flags and MARS_* variables; UsageError for a wrong one."""
    from humanplay.web.settings import Settings

    return _read(Settings, flags)


def place() -> Place:
    """Return where the server and its files are; settings that concern only a server may be wrong."""
    from humanplay.web.settings import Place

    return _read(Place, {})


S = TypeVar("S", bound="Place")


def _read(settings: type[S], flags: Mapping[str, Any]) -> S:
    from pydantic import ValidationError
    from pydantic_settings import SettingsError

    from humanplay.web.settings import fault_of, unknown_variables

    for note in unknown_variables(os.environ):
        click.echo(f"marsexplorer: {note}", err=True)
    try:
        return settings(**flags)
    except (SettingsError, ValidationError) as error:
        raise UsageError(fault_of(error, flags)) from error


@contextmanager
def study_errors() -> Iterator[None]:
    """Turn a StudyError into one sentence: exit code 1 where the disk refused, 2 otherwise."""
    from humanplay.series.folder import StudyError

    try:
        yield
    except StudyError as error:
        failed = isinstance(error.__cause__, OSError)
        raise (ClickException if failed else UsageError)(str(error)) from error


@contextmanager
def failures(what: str, way_out: str = "") -> Iterator[None]:
    """Turn an error of a study, a database or a release into its sentence, and one of the disk into `what`, why and `way_out`.

    what  "{file}" in it stands for the file that could not be read or written
    """
    from humanplay.db.database import StoreError
    from humanplay.release.errors import ReleaseError
    from humanplay.series.protocol import StudyError

    try:
        yield
    except (ReleaseError, StoreError, StudyError) as error:
        raise ClickException(str(error)) from error
    except OSError as error:
        text = what.format(file=error.filename)
        raise ClickException(f"{text}: {reason(error)}{way_out}") from error


def write_file(path: Path, content: bytes, option: str = "file", private: bool = False) -> None:
    """Write a file, whole or not at all; ClickException with the way out, which is another `option`.

    private  for its owner alone
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


def pins_file() -> Path:
    """Return the file of pinned signing keys: MARS_SIGNERS, or known_signers.json in the user's configuration folder."""
    return place().signers or Path(click.get_app_dir("marsexplorer")) / "known_signers.json"


def task_name(given: str) -> str:
    """Return the name of a task as it is recorded, of what `told_of` takes; BadParameter where it is none."""
    from humanplay.tasks.gymnasium.description import told_of

    if given == "mars" or given.startswith("gymnasium:"):
        return given
    try:
        return f"gymnasium:{told_of(given)}"
    except OSError as error:
        raise BadParameter(f"cannot read {given}: {reason(error)}") from error
    except ValueError as error:
        raise BadParameter(str(error)) from error


def default_config(task: str) -> Configuration:
    """Return what a task plays where nothing else is asked for; BadParameter where there is none."""
    from humanplay.task import rules_of

    try:
        return rules_of(task).configuration({})
    except ValueError as error:
        raise BadParameter(str(error)) from error


def env_config_of(level: str, size: int | tuple[int, int]) -> Configuration:
    """Return the configuration of a level and size; raise UsageError when there is none."""
    from humanplay.tasks.mars.rules import MarsRules

    try:
        return MarsRules.of_level(level, size)
    except ValueError as error:
        raise UsageError(str(error)) from error


def reason(error: OSError) -> str:
    """Return the operating system's reason in lower case, such as `permission denied`."""
    return (error.strerror or str(error)).lower()


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Yield `advance(done, total)` that moves a bar on stderr; nothing is drawn where stderr is no terminal."""
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
