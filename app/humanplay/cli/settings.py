"""What the commands about a server share: settings, and errors as sentences.

A user's mistake becomes a UsageError here; `humanplay.command.group.run` turns those into one
sentence and exit code 2.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click import BadParameter, ClickException, UsageError

from humanplay.command.console import reason

if TYPE_CHECKING:
    from humanplay.task import Configuration
    from humanplay.web.settings import Place, Settings


def settings_of(**flags: Any) -> Settings:
    """A server's settings from flags and HUMANPLAY_* variables; UsageError if wrong."""
    from humanplay.web.settings import Settings

    return _read(Settings, flags)


def place() -> Place:
    """Where the server and its files are.

    Settings that concern only a server may be wrong.
    """
    from humanplay.web.settings import Place

    return _read(Place, {})


S = TypeVar("S", bound="Place")


def _read(settings: type[S], flags: Mapping[str, Any]) -> S:
    from pydantic import ValidationError
    from pydantic_settings import SettingsError

    from humanplay.web.settings import fault_of, unknown_variables

    for note in unknown_variables(os.environ):
        click.echo(f"humanplay: {note}", err=True)
    try:
        return settings(**flags)
    except (SettingsError, ValidationError) as error:
        raise UsageError(fault_of(error, flags)) from error


@contextmanager
def study_errors() -> Iterator[None]:
    """Turn a StudyError into one sentence: exit code 1 if the disk refused, else 2."""
    from humanplay.study.folder import StudyError

    try:
        yield
    except StudyError as error:
        failed = isinstance(error.__cause__, OSError)
        raise (ClickException if failed else UsageError)(str(error)) from error


@contextmanager
def failures(failed: str, way_out: str = "") -> Iterator[None]:
    """Turn an error of a study, a database, a release or the disk into a sentence.

    Args:
        failed: What could not be done, for an error of the disk; "{file}" in it stands for the
            file.
        way_out: What the user can do about that.
    """
    from humanplay.db.database import StoreError
    from humanplay.release.errors import ReleaseError
    from humanplay.study.protocol import StudyError

    try:
        yield
    except (ReleaseError, StoreError, StudyError) as error:
        raise ClickException(str(error)) from error
    except OSError as error:
        text = failed.format(file=error.filename)
        raise ClickException(f"{text}: {reason(error)}{way_out}") from error


def pins_file() -> Path:
    """The file of pinned signing keys.

    HUMANPLAY_SIGNERS, or known_signers.json in the user's configuration folder.
    """
    return place().signers or Path(click.get_app_dir("humanplay")) / "known_signers.json"


def named_task(name: str) -> str:
    """The task of an id, a file, or the folder of a world.

    Raises:
        ValueError: If there is none; it says why.
    """
    from humanplay.task.registration import is_registered, register
    from humanplay.tasks.gymnasium.description import description_of

    if is_registered(name):
        return name
    folder = Path(name)
    # a folder beside may be called like an id, such as that of what was trained on it
    is_path = name.startswith((".", os.sep))
    try:
        if folder.is_dir() and (is_path or (folder / "environment.py").is_file()):
            return register(folder)
        return f"gymnasium:{description_of(name)}"
    except OSError as error:
        raise ValueError(f"cannot read {name}: {reason(error)}") from error


def task_name(name: str) -> str:
    """The name of a task as it is recorded.

    Args:
        name: As the user types it (`description_of`), or a world's folder.

    Raises:
        BadParameter: If there is no such task.
    """
    try:
        return named_task(name)
    except ValueError as error:
        raise BadParameter(str(error)) from error


def config_of(
    task: str, level: str | None = None, size: int | tuple[int, int] | None = None
) -> Configuration:
    """What a task plays: its default, or a level at a size.

    Raises:
        UsageError: If there is no such one.
    """
    from humanplay.task.registration import environment_of

    try:
        environment = environment_of(task)
        default = environment.configuration({})
    except ValueError as error:
        raise BadParameter(str(error)) from error
    if level is None and size is None:
        return default
    if environment.boards is None:
        raise UsageError(
            f"{environment.about.title} has no levels and sizes: leave --level and --size out"
        )
    try:
        return environment.boards.configuration(
            level or default.level, default.size if size is None else size
        )
    except ValueError as error:
        raise UsageError(str(error)) from error
