"""The command `marsexplorer reproduce`: the figures of a bundle derived again from the bundle alone, and compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import PATH, pins_file, print_table, progress, reason
from app.cli.study.report import show

if TYPE_CHECKING:
    from app.release.reproduce import Reproduction

MAX_PRINTED = 20
"""Differences that are printed; more are counted."""


@click.command(short_help="Derive a bundle's figures again and compare.")
@click.argument("folder", type=PATH)
@click.option("--key", metavar="FINGERPRINT|FILE", help="The key that must have signed the bundle.")
@click.option(
    "--recorded",
    is_flag=True,
    help="Do not play the policies again: replay their recorded moves only.",
)
def reproduce(folder: Path, key: str | None, recorded: bool) -> int:
    """Derive every figure of a bundle's report from the bundle alone, and compare number by number.

    The people's episodes come from the bundle's database. The policies' episodes are replayed from their recorded moves;
    a policy whose file is here and has the same SHA-256 is played again as well. The exit code is 1 when a figure
    differs, or when a file is not the one that was signed. Neither the original database nor the study's folder is needed.

    \b
    Examples:
      marsexplorer reproduce dunes-1
      marsexplorer reproduce dunes-1 --key 15f592c2...
    """
    from app.release import reproduce as derivation
    from app.release.errors import ReleaseError
    from app.storage.database import StoreError
    from app.study.protocol import StudyError

    try:
        made = derivation.reproduce(folder, pins_file(), key, not recorded, progress)
    except (ReleaseError, StoreError, StudyError) as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"cannot read {error.filename}: {reason(error)}") from error
    _show(folder, made)
    return 1 if made.differ or made.findings else 0


def _show(folder: Path, made: Reproduction) -> None:
    """Print whose files they are, what was compared and what differs."""
    for finding in made.findings[:MAX_PRINTED]:
        click.echo(str(finding))
    click.echo(f"{folder}: {made.files} files, {len(made.findings) or 'none'} not as signed")
    click.echo(made.signer.sentence())
    if made.derived is not None:
        click.echo(
            "this bundle holds no report, so there is nothing to compare with; the report derived from it:"
        )
        for line in made.left_out:
            click.echo(f"- {line}")
        show(made.derived)
        return
    rows = [
        (name, f"{each.compared:,}", f"{each.differ:,}") for name, each in made.sections.items()
    ]
    print_table("figures derived again from the bundle", ("section", "compared", "differ"), rows)
    named = [line for each in made.sections.values() for line in each.differences]
    for line in named[:MAX_PRINTED]:
        click.echo(line)
    if made.differ > len(named[:MAX_PRINTED]):
        click.echo(f"... and {made.differ - len(named[:MAX_PRINTED])} more")
    for line in made.not_compared:
        click.echo(f"not compared: {line}")
    compared = sum(each.compared for each in made.sections.values())
    click.echo(f"{compared:,} values compared, {made.differ:,} differ")
