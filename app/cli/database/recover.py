"""The command `marsexplorer recover`: what can be read of a damaged database, in a new file."""

from __future__ import annotations

from pathlib import Path

import click

from app.cli.console import PATH, progress, reason


@click.command(short_help="Read out a damaged database.")
@click.argument("database", type=PATH)
@click.option("--out", type=PATH, required=True, help="The new file.")
def recover(database: Path, out: Path) -> None:
    """Write what can be read of a damaged DATABASE into a new file, simulate it, and report what was lost.

    Ended episodes stay if all their moves are there, running ones up to the first missing move. The report is printed and
    written beside the new file, as NEW.report.txt. DATABASE stays as it is. Its chain of hashes cannot be made whole again:
    `verify` goes on naming what is missing. A backup, if there is one, may hold more: `marsexplorer restore`.

    \b
    Examples:
      marsexplorer recover data/playground.db --out recovered.db
    """
    from app.backup.recovering import recover as read_out
    from app.storage.database import StoreError
    from app.study.verification import verify_database

    try:
        with progress("reading") as advance:
            found = read_out(database, out, advance)
        with progress("verifying (the rules are compiled first)") as advance:
            result = verify_database(out, advance)
        lines = [
            *found.lines(),
            f"{result.episodes:,} episodes of {result.moves:,} moves simulated: {len(result.findings):,} differences",
            *(str(finding) for finding in result.findings),
        ]
        report = out.with_name(out.name + ".report.txt")
        report.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except StoreError as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"cannot write {error.filename}: {reason(error)}") from error
    for line in lines[: len(found.lines()) + 1]:
        click.echo(line)
    click.echo(f"wrote {out}; the report with every difference is {report}")
