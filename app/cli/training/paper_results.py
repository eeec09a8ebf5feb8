"""What `marsexplorer paper` shows and writes of finished trainings: pictures, tables, exports."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from app.cli.console import print_table

if TYPE_CHECKING:
    from marsexplorer.paper.figures.curves import Record
    from marsexplorer.paper.figures.figure4 import HumanLevel

REPORT_FORMAT = "marsexplorer-report-1"
TRAINED = {"4", "5"}
"""The figures that are of trainings; the others are of policies at play."""
NO_HUMAN_LINE = (
    "No line for people: no closed study was given (--human-level FILE, the JSON of its report)."
)


def show_figures(figures: Sequence[str], folder: Path, human_file: Path | None) -> None:
    """Draw the figures from what is finished in `folder`, and print and write their tables."""
    from marsexplorer.paper.figures.curves import read_records

    human = read_human_level(human_file) if human_file else None
    records = read_records(folder) if TRAINED & set(figures) else []
    for figure in figures:
        if figure in TRAINED:
            _show_trials(figure, records_of_figure(figure, records), folder, folder, human)
        else:
            _show_plays(figure, folder, folder)


def _show_trials(
    figure: str, own: Sequence[Record], source: Path, folder: Path, human: HumanLevel | None
) -> None:
    """Draw figure 4 or 5 into `folder` and print and write its table; `source` has what was measured without training."""
    from marsexplorer.paper.figures import figure4, figure5
    from marsexplorer.paper.figures.trained_table import (
        TABLE_COLUMNS,
        cells_of,
        rows_of,
        write_table,
    )

    if not own:
        click.echo(f"figure {figure}: no training is finished in {source}")
        return
    rows = rows_of(own)
    print_table(
        f"Figure {figure}, {rows[0].terrains} held-out terrains each: mean over seeds ± half of the 95 % t interval",
        TABLE_COLUMNS,
        [cells_of(row) for row in rows],
    )
    levels = figure5.read_difficulty(source)
    pictures = (
        figure4.draw(own, folder, human) if figure == "4" else figure5.draw(own, levels, folder)
    )
    for path in [*pictures, *write_table(rows, folder / f"figure{figure}")]:
        click.echo(path)
    if figure == "4" and human is None:
        click.echo(NO_HUMAN_LINE)


def _show_plays(figure: str, source: Path, folder: Path) -> None:
    """Draw figure 6 or 7 from the results in `source` into `folder`, and print its table."""
    from marsexplorer.paper.figures import figure6, figure7

    try:
        paths = (figure6 if figure == "6" else figure7).draw(source, folder)
    except FileNotFoundError:
        click.echo(f"figure {figure}: nothing is finished in {source}")
        return
    for path in paths:
        if path.suffix == ".md":
            click.echo(path.read_text())
    for path in paths:
        click.echo(path)


def records_of_figure(figure: str, records: Sequence[Record]) -> list[Record]:
    """Return the trials that a figure is drawn from: 4 has those on level random, 5 those of PPO on the 12 levels."""
    from marsexplorer.paper.plan import DIFFICULTIES, LEVEL

    if figure == "4":
        return [record for record in records if record.trial.level == LEVEL]
    return [
        record
        for record in records
        if record.trial.level in DIFFICULTIES and record.trial.algorithm == "ppo"
    ]


def export_results(figures: Sequence[str], folder: Path, target: Path) -> None:
    """Write what is finished in `folder` to `target`: figureN.jsonl of trainings, figureN-POLICY.jsonl of plays.

    Trainings of other kinds, and files of other policies, that `target` has from earlier runs stay.
    """
    from marsexplorer.paper.episodes.gathered import gather
    from marsexplorer.paper.figures.curves import read_records
    from marsexplorer.paper.figures.export import add_records

    records = read_records(folder) if TRAINED & set(figures) else []
    for figure in figures:
        paths = []
        if own := records_of_figure(figure, records):
            paths.append(add_records(own, target / f"figure{figure}.jsonl"))
        with suppress(FileNotFoundError):  # figure 4 has no plays, and the others may have none yet
            paths += gather(folder, int(figure), target)
        if not paths:
            click.echo(f"figure {figure}: nothing is finished in {folder}")
        for path in paths:
            click.echo(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def draw_exported(
    figures: Sequence[str], source: Path, folder: Path, human_file: Path | None
) -> None:
    """Draw and tabulate the figures whose files lie in `source` into `folder`; ValueError when there is none."""
    from marsexplorer.paper.figures.export import read_exported

    human = read_human_level(human_file) if human_file else None
    found = [figure for figure in figures if any(source.glob(f"figure{figure}*.jsonl"))]
    if not found:
        names = ", ".join(f"figure{figure}*.jsonl" for figure in figures)
        raise ValueError(f"{source} holds none of: {names}; give a folder that --export wrote")
    folder.mkdir(parents=True, exist_ok=True)
    for figure in found:
        if figure in TRAINED:
            path = source / f"figure{figure}.jsonl"
            _show_trials(
                figure, read_exported(path) if path.is_file() else [], source, folder, human
            )
        else:
            _show_plays(figure, source, folder)


def read_human_level(path: Path) -> HumanLevel:
    """Return the human level in the JSON of a report; ValueError when it is not of a closed study with people on this level."""
    from marsexplorer.config import EnvConfig
    from marsexplorer.paper.figures.figure4 import HumanLevel
    from marsexplorer.paper.plan import LEVEL, SIZE

    report = _read_report(path)
    if (played := EnvConfig(**report["protocol"]["config"])) != (
        config := EnvConfig.of(LEVEL, SIZE)
    ):
        was, needed = (
            f"level {each.level}, {each.rows}x{each.cols} ({each.hash[:8]})"
            for each in (played, config)
        )
        raise ValueError(f"{path} is of a study on {was}; figure 4 needs one on {needed}")
    for group in report["groups"]:
        figure = next(each for each in group["figures"] if each["name"] == group["primary"])
        if group["kind"] == "human" and figure["score"] is not None:
            score = figure["score"]
            low, high = score["interval"] or (None, None)
            return HumanLevel(report["study"], figure["players"], score["mean"], low, high)
    raise ValueError(f"nobody has played the study of {path} to its end, so it has no human level")


def _read_report(path: Path) -> dict[str, Any]:
    """Return a report; ValueError when the file holds none, or one that may not stand for people."""
    try:
        report: dict[str, Any] = json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(
            f"{path} is no JSON; write it with: marsexplorer report --study NAME --json {path}"
        ) from error
    if not isinstance(report, dict) or report.get("format") != REPORT_FORMAT:
        raise ValueError(
            f"{path} is no report; write it with: marsexplorer report --study NAME --json {path}"
        )
    if report["synthetic"]:
        raise ValueError(f"{path} is of scripts, and says nothing about people")
    if report["status"] != "closed":
        raise ValueError(
            f"the study of {path} is {report['status']}; only a closed study gives a human level"
        )
    return report
