"""The command `marsexplorer restore`: a backup put in the place of the database."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import click

from app.cli.console import PATH, progress, settings_of


@click.command(short_help="Put a backup in the place of the database.")
@click.argument("backup", type=PATH)
@click.option("--database", type=PATH, help="The database whose place it takes.")
@click.option("--yes", is_flag=True, help="Do not ask.")
def restore(backup: Path, database: Path | None, yes: bool) -> None:
    """Put a copy of BACKUP in the place of the database, once every page, every reference and the chain were verified.

    What stood there stays beside it as NAME.before-TIME, so nothing is deleted. Stop the server first: while one runs,
    nothing is changed.

    \b
    Examples:
      marsexplorer restore monday.db
      marsexplorer restore /mnt/backups/lab-20261122T150000Z.db --database lab.db --yes
    """
    from app.storage.backup import restore as put_back
    from app.storage.database import StoreError

    path = database or settings_of().database
    if path.exists() and not yes:
        click.confirm(f"Put {backup} in the place of {path}?", abort=True, err=True)
    try:
        with progress("copying") as advance:
            kept = put_back(backup, path, datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ"), advance)
    except StoreError as error:
        raise click.ClickException(str(error)) from error
    before = "" if kept is None else f"; what stood there is {kept}"
    click.echo(f"restored {path} from {backup}, verified{before}")
