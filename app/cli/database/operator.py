"""The command `marsexplorer operator`: who may log in at /admin by name, and what they did."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import click

from app.cli.console import PATH, print_table, settings_of

DATABASE = click.option(
    "--database",
    type=PATH,
    help="The database that the server records in, if it is not the default one.",
)


@click.group(short_help="Let operators log in at /admin by name.")
def operator() -> None:
    """Add, list and remove the operators who may log in at /admin by name.

    The password MARS_ADMIN_PASSWORD of a server stays valid beside them. A server that is started with an operator in its
    database has the page /admin. Operators are added and removed while it runs; whoever is removed is logged out at once.

    \b
    Examples:
      marsexplorer operator add ada
      marsexplorer operator list
      marsexplorer operator log                   what operators did, the newest first
      marsexplorer operator remove ada
    """


@operator.command(short_help="Add an operator.")
@click.argument("name")
@DATABASE
def add(name: str, database: Path | None) -> None:
    """Add an operator; the password is asked for twice, or is the first line of standard input where that is no terminal."""
    from app.storage.operators import add_operator

    path = database or settings_of().database
    if sys.stdin.isatty():
        password = click.prompt("Password", hide_input=True, confirmation_prompt=True, err=True)
    else:
        password = sys.stdin.readline().rstrip("\n")
    with _errors():
        add_operator(path, name, password)
    click.echo(
        f"{name} may log in at /admin of the server that records in {path}; one without that page needs a new start"
    )


@operator.command("list", short_help="List the operators.")
@DATABASE
def list_(database: Path | None) -> None:
    """List the operators: by name, and since when."""
    from app.storage.operators import list_operators

    with _errors():
        found = list_operators(database or settings_of().database)
    rows = [(each.name, _time(each.created_ms)) for each in found]
    print_table("Operators", ("name", "since (UTC)"), rows)


@operator.command(short_help="Remove an operator.")
@click.argument("name")
@DATABASE
def remove(name: str, database: Path | None) -> None:
    """Remove an operator; what they did stays in the log."""
    from app.storage.operators import remove_operator

    path = database or settings_of().database
    with _errors():
        remove_operator(path, name)
    click.echo(f"{name} cannot log in any more")


@operator.command(short_help="Print what operators did.")
@click.option(
    "--count", type=click.IntRange(1), default=100, show_default=True, help="Actions to print."
)
@DATABASE
def log(count: int, database: Path | None) -> None:
    """Print the newest actions of operators, with the status of the server's answer (200 to 299: done)."""
    from app.storage.operators import read_actions

    with _errors():
        found = read_actions(database or settings_of().database, count)
    rows = [
        (
            _time(each["at_ms"]),
            each["operator"],
            each["action"],
            each["study"] or "",
            str(each["status"] or "not ended"),
        )
        for each in found
    ]
    print_table("What operators did", ("time (UTC)", "operator", "action", "study", "status"), rows)


@contextmanager
def _errors() -> Iterator[None]:
    """Turn what is wrong with the name, the password or the database into one sentence."""
    from app.storage.database import StoreError
    from app.storage.operators import OperatorError

    try:
        yield
    except OperatorError as error:
        raise click.UsageError(str(error)) from error
    except StoreError as error:
        raise click.ClickException(str(error)) from error


def _time(at_ms: int) -> str:
    return datetime.fromtimestamp(at_ms / 1000, UTC).strftime("%Y-%m-%d %H:%M:%S")
