"""The commands `report` and `costs`."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click import ClickException, UsageError, echo, option

from humanplay.cli.options import DATABASE_AND_STUDIES
from humanplay.cli.settings import failures, study_errors
from humanplay.command.console import print_table, progress, write_file
from humanplay.command.options import flag, path_option

if TYPE_CHECKING:
    from humanplay.report.costs import CostSummary
    from humanplay.report.model import GroupReport, Report
    from humanplay.study.data import StudyData
    from humanplay.study.folder import Folder


@click.command(short_help="A study's figures with their intervals, as a page and as JSON.")
@option("--study", "name", required=True, metavar="NAME", help="The study.")
@DATABASE_AND_STUDIES
@path_option("--html", "Write the report to this file, its methods and checklist beside it.")
@path_option("--json", "json_path", "Write every number to this file.")
@flag("--synthetic", "Report over the scripts instead of the people, marked SYNTHETIC throughout.")
@flag("--no-policies", "Play no policies: no comparisons, done in a second.")
@flag("--no-moves", "Leave out the cost of each move: done sooner.")
def report(
    name: str, database: Path, html: Path | None, json_path: Path | None, folder: Folder, synthetic: bool,
    no_policies: bool, no_moves: bool,
) -> None:  # fmt: skip
    """Print a study's figures: its people's, and policies on the same terrains.

    The unit is the player: the figure is the mean of the players' means with an interval that is right for few and
    skewed players; docs/statistics.md says how that was measured. Scripts never enter a human score.
    An open study shows how many have finished, and no figure and no page before it is closed.

    \b
    Examples:
      humanplay report --study pilot
      humanplay report --study pilot --html pilot.html --json pilot.json
      humanplay report --study rehearsal --synthetic --html rehearsal.html
    """
    from humanplay.report.making import make_study_report
    from humanplay.report.page import pages
    from humanplay.task import PolicyError

    wanted = synthetic, not no_policies, not no_moves
    try:
        with failures(f"cannot read {database}"), study_errors():
            study_report = make_study_report(database, folder, name, progress, *wanted)
    except PolicyError as error:
        raise ClickException(
            f"{error}; or leave the comparisons out with --no-policies, and the moves with --no-moves"
        ) from error
    if html is not None and study_report.status == "open" and not synthetic:
        raise UsageError(
            f"the study {name!r} is open and has no figures to put on a page: close it (`humanplay study close {name}`), "
            "or leave --html out to see how many have finished"
        )
    if html is not None:
        for file, page in pages(study_report, html.name).items():
            write_file(html.with_name(file), page.encode())
    if json_path is not None:
        write_file(json_path, study_report.to_json().encode() + b"\n")
    show(study_report)


def show(study_report: Report) -> None:
    """Print the report on the terminal."""
    protocol = f"protocol {study_report.protocol_hash[:12]}"
    echo(f"{study_report.title} ({study_report.study}, {study_report.status}, {protocol})")
    echo(study_report.sentence)
    for group in study_report.groups:
        _show_group(study_report, group)
    for line in study_report.deviations:
        echo(f"- {line}")


def _show_group(study_report: Report, group: GroupReport) -> None:
    """Print a group's tables as on the page, then deviations and cautions."""
    from humanplay.report.tables import group_tables

    mark = "SYNTHETIC, script " if study_report.synthetic else ""
    tables = group_tables(study_report, group)
    titles = {
        "exclusion_sets": f"{mark}{group.name}: means over players",
        "statuses": f"{mark}{group.name}: everybody who came",
        "policies": f"{mark}policies on the same instances, beside {group.name}",
        "score": f"{mark}score: policies minus {group.name}",
        "steps": f"{mark}steps: policies minus {group.name}",
    }
    for name in (*titles, "costs"):
        if (table := tables[name]) is not None and table.rows:
            print_table(titles.get(name, table.caption), table.heads, table.rows)
    for line in (*group.deviations, *group.cautions):
        echo(f"- {line}")


@click.command(short_help="Where the players of a study lose moves.")
@option("--study", "name", required=True, metavar="NAME", help="The study.")
@DATABASE_AND_STUDIES
@path_option("--json", "json_path", "Write the summary and every move's cost to this file.")
def costs(name: str, database: Path, folder: Folder, json_path: Path | None) -> None:
    """Print the mean cost per episode of each player, and in which moves it lies.

    The cost of a move is how much longer it makes the whole episode if the policy ppo plays on (docs/evaluation.md).
    The ranked episodes are taken once the study is closed, and the warm-up before. Costs are kept next to the database.

    \b
    Examples:
      humanplay costs --study pilot
      humanplay costs --study pilot --json costs.json
    """
    from humanplay.db.reader import Reader
    from humanplay.report.costs import costs_of_study
    from humanplay.report.making import load_with_folder

    try:
        with (
            failures(f"cannot read {database}"),
            study_errors(),
            closing(Reader.open(database)) as reader,
            progress("cost of each move") as advance,
        ):
            data, _ = load_with_folder(reader, folder, name)
            summary, rows = costs_of_study(reader, data, advance)
    except ValueError as error:
        raise ClickException(str(error)) from error
    _show_costs(data, summary)
    if json_path is not None:
        figures = {"study": name, "summary": asdict(summary), "moves": rows}
        write_file(json_path, json.dumps(figures, indent=1).encode() + b"\n")


def _show_costs(data: StudyData, summary: CostSummary) -> None:
    """Print a row for each player, and the means."""
    from humanplay.report.tables import cost_table, costs_by_player

    phase = "ranked" if summary.phase == "ranked" else "warm-up"
    title = f"{data.protocol.name}: cost per {phase} episode, moves"
    players, table = costs_by_player(summary), cost_table(summary)
    print_table(title, players.heads, players.rows)
    print_table(table.caption, table.heads, table.rows)
