"""What the commands of `marsexplorer study` share: their options, the folder of studies, errors as one sentence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import PATH, settings_of

if TYPE_CHECKING:
    from app.study.folder import Folder

STUDIES = click.option("--studies", type=PATH, help="The folder of studies.  [default: data/studies, see below]")
DATABASE = click.option("--database", type=PATH, help="The database the study was played in, if it is not the default one.")


@contextmanager
def study_errors() -> Iterator[None]:
    """Turn a StudyError into one sentence: exit code 1 where the disk refused, 2 otherwise."""
    from app.study.folder import StudyError

    try:
        yield
    except StudyError as error:
        failed = isinstance(error.__cause__, OSError)
        raise (click.ClickException if failed else click.UsageError)(str(error)) from error


def folder_of(studies: Path | None) -> Folder:
    """Return the folder of studies: the one given, else that of the settings."""
    from app.study.folder import Folder

    return Folder(studies or settings_of().studies)
