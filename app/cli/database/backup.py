"""The command `marsexplorer backup`: the database as one verified file, while people play."""

from __future__ import annotations

from pathlib import Path

import click

from app.cli.console import PATH, progress, settings_of


@click.command(short_help="Copy the database while people play.")
@click.argument("file", type=PATH)
@click.option(
    "--database", type=PATH, help="The database to copy; a running server may go on writing."
)
def backup(file: Path, database: Path | None) -> None:
    """Write the database as it is now into FILE, a new file, and verify it: every page, every reference, the chain.

    FILE is there when the copy is whole, and not before: Ctrl-C leaves nothing. A server makes backups by itself with
    `serve --backup-every MINUTES --backup-to DIR`; `marsexplorer restore FILE` puts one back.

    \b
    Examples:
      marsexplorer backup monday.db
      marsexplorer backup /mnt/backups/lab.db --database lab.db
    """
    from app.storage.backup import back_up
    from app.storage.database import StoreError

    path = database or settings_of().database
    try:
        with progress("copying") as advance:
            size = back_up(path, file, advance)
    except StoreError as error:
        raise click.ClickException(str(error)) from error
    click.echo(f"wrote {file}: {size / 1e6:.1f} MB, verified")
