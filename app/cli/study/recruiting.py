"""The commands `marsexplorer study invite`, `revoke` and `supervise`: who may take part, and under whose eyes."""

from __future__ import annotations

import csv
import io
import os
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import (
    DATABASE,
    PATH,
    STUDIES,
    folder_of,
    print_table,
    reason,
    settings_of,
    study_errors,
)

if TYPE_CHECKING:
    from app.study.folder import Study
    from app.study.invitations import Use


@click.command(short_help="Print single-use links to a study.")
@click.argument("name")
@click.argument("count", type=int, metavar="[N]", default=0)
@click.option(
    "--url",
    help="The address at which participants reach the server.  [default: MARS_PUBLIC_URL, else a guess that says so]",
)
@click.option(
    "--list", "lists", is_flag=True, help="List all invitations with their state instead."
)
@click.option(
    "--csv",
    "table",
    type=PATH,
    metavar="FILE",
    help="Write them to a file as well, with their links: id, state, link.",
)
@DATABASE
@STUDIES
def invite(
    name: str,
    count: int,
    url: str | None,
    lists: bool,
    table: Path | None,
    database: Path | None,
    studies: Path | None,
) -> None:
    """Print N single-use links to a study whose recruitment is by invitation.

    A link is used up when somebody agrees to the consent text, not when it is opened. Send each person one; whoever has a
    link can take part with it. The links are listed in the study's folder by their ids, never by their tokens; --list shows
    ids and states, and with --csv the links once more. A running server knows new links at once.

    \b
    Examples:
      marsexplorer study invite pilot 10 --url https://lab.example.org
      marsexplorer study invite pilot --list
      marsexplorer study invite pilot --list --csv links.csv
    """
    from app.study.invitations import Invitations, link_of, state_of

    if (count > 0) == lists:
        raise click.UsageError(
            "expected the number of links to make, such as 10, or --list to see those there are"
        )
    settings = settings_of()
    known = url or settings.public_url
    base = known or f"http://{settings.host}:{settings.port}"
    folder = folder_of(studies)
    invitations = Invitations(folder)
    with study_errors():
        study = folder.study(name)
        found = list(invitations.of(name).values()) if lists else invitations.issue(name, count)
    uses = _uses(database or settings.database, name)
    states = {
        each.id: (state_of(each, use := uses.get(each.id)), use.label if use else "")
        for each in found
    }
    links = {each.id: link_of(study, each.id, base) for each in found}
    if table is not None:
        _write_csv(table, study, [(each.id, *states[each.id], links[each.id]) for each in found])
    if known is None and (table is not None or not lists):
        click.echo(
            f"{base} is a guess: give --url, or MARS_PUBLIC_URL as the server has it, if people reach it elsewhere",
            err=True,
        )
    if not lists:
        click.echo("\n".join(links.values()))
    elif not found:
        click.echo(
            f"nobody has been invited to {name}; `marsexplorer study invite {name} 10` makes ten links"
        )
    else:
        rows = [(each.id, *states[each.id], _day(each.issued_ms)) for each in found]
        print_table(f"Invitations to {name}", ("id", "state", "participant", "issued (UTC)"), rows)


@click.command(short_help="Take invitations back.")
@click.argument("name")
@click.argument("ids", nargs=-1, required=True)
@STUDIES
def revoke(name: str, ids: tuple[str, ...], studies: Path | None) -> None:
    """Take invitations back by their ids: nobody can agree to take part with them any more.

    Whoever has agreed with one already goes on; `marsexplorer forget` erases a participant.

    \b
    Example:
      marsexplorer study revoke pilot 7K3M 9ABC
    """
    from app.study.invitations import Invitations

    with study_errors():
        revoked = Invitations(folder_of(studies)).revoke(name, ids)
    click.echo(f"revoked: {', '.join(each.id for each in revoked)}")


@click.command(short_help="Print the operator's code for supervised sessions.")
@click.argument("name")
@STUDIES
def supervise(name: str, studies: Path | None) -> None:
    """Print the code that an operator types on a participant's page in the lab.

    Episodes that begin within four hours after it was typed count as supervised. The code is that of this UTC day; it is
    valid until the end of the following one. Whoever knows it can type it anywhere: type it yourself, unseen.
    """
    from app.study.files import now_ms
    from app.study.recruitment import code_of, valid_until_ms

    with study_errors():
        study = folder_of(studies).study(name)
    if not study.is_open:
        raise click.UsageError(
            f"the study {name!r} is closed: nobody can be supervised in it any more"
        )
    now = now_ms()
    click.echo(f"{code_of(study, now)}\nvalid until {_day(valid_until_ms(now))} UTC")


def _uses(database: Path, name: str) -> dict[str, Use]:
    """Return what the database knows of a study's invitations, by id; nothing where there is no database."""
    if not database.exists():
        return {}
    from app.storage.reader import Reader
    from app.storage.store import StoreError
    from app.study.invitations import uses_of

    try:
        with closing(Reader.open(database)) as reader:
            return uses_of(reader, name)
    except StoreError as error:
        raise click.ClickException(str(error)) from error


def _write_csv(path: Path, study: Study, rows: list[tuple[str, ...]]) -> None:
    """Write the table for its owner alone: whoever reads a link can take part with it."""
    from marsexplorer.files import to_cell, write_whole

    text = io.StringIO()
    table = [("id", "state", "participant", "link"), *rows]
    csv.writer(text, lineterminator="\n").writerows(map(to_cell, row) for row in table)
    try:
        with write_whole(path) as file:
            os.fchmod(file.fileno(), 0o600)
            file.write(text.getvalue().encode())
    except OSError as error:
        raise click.ClickException(
            f"cannot write {path} for {study.name}: {reason(error)}"
        ) from error


def _day(ms: int) -> str:
    return datetime.fromtimestamp(ms / 1000, UTC).strftime("%Y-%m-%d %H:%M")
