"""The command `python -m research.paper`: the paper's experiments, by figure."""

from __future__ import annotations

import json
import signal
from collections.abc import Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click

from humanplay.command.console import print_table, progress
from humanplay.command.options import PATH
from humanplay.jobs import cores
from marsexplorer.config import EnvConfig
from marsexplorer.policies import PolicyFileError, PolicyNotFoundError
from research.paper.algorithms import missing_tianshou
from research.paper.episodes.play import gather
from research.paper.figures import figure4, figure5, figure6, figure7
from research.paper.figures.curves import (
    TABLE_COLUMNS,
    Record,
    add_records,
    cells_of,
    read_exported,
    read_records,
    rows_of,
    write_table,
)
from research.paper.jobs import ERROR_FILE, BusyError, Job, run_jobs
from research.paper.plan import (
    BUDGETS,
    FIGURES,
    LEVEL,
    SIZE,
    TRAINED,
    Request,
    disagreement,
    plan,
    records_of_figure,
)
from research.paper.trial import Trial, carry

AT_LEAST_1, AT_LEAST_2 = click.IntRange(min=1), click.IntRange(min=2)
REPORT_FORMAT = "humanplay-report-1"


@click.command(context_settings={"show_default": True})
@click.option(
    "--figure",
    type=click.Choice([*FIGURES, "all"]),
    required=True,
    help="Figure of the paper, or all of them.",
)
@click.option(
    "--budget",
    type=click.Choice([*BUDGETS]),
    default="small",
    help="small does figure 4 in half an hour on two cores, full in some hours; authors has trainings as long as theirs.",
)
@click.option(
    "--algorithms",
    multiple=True,
    help="ppo, a2c, rainbow, sac; repeatable, or with commas.  [default: all that have the variant]",
)
@click.option(
    "--variants",
    multiple=True,
    help="paper, works, tuned, works-no-CHANGE ...; repeatable, or with commas.  "
    "[default: paper,works; figure 5: paper]",
)
@click.option(
    "--policy",
    "policies",
    multiple=True,
    help="For figures 6 and 7 besides theirs: a name or file; repeatable.",
)
@click.option("--seeds", type=click.IntRange(1, 100), default=3, help="Trainings of each kind.")
@click.option("--moves", type=AT_LEAST_1, help="Of every training, in place of the budget's.")
@click.option(
    "--terrains",
    type=AT_LEAST_2,
    help="Held-out terrains to measure on, in place of the budget's.",
)
@click.option("--out", type=PATH, help="Folder of the results.  [default: runs/paper-BUDGET]")
@click.option("--workers", type=AT_LEAST_1, help="Processes at a time.  [default: all cores]")
@click.option(
    "--human-level",
    "human_file",
    type=PATH,
    help="JSON of a closed study's report, for the line of people in figure 4.",
)
@click.option("--list", "is_list", is_flag=True, help="List what there is to do, and do nothing.")
@click.option("--draw", "is_draw", is_flag=True, help="Train nothing: draw what is done in --out.")
@click.option(
    "--export",
    type=PATH,
    help="Train nothing: write what is finished in --out to small files in this folder, beside what it has of other "
    "trainings and policies, and how far the others are.",
)
@click.option(
    "--redraw",
    type=PATH,
    help="Train nothing: draw from a folder that --export wrote into --out.",
)
def paper(
    figure: str,
    budget: str,
    algorithms: tuple[str, ...],
    variants: tuple[str, ...],
    policies: tuple[str, ...],
    seeds: int,
    moves: int | None,
    terrains: int | None,
    out: Path | None,
    workers: int | None,
    human_file: Path | None,
    is_list: bool,
    is_draw: bool,
    export: Path | None,
    redraw: Path | None,
) -> None:
    """Repeat an experiment of the paper: train, measure, draw it, print its table.

    The policies are measured on terrains that were not trained on.

    Every training is one job on one core with a folder of its own in --out. The jobs run in the
    order of their seeds, so a run that is stopped leaves a whole with fewer seeds. The same command
    goes on from there: what is done is not done again, and --seeds 5 adds two trainings of each
    kind to three.

    A training that is stopped by Ctrl-C or SIGTERM goes on exactly where it was, here and, by what
    --export wrote, on another machine.

    Figures 6 and 7 have the policies that were trained in --out too.

    \b
    Examples:
      python -m research.paper --figure 4                              small: half an hour on two cores
      python -m research.paper --figure 4 --budget full --list         what that would do
      python -m research.paper --figure 4 --algorithms ppo --variants works --seeds 5
      python -m research.paper --figure 4 --budget authors --variants paper
      python -m research.paper --figure 4 --redraw research/paper/data --out pictures
    """
    figures = FIGURES if figure == "all" else (figure,)
    folder = out or Path("runs") / f"paper-{budget}"
    try:
        if redraw is not None:
            check_exported(figures, redraw)
            show_figures(figures, redraw, folder, human_file)
        elif export is not None:
            export_results(figures, folder, export)
        elif is_draw:
            show_figures(figures, folder, folder, human_file)
        else:
            names, kinds = _names(algorithms), _names(variants)
            request = Request(figures, budget, names, kinds, seeds, moves, terrains, policies)
            jobs = _plan(request, folder)
            if is_list:
                for job in jobs:
                    click.echo(f"{job.name}{': done' if job.is_done(folder) else ''}")
                click.echo(_outlook(jobs, folder))
                return
            _check_installed(jobs, folder)
            signal.signal(signal.SIGTERM, signal.default_int_handler)
            failures = _run_all(request, folder, workers or cores())
            show_figures(figures, folder, folder, human_file)
            _complain(failures, folder)
    except OSError as error:
        raise click.ClickException(
            f"cannot use {error.filename or folder}: {error.strerror}; choose another"
        ) from error
    except ValueError as error:
        raise click.UsageError(str(error)) from error


def _names(options: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for option in options for name in option.split(",") if name))


def _plan(request: Request, folder: Path) -> list[Job]:
    """The jobs; UsageError if one cannot be done, or `folder` has other options."""
    try:
        jobs = plan(request, folder)
    except (PolicyNotFoundError, PolicyFileError) as error:
        raise click.UsageError(str(error)) from error
    if (sentence := disagreement(jobs, folder)) is not None:
        raise click.UsageError(sentence)
    return jobs


def _check_installed(jobs: list[Job], folder: Path) -> None:
    """Raise UsageError if a training needs tianshou and it is not installed."""
    trials = [job for job in jobs if isinstance(job, Trial) and not job.is_done(folder)]
    wanted = sorted({trial.algorithm for trial in trials} - {"ppo"})
    if wanted and find_spec("tianshou") is None:
        raise click.UsageError(missing_tianshou(wanted))


def _outlook(jobs: list[Job], folder: Path) -> str:
    to_do = sum(not job.is_done(folder) for job in jobs)
    return f"{to_do} of {len(jobs)} jobs to do in {folder}"


def _run_all(request: Request, folder: Path, workers: int) -> dict[str, str]:
    """Run the jobs, then those of the policies just trained; return job -> error.

    Figures 6 and 7 have jobs for these policies.
    """
    failures: dict[str, str] = {}
    tried: set[str] = set()
    while jobs := [job for job in _plan(request, folder) if job.name not in tried]:
        tried |= {job.name for job in jobs}
        click.echo(_outlook(jobs, folder), err=True)
        try:
            with progress("jobs") as advance:
                failures |= run_jobs(jobs, folder, workers, advance)
        except BusyError as error:
            raise click.ClickException(str(error)) from error
        except KeyboardInterrupt:
            click.echo(
                f"stopped; {folder} keeps what is done and how far trainings are; the same command goes on",
                err=True,
            )
            raise
    return failures


def _complain(failures: dict[str, str], folder: Path) -> None:
    """Raise ClickException in one sentence if jobs failed."""
    if failures:
        name, error = next(iter(failures.items()))
        raise click.ClickException(
            f"failed: {', '.join(failures)}; {name}: {error} ({folder / name / ERROR_FILE} says where); "
            "the others are done, and the same command tries again"
        )


def check_exported(figures: Sequence[str], source: Path) -> None:
    """Raise ValueError if a folder has no file of the figures that --export wrote."""
    names = [f"figure{figure}*.jsonl" for figure in figures]
    if not any(path for name in names for path in source.glob(name)):
        raise ValueError(
            f"{source} holds none of: {', '.join(names)}; give a folder that --export wrote"
        )


def show_figures(
    figures: Sequence[str], source: Path, folder: Path, human_file: Path | None
) -> None:
    """Draw the finished figures of `source` into `folder`; print and write tables.

    source  the folder of a run, which is drawn into itself, or one that --export wrote
    """
    human = read_human_level(human_file) if human_file else None
    for figure in figures:
        if figure in TRAINED:
            exported = source / f"figure{figure}.jsonl"
            records = read_records(source) if source == folder else read_exported(exported)
            _show_trials(figure, records_of_figure(figure, records), source, folder, human)
        else:
            _show_plays(figure, source, folder)


def _show_trials(
    figure: str,
    records: Sequence[Record],
    source: Path,
    folder: Path,
    human: figure4.HumanLevel | None,
) -> None:
    """Draw figure 4 or 5 into `folder`; print and write its table.

    source  has what was measured without training
    """
    if not records:
        click.echo(f"figure {figure}: no training is finished in {source}")
        return
    rows = rows_of(records)
    title = f"Figure {figure}, {rows[0].terrains} held-out terrains each: mean over seeds ± half of the 95 % t interval"
    print_table(title, TABLE_COLUMNS, [cells_of(row) for row in rows])
    is_4 = figure == "4"
    pictures = (
        figure4.draw(records, folder, human) if is_4 else figure5.draw(records, source, folder)
    )
    for path in [*pictures, *write_table(rows, folder / f"figure{figure}")]:
        click.echo(path)
    if is_4 and human is None:
        click.echo(
            "No line for people: no closed study was given (--human-level FILE, its report's JSON)."
        )


def _show_plays(figure: str, source: Path, folder: Path) -> None:
    """Draw figure 6 or 7 of `source` into `folder`; print its table."""
    try:
        paths = (figure6 if figure == "6" else figure7).draw(source, folder)
    except FileNotFoundError:
        click.echo(f"figure {figure}: nothing is finished in {source}")
        return
    for path in paths:
        click.echo(path.read_text() if path.suffix == ".md" else path)


def export_results(figures: Sequence[str], folder: Path, target: Path) -> None:
    """Write what is finished in `folder` to `target`.

    That is figureN.jsonl of trainings and figureN-POLICY.jsonl of plays. Trainings of other kinds,
    and files of other policies, that `target` has from earlier runs stay. The checkpoints of
    unfinished trainings go to target/checkpoints.
    """
    for figure in figures:
        paths = []
        records = records_of_figure(figure, read_records(folder)) if figure in TRAINED else []
        if records:
            paths.append(add_records(records, target / f"figure{figure}.jsonl"))
        with suppress(FileNotFoundError):  # figure 4 has no plays, and the others may have none yet
            paths += gather(folder, int(figure), target)
        for path in paths:
            click.echo(f"{path}: {path.stat().st_size / 1000:.0f} kB")
        if not paths:
            click.echo(f"figure {figure}: nothing is finished in {folder}")
    for sentence in carry(folder, target / "checkpoints"):
        click.echo(sentence)


def read_human_level(path: Path) -> figure4.HumanLevel:
    """The human level in a report's JSON.

    ValueError if it is not of a closed study with people on this level.
    """
    report = _read_report(path)
    played, config = EnvConfig(**report["protocol"]["config"]), EnvConfig.of(LEVEL, SIZE)
    if played != config:
        was, needed = (
            f"level {environment.level}, {environment.rows}x{environment.cols} ({environment.hash[:8]})"
            for environment in (played, config)
        )
        raise ValueError(f"{path} is of a study on {was}; figure 4 needs one on {needed}")
    for group in report["groups"]:
        figure = next(
            estimate for estimate in group["figures"] if estimate["name"] == group["primary"]
        )
        if group["kind"] == "human" and (score := figure["score"]) is not None:
            low, high = score["interval"] or (None, None)
            return figure4.HumanLevel(report["study"], figure["players"], score["mean"], low, high)
    raise ValueError(f"nobody has played the study of {path} to its end, so it has no human level")


def _read_report(path: Path) -> dict[str, Any]:
    """A report; ValueError if the file holds none, or one that is not about people."""
    report: Any = None
    with suppress(ValueError):
        report = json.loads(path.read_text())
    if not isinstance(report, dict) or report.get("format") != REPORT_FORMAT:
        raise ValueError(
            f"{path} is no report; write it with: humanplay report --study NAME --json {path}"
        )
    if report["synthetic"]:
        raise ValueError(f"{path} is of scripts, and says nothing about people")
    if report["status"] != "closed":
        raise ValueError(
            f"the study of {path} is {report['status']}; only a closed study gives a human level"
        )
    return report


if __name__ == "__main__":
    paper(prog_name="python -m research.paper")
