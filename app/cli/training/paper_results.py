"""What `marsexplorer paper` shows and writes of finished trainings: pictures, tables, exports."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from app.cli.console import print_table

if TYPE_CHECKING:
    from marsexplorer.paper.curves import Record
    from marsexplorer.paper.figure4 import HumanLevel

REPORT_FORMAT = "marsexplorer-report-1"
NO_HUMAN_LINE = "No line for people: no closed study was given (--human-level FILE, the JSON of its report)."


def show_figures(figures: Sequence[str], folder: Path, human_file: Path | None) -> None:
    """Draw the figures from the trials that are finished in `folder`, and print and write their tables."""
    from marsexplorer.paper.curves import read_records

    records = read_records(folder)
    human = read_human_level(human_file) if human_file else None
    for figure in figures:
        _show_trials(figure, records, folder, human)


def _show_trials(figure: str, records: Sequence[Record], folder: Path, human: HumanLevel | None) -> None:
    """Draw figure 4 or 5, and print and write its table."""
    from marsexplorer.paper import figure4, figure5
    from marsexplorer.paper.trained_table import TABLE_COLUMNS, cells_of, rows_of, write_table

    own = records_of_figure(figure, records)
    if not own:
        click.echo(f"figure {figure}: no training is finished in {folder}")
        return
    rows = rows_of(own)
    print_table(
        f"Figure {figure}, {rows[0].terrains} held-out terrains each: mean over seeds ± half of the 95 % t interval",
        TABLE_COLUMNS,
        [cells_of(row) for row in rows],
    )
    pictures = figure4.draw(own, folder, human) if figure == "4" else figure5.draw(own, folder)
    for path in [*pictures, *write_table(rows, folder / f"figure{figure}")]:
        click.echo(path)
    if figure == "4" and human is None:
        click.echo(NO_HUMAN_LINE)


def records_of_figure(figure: str, records: Sequence[Record]) -> list[Record]:
    """Return the trials that a figure is drawn from: 4 has those on level random, 5 those of PPO on the 12 levels."""
    from marsexplorer.paper.plan import DIFFICULTIES, LEVEL

    if figure == "4":
        return [record for record in records if record.trial.level == LEVEL]
    if figure == "5":
        return [record for record in records if record.trial.level in DIFFICULTIES and record.trial.algorithm == "ppo"]
    return []


def export_trials(figures: Sequence[str], folder: Path, target: Path) -> None:
    """Write figureN.jsonl with the finished trials of `folder` into `target`, for each figure that has some."""
    from marsexplorer.paper.curves import read_records
    from marsexplorer.paper.export import write_records

    records = read_records(folder)
    for figure in figures:
        own = records_of_figure(figure, records)
        if not own:
            click.echo(f"figure {figure}: no training is finished in {folder}")
            continue
        path = write_records(own, target / f"figure{figure}.jsonl")
        click.echo(f"{path}: {len(own)} trainings, {path.stat().st_size / 1000:.0f} kB")


def draw_exported(figures: Sequence[str], source: Path, folder: Path, human_file: Path | None) -> None:
    """Draw and tabulate the figures whose files lie in `source` into `folder`; ValueError when there is none."""
    from marsexplorer.paper.export import read_exported

    human = read_human_level(human_file) if human_file else None
    found = {figure: path for figure in figures if (path := source / f"figure{figure}.jsonl").is_file()}
    if not found:
        names = ", ".join(f"figure{figure}.jsonl" for figure in figures)
        raise ValueError(f"{source} holds none of: {names}; give a folder that --export wrote")
    folder.mkdir(parents=True, exist_ok=True)
    for figure, path in found.items():
        _show_trials(figure, read_exported(path), folder, human)


def read_human_level(path: Path) -> HumanLevel:
    """Return the human level in the JSON of a report; ValueError when it is not of a closed study with people on this level."""
    from marsexplorer.config import EnvConfig
    from marsexplorer.paper.figure4 import HumanLevel
    from marsexplorer.paper.plan import LEVEL, SIZE

    report = _read_report(path)
    if (played := EnvConfig(**report["protocol"]["config"])) != (config := EnvConfig.of(LEVEL, SIZE)):
        was, needed = (f"level {each.level}, {each.rows}x{each.cols} ({each.hash[:8]})" for each in (played, config))
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
        raise ValueError(f"{path} is no JSON; write it with: marsexplorer report --study NAME --json {path}") from error
    if not isinstance(report, dict) or report.get("format") != REPORT_FORMAT:
        raise ValueError(f"{path} is no report; write it with: marsexplorer report --study NAME --json {path}")
    if report["synthetic"]:
        raise ValueError(f"{path} is of scripts, and says nothing about people")
    if report["status"] != "closed":
        raise ValueError(f"the study of {path} is {report['status']}; only a closed study gives a human level")
    return report
