"""The command `marsexplorer merge`: the databases of several servers as one."""

from __future__ import annotations

from pathlib import Path

import click

from app.cli.console import PATH, progress, reason


@click.command(short_help="Join the databases of several servers.")
@click.argument("databases", type=PATH, nargs=-1, required=True, metavar="A.db B.db ...")
@click.option(
    "--out",
    type=PATH,
    required=True,
    help="A new file for all of it; it appears whole or not at all.",
)
def merge(databases: tuple[Path, ...], out: Path) -> None:
    """Join databases in which the same study, or different ones, were played; the sources stay as they are.

    What two of them hold alike is taken once; two contents under one id are refused. Whoever was forgotten in one of them is
    left out. The key that signs cookies is not taken along. A server may go on writing its own file meanwhile.

    \b
    Examples:
      marsexplorer merge berlin.db athens.db --out both.db
      marsexplorer verify --database both.db
    """
    if len(databases) < 2:
        raise click.UsageError(
            "give two databases or more: marsexplorer merge A.db B.db --out C.db"
        )
    from app.storage import merging
    from app.storage.database import StoreError

    try:
        with progress("joining") as advance:
            counts, twice = merging.merge(databases, out, advance)
    except StoreError as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(
            f"cannot write {out}: {reason(error)}; choose another --out"
        ) from error
    alike = (
        f", {counts.equal['episodes']:,} of them in more than one"
        if counts.equal["episodes"]
        else ""
    )
    left = f"; {counts.forgotten} people left out, who were forgotten" if counts.forgotten else ""
    people, episodes = counts.added["participants"], counts.added["episodes"]
    click.echo(
        f"{out}: {people} participants and {episodes:,} episodes from {len(databases)} databases{alike}{left}"
    )
    if twice:
        click.echo(
            f"beware: {twice} outside ids or invitations took part in a study twice, on two servers; the report counts each "
            "as two people"
        )
