"""The command `marsexplorer regret`: where the players of a study lose moves."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import PATH, print_table, progress, reason, settings_of

if TYPE_CHECKING:
    from app.moves.regret import RegretSummary
    from app.storage.reader import Reader
    from app.study.data import StudyData


@click.command(short_help="Where the players of a study lose moves.")
@click.option("--study", "name", required=True, metavar="NAME", help="The study.")
@click.option("--database", type=PATH, help="The database it was played in.")
@click.option(
    "--studies",
    type=PATH,
    help="The folder of studies.  [default: data/studies in a checkout, ./studies elsewhere]",
)
@click.option(
    "--json",
    "json_path",
    type=PATH,
    help="Write the summary and every move with its regret to this file.",
)
def regret(name: str, database: Path | None, studies: Path | None, json_path: Path | None) -> None:
    """Print the mean regret per episode of each player, and in which moves it lies.

    The regret of a move is how many moves sooner 99 % would have been discovered after the best action, the policy ppo
    going on from there; docs/evaluation.md says what that is worth. The ranked episodes are taken once the study is closed,
    and the warm-up before. It takes about a second an episode the first time, and is kept next to the database.

    \b
    Examples:
      marsexplorer regret --study pilot
      marsexplorer regret --study pilot --json regret.json
    """
    from app.report.making import load_with_folder
    from app.storage.database import StoreError
    from app.storage.reader import Reader
    from app.study.protocol import StudyError
    from marsexplorer.files import write_whole

    settings = settings_of()
    path = database or settings.database
    try:
        reader = Reader.open(path)
        try:
            data, _ = load_with_folder(reader, studies or settings.studies, name)
            summary, rows = _work_out(reader, data, path)
        finally:
            reader.close()
    except StudyError as error:
        raise click.UsageError(str(error)) from error
    except (StoreError, ValueError) as error:
        raise click.ClickException(str(error)) from error
    _show(data, summary)
    if json_path is not None:
        try:
            with write_whole(json_path) as file:
                file.write(
                    json.dumps(
                        {"study": name, "summary": asdict(summary), "moves": rows}, indent=1
                    ).encode()
                    + b"\n"
                )
        except OSError as error:
            raise click.ClickException(
                f"cannot write {json_path}: {reason(error)}; choose another file"
            ) from error


def _work_out(
    reader: Reader, data: StudyData, database: Path
) -> tuple[RegretSummary, list[dict[str, object]]]:
    """Return the summary over everybody who played, under pseudonyms, and every move as a dictionary."""
    from app.moves.regret import regret_cache, regret_rows, study_estimator, summarize_regret
    from app.statistics.exclusion_sets import members, people_of
    from marsexplorer.evaluation.regret import check_size

    check_size(data.protocol.env_config)
    cohort, estimator = people_of(data), study_estimator(data, regret_cache(database))
    ids = (
        members(cohort, {})
        if data.closed_ms is not None
        else sorted(person for person, own in cohort.warm_up.items() if own)
    )
    with progress("regret of each move") as advance:
        summary = summarize_regret(reader, data, cohort, ids, estimator, advance)
    if summary is None:
        raise click.ClickException(
            f"nobody's finished episode of {data.protocol.name!r} can be shown yet"
        )
    names = {person: f"P{number:02d}" for number, person in enumerate(ids, 1)}
    own = cohort.ranked if summary.phase == "ranked" else cohort.warm_up
    rows: list[dict[str, object]] = [
        {"player": names[person], **asdict(row)}
        for person in ids
        for row in regret_rows(reader, data, own[person], estimator)
    ]
    players = tuple(replace(each, player=names[each.player]) for each in summary.by_player)
    return replace(summary, by_player=players), rows


def _show(data: StudyData, found: RegretSummary) -> None:
    """Print a row for each player, and the means."""
    from app.statistics.formatting import interval, number, percent

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
