"""The command `marsexplorer export`: what was played, as tables."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import PATH, progress, reason, settings_of

if TYPE_CHECKING:
    from app.storage.export import ExportFormat
    from app.storage.reader import Who


@click.command(short_help="Write what was played as CSV or JSON Lines.")
@click.option(
    "--database", type=PATH, help="The database to read; a running server may go on writing."
)
@click.option(
    "--format",
    "fmt",
    type=click.Choice(["csv", "jsonl"]),
    default="csv",
    show_default=True,
    help="CSV or JSON Lines.",
)
@click.option(
    "--out", type=PATH, required=True, help="Folder for episodes.* and steps.*; made when absent."
)
@click.option(
    "--who",
    type=click.Choice(["all", "human"]),
    default="all",
    show_default=True,
    help="human: the counted ones.",
)
def export(database: Path | None, fmt: ExportFormat, out: Path, who: Who) -> None:
    """Write every finished episode, and every step of it, as two tables.

    Each episode is replayed on its way out; `verified` is false where the replay differs from what was recorded.
    Players appear under pseudonyms drawn anew for each export. docs/data.md lists the columns. Both files appear
    whole or not at all.

    \b
    Examples:
      marsexplorer export --out results
      marsexplorer export --database lab.db --format jsonl --out results --who human
    """
    from app.storage.export import export_to
    from app.storage.store import StoreError

    path = database or settings_of().database
    try:
        with progress("exporting") as advance:
            summary = export_to(path, out, fmt, who, advance)
    except StoreError as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(
            f"cannot write to {out}: {reason(error)}; choose another --out"
        ) from error
    click.echo(summary)
