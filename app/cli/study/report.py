"""The commands `report` and `regret`: a study's figures as a page, as JSON, on the terminal; where players lose moves."""

from __future__ import annotations

import json
import math
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click import ClickException, UsageError, echo, option

from app.cli.console import failures, print_table, progress, study_errors, write_file
from app.cli.options import DATABASE, STUDIES, flag, path_option

if TYPE_CHECKING:
    from app.report.model import GroupReport, Report
    from app.report.regret import RegretSummary
    from app.series.data import StudyData
    from app.series.folder import Folder


@click.command(short_help="A study's figures with their intervals, as a page and as JSON.")
@option("--study", "name", required=True, metavar="NAME", help="The study.")
@DATABASE
@path_option("--html", "Write the report to this file: one page, nothing outside it.")
@path_option("--json", "json_path", "Write every number to this file.")
@STUDIES
@flag("--synthetic", "Report over the scripts instead of the people, marked SYNTHETIC throughout.")
@flag("--no-policies", "Play no policies: no comparisons, done in a second.")
@flag("--no-moves", "Leave out the regret of each move: done sooner.")
def report(
    name: str, database: Path, html: Path | None, json_path: Path | None, folder: Folder, synthetic: bool,
    no_policies: bool, no_moves: bool,
) -> None:  # fmt: skip
    """Print a study's figures: that of its people with its interval, and policies on the same terrains.

    The unit is the player: the figure is the mean of the players' means with an interval that is right for few and
    skewed players; docs/report.md says how that was measured. Scripts never enter a human figure.
    An open study shows how many have finished, and no figure and no page before it is closed.

    \b
    Examples:
      marsexplorer report --study pilot
      marsexplorer report --study pilot --html pilot.html --json pilot.json
      marsexplorer report --study rehearsal --synthetic --html rehearsal.html
    """
    from app.report.making import make_study_report
    from app.report.page import render
    from app.task import PolicyError

    wanted = synthetic, not no_policies, not no_moves
    try:
        with failures(f"cannot read {database}"), study_errors():
            found = make_study_report(database, folder, name, progress, *wanted)
    except PolicyError as error:
        raise ClickException(
            f"{error}; or leave the comparisons out with --no-policies, and the moves with --no-moves"
        ) from error
    if html is not None and found.status == "open" and not synthetic:
        raise UsageError(
            f"the study {name!r} is open and has no figures to put on a page: close it (`marsexplorer study close {name}`), "
            "or leave --html out to see how many have finished"
        )
    if html is not None:
        write_file(html, render(found).encode())
    if json_path is not None:
        write_file(json_path, found.to_json().encode() + b"\n")
    show(found)


def show(found: Report) -> None:
    """Print the report on the terminal."""
    about = f"{found.study}, {found.status}, protocol {found.protocol_hash[:12]}"
    echo(f"{found.title} ({about})")
    echo(found.sentence)
    for group in found.groups:
        _show_group(found, group)
    for line in found.deviations:
        echo(f"- {line}")


def _show_group(found: Report, group: GroupReport) -> None:
    """Print a group's figures, comparisons, deviations and cautions."""
    mark = "SYNTHETIC, script " if found.synthetic else ""
    _print_figures(mark, group)
    _print_comparisons(mark, found, group)
    _print_second_analysis(mark, group)
    _print_regret(group)
    for line in (*group.deviations, *group.cautions):
        echo(f"- {line}")


def _print_figures(mark: str, group: GroupReport) -> None:
    """Print the figure under each exclusion set; nothing where no set has players."""
    from app.report.statistics.formatting import interval, number, percent

    rows = []
    for figure in group.figures:
        score, steps, reached = figure.score, figure.steps, figure.completed
        if score and steps and reached:
            mark_of = " (guaranteed)" if score.headline == "guaranteed" else ""
            ends = interval(score.interval, 4) + mark_of, interval(steps.interval, 1) + mark_of
            values = number(score.mean, 4), ends[0], number(steps.mean, 1), ends[1]
            low, high = reached.interval or (math.nan, math.nan)
            share = percent(reached.mean, 1), interval((100 * low, 100 * high), 1)
            rows.append((figure.name, str(figure.players), str(figure.episodes), *values, *share))
    if rows:
        head = "95 % interval"
        words = group.words
        names = (words.score, head, words.steps, head, words.reached, head)
        columns = ("set", "players", "episodes", *names)
        print_table(f"{mark}{group.name}: means over players", columns, rows)


def _print_comparisons(mark: str, found: Report, group: GroupReport) -> None:
    """Print the comparisons in score; nothing where there are none."""
    from app.report.statistics.formatting import interval, number, p_value

    compared = [
        (found.title_of(each.policy), number(each.mean, 4), number(each.difference, 4), interval(each.new, 4),
         p_value(each.p_value), p_value(each.p_adjusted), f"{number(each.ratio, 3)} ({interval(each.ratio_interval, 3)})")
        for each in group.comparisons if each.metric == "score"
    ]  # fmt: skip
    if compared:
        tested = "minus people", "95 %, new terrains too", "p", "p (Holm)"
        heads = ("policy", "score", *tested, "ratio (95 %)")
        print_table(f"{mark}policies on the same terrains, beside {group.name}", heads, compared)


def _print_regret(group: GroupReport) -> None:
    """Print where moves are lost; nothing where that was not worked out."""
    if (found := group.regret) is not None:
        _print_regret_table(found)


def _print_regret_table(found: RegretSummary) -> None:
    from app.report.tables import regret_table

    table = regret_table(found)
    print_table(table.caption, table.heads, table.rows)


def _print_second_analysis(mark: str, group: GroupReport) -> None:
    """Print the mixed model."""
    from app.report.statistics.formatting import interval, number

    models = [metric.mixed_model for metric in group.metrics]
    rows = [
        (each.metric, number(each.mean, 4), interval(each.interval, 4), number(each.slope, 5), interval(each.slope_interval, 5))
        for each in models if each.converged
    ]  # fmt: skip
    if rows:
        heads = ("metric", "mean", "95 %, new terrains too", "slope a trial", "95 % interval")
        print_table(f"{mark}{group.name}: second analysis, mixed model", heads, rows)
    for each in models:
        if not each.converged:
            echo(f"- {each.metric}: {each.note}")


@click.command(short_help="Where the players of a study lose moves.")
@option("--study", "name", required=True, metavar="NAME", help="The study.")
@DATABASE
@STUDIES
@path_option("--json", "json_path", "Write the summary and every move's regret to this file.")
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
    from app.report.regret import regret_of_study

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
        raise ClickException(str(error)) from error
    _show_regret(data, summary)
    if json_path is not None:
        found = {"study": name, "summary": asdict(summary), "moves": rows}
        write_file(json_path, json.dumps(found, indent=1).encode() + b"\n")


def _show_regret(data: StudyData, found: RegretSummary) -> None:
    """Print a row for each player, and the means."""
    from app.report.statistics.formatting import number

    phase = "ranked" if found.phase == "ranked" else "warm-up"
    rows = []
    for each in found.by_player:
        lost = [number(moves, 1) for moves in (each.mean, *each.by_kind.values())]
        rows.append((each.player, str(each.episodes), *lost))
    title = f"{data.protocol.name}: regret per {phase} episode, moves"
    print_table(title, ("player", "episodes", "mean", *found.by_kind), rows)
    _print_regret_table(found)
