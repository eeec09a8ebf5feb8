"""The option --database of the commands about a database and its studies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click import option

from humanplay.cli.settings import place
from humanplay.command.options import PATH, F

if TYPE_CHECKING:
    from humanplay.study.folder import Folder


def _database(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path:
    return path or place().database


def _studies(ctx: click.Context, param: click.Parameter, path: Path | None) -> Folder:
    from humanplay.study.folder import Folder

    return Folder.beside(_database(ctx, param, path))


def _database_with_studies(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path:
    ctx.params["folder"] = _studies(ctx, param, path)
    return _database(ctx, param, path)


def database_option(text: str) -> Callable[[F], F]:
    """The option --database, by default that of the settings.

    Args:
        text: What it is for.
    """
    return option("--database", type=PATH, callback=_database, help=text)


DATABASE = database_option("The database it was played in; a running server may go on writing.")
STUDIES = option(
    "--database", "folder", type=PATH, callback=_studies, help="The database whose study it is."
)
"""The option --database of a command that gets the folder of studies beside it, as `folder`."""
DATABASE_AND_STUDIES = option(
    "--database",
    type=PATH,
    callback=_database_with_studies,
    help="The database it is played in; a running server may go on writing.",
)
"""The option --database of a command that gets `database`, and the folder beside it as `folder`."""
