"""The command `marsexplorer regret`: where the players of a study lose moves."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click import option

from app.cli.console import (
    DATABASE,
    PATH,
    STUDIES,
    failures,
    print_table,
    progress,
    study_errors,
    write_file,
)

if TYPE_CHECKING:
    from app.report.moves.regret import RegretSummary
    from app.series.data import StudyData
    from app.series.folder import Folder


@click.command(short_help="Where the players of a study lose moves.")
@option("--study", "name", required=True, metavar="NAME", help="The study.")
@DATABASE
@STUDIES
@option(
    "--json",
    "json_path",
    type=PATH,
    help="Write the summary and every move with its regret to this file.",
)
def regret(name: str, database: Path, folder: Folder, json_path: Path | None) -> None:
    """Print the mean regret per episode of each player, and in which moves it lies.

    The regret of a move is how many moves sooner 99 % would have been discovered after the best action, the policy ppo
    going on from there; docs/evaluation.md says what that is worth. The ranked episodes are taken once the study is closed,
    and the warm-up before. It takes about a second an episode the first time, and is kept next to the database.

    \b
    Examples:
      marsexplorer regret --study pilot
      marsexplorer regret --study pilot --json regret.json
    """
    from app.db.reader import Reader
    from app.report.making import load_with_folder
    from app.report.moves.regret import regret_of_study

    try:
        with (
            failures(f"cannot read {database}"),
            study_errors(),
            closing(Reader.open(database)) as reader,
            progress("regret of each move") as advance,
        ):
            data, _ = load_with_folder(reader, folder, name)
            summary, rows = regret_of_study(reader, data, advance)
    except ValueError as error:
        raise click.ClickException(str(error)) from error
    _show(data, summary)
    if json_path is not None:
        found = {"study": name, "summary": asdict(summary), "moves": rows}
        write_file(json_path, json.dumps(found, indent=1).encode() + b"\n")


def _show(data: StudyData, found: RegretSummary) -> None:
    """Print a row for each player, and the means."""
    from app.report.statistics.formatting import interval, number, percent

    phase = "ranked" if found.phase == "ranked" else "warm-up"
    rows = [
        (
            each.player,
            str(each.episodes),
            number(each.mean, 1),
            *(number(lost, 1) for lost in each.by_kind.values()),
        )
        for each in found.by_player
    ]
    print_table(
        f"{data.protocol.name}: regret per {phase} episode, moves",
        ("player", "episodes", "mean", *found.by_kind),
        rows,
    )
    click.echo(
        f"mean over players: {number(found.mean, 1)} moves an episode (95 % {interval(found.interval, 1)})"
    )
    click.echo(f"{found.policy} itself on the same terrains: {number(found.policy_mean, 1)}")
    click.echo(
        "share: " + ", ".join(f"{kind} {percent(share)}" for kind, share in found.by_kind.items())
    )
    tenths = (
        f"{10 * tenth}-{10 * tenth + 10} %: {number(lost, 1)}"
        for tenth, lost in enumerate(found.by_tenth)
        if lost
    )
    click.echo("by what was known before the move: " + ", ".join(tenths))
