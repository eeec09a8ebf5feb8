"""The command `marsexplorer paper`: the experiments of the paper, each figure with one command."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import PATH, print_table, reason
from app.cli.training.paper_results import draw_exported, export_results, show_figures

if TYPE_CHECKING:
    from marsexplorer.paper.job import Job
    from marsexplorer.paper.plan import Request
    from marsexplorer.paper.scheduling.forecast import Forecast
    from marsexplorer.paper.scheduling.schedule import Failure

PRINT_INTERVAL_S = 15
"""Seconds between two lines where stderr is no terminal."""
FIGURES = ("4", "5", "6", "7", "all")


@dataclass(frozen=True)
class Where:
    """Where jobs run: in `out`, in `workers` processes of this machine; `command` goes on."""

    out: Path
    workers: int
    command: str


@click.command(short_help="Make the experiments of the paper again, a figure with a command.")
@click.option(
    "--figure",
    type=click.Choice(FIGURES),
    required=True,
    help="Figure of the paper, or all of them.",
)
@click.option(
    "--budget",
    type=click.Choice(["small", "full"]),
    default="small",
    show_default=True,
    help="small does figure 4 in half an hour on two cores, full in some hours.",
)
@click.option(
    "--algorithms",
    multiple=True,
    help="ppo, a2c, rainbow, sac; repeatable, or with commas.  [default: all four]",
)
@click.option(
    "--variants",
    multiple=True,
    help="paper, works, tuned, works-no-CHANGE ...; repeatable, or with commas.  [default: paper,works; figure 5: paper]",
)
@click.option(
    "--policy",
    "policies",
    multiple=True,
    help="For figures 6 and 7 besides theirs: a name or file; repeatable.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 100),
    default=3,
    show_default=True,
    help="Trainings of each kind.",
)
@click.option(
    "--moves", type=click.IntRange(min=1), help="Moves of every training, in place of the budget's."
)
@click.option(
    "--terrains",
    type=click.IntRange(min=2),
    help="Held-out terrains to measure on, in place of the budget's.",
)
@click.option("--out", type=PATH, help="Folder of the results.  [default: runs/paper-BUDGET]")
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes at a time.  [default: one for each core]",
)
@click.option(
    "--human-level",
    type=PATH,
    help="JSON of a closed study's report, for the line of people in figure 4.",
)
@click.option(
    "--list",
    "is_list",
    is_flag=True,
    help="List what there is to do, with forecasts, and do nothing.",
)
@click.option(
    "--draw",
    "is_draw",
    is_flag=True,
    help="Draw and tabulate what is finished in --out; train nothing.",
)
@click.option(
    "--export",
    type=PATH,
    help="Write what is finished in --out to small files in this folder, beside what it has of other trainings and policies; "
    "train nothing.",
)
@click.option(
    "--redraw", type=PATH, help="Draw from a folder that --export wrote into --out; train nothing."
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
    human_level: Path | None,
    is_list: bool,
    is_draw: bool,
    export: Path | None,
    redraw: Path | None,
) -> None:
    """Make an experiment of the paper again: train, measure on terrains kept apart, draw the figure and print its table.

    Every training is one job on one core with a folder of its own in --out. The jobs run in the order of their seeds, so a
    run that is stopped leaves a whole with fewer seeds. Ctrl-C saves everything, and the same command goes on from there; a
    crash loses at most a minute. What is done is not done again, so --seeds 5 adds two trainings of each kind to three.

    Figures 6 and 7 have the policies that were trained in --out too. A2C, Rainbow and SAC need the extra `paper`:
    `make paper` builds an environment of its own for it.

    \b
    Examples:
      marsexplorer paper --figure 4                                      small: half an hour on two cores
      marsexplorer paper --figure 4 --budget full --list                 what that would do, and how long it takes
      marsexplorer paper --figure 4 --algorithms ppo --variants works --seeds 5
      marsexplorer paper --figure 4 --redraw data/paper --out pictures   the figures as shipped, in seconds
    """
    figures = ("4", "5", "6", "7") if figure == "all" else (figure,)
    folder = out or Path("runs") / f"paper-{budget}"
    try:
        if redraw is not None:
            draw_exported(figures, redraw, folder, human_level)
            return
        if export is not None:
            export_results(figures, folder, export)
            return
        if is_draw:
            show_figures(figures, folder, human_level)
            return
        from app.jobs import cores
        from marsexplorer.paper.plan import Request

        request = Request(
            figures, budget, _names(algorithms), _names(variants), seeds, moves, terrains, policies
        )
        where = Where(folder, workers or cores(), _command())
        if is_list:
            _list(_plan(request, folder), where)
            return
        _check_installed(_plan(request, folder), folder)
        failures = _run_all(request, where)
        show_figures(figures, folder, human_level)
        _complain(failures, folder)
    except OSError as error:
        raise click.ClickException(
            f"cannot use {error.filename or folder}: {reason(error)}; choose another folder"
        ) from error
    except ValueError as error:
        raise click.UsageError(str(error)) from error


def _names(given: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for each in given for name in each.split(",") if name))


def _plan(request: Request, folder: Path) -> list[Job]:
    """Return the jobs; raise UsageError when one cannot be done or the folder holds it with other options."""
    from marsexplorer.paper.plan import disagreement, plan
    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError

    try:
        jobs = plan(request, folder)
    except (PolicyNotFoundError, PolicyFileError) as error:
        raise click.UsageError(str(error)) from error
    if (sentence := disagreement(jobs, folder)) is not None:
        raise click.UsageError(sentence)
    return jobs


def _check_installed(jobs: list[Job], folder: Path) -> None:
    """Raise UsageError when a training needs tianshou and there is none."""
    from importlib.util import find_spec

    from marsexplorer.paper.algorithms import ALGORITHMS

    to_do = {getattr(job, "algorithm", "ppo") for job in jobs if not job.is_done(folder)} - {"ppo"}
    if to_do and find_spec("tianshou") is None:
        names = ", ".join(ALGORITHMS[name] for name in sorted(to_do))
        raise click.UsageError(
            f"what trains {names} is not installed here: run `make paper`, and then .venv-paper/bin/marsexplorer paper; "
            "or give --algorithms ppo"
        )


def _run_all(request: Request, where: Where) -> list[Failure]:
    """Run the jobs, then those of figures 6 and 7 that the policies just trained bring, and return the jobs that failed."""
    failures: list[Failure] = []
    tried: set[str] = set()
    while True:
        jobs = [job for job in _plan(request, where.out) if job.name not in tried]
        if not jobs:
            return failures
        tried |= {job.name for job in jobs}
        failures += _run(jobs, where)


def _command() -> str:
    """Return the command as it was typed."""
    import shlex
    import sys

    return shlex.join(["marsexplorer", *sys.argv[1:]])


def _list(jobs: list[Job], where: Where) -> None:
    """Print each job with its forecast and how far it is, and how long the whole takes."""
    from marsexplorer.paper.scheduling.forecast import Forecast, duration

    forecast = Forecast.of(jobs, where.out, where.workers)
    rows = []
    for job in jobs:
        is_begun = (where.out / job.name).exists()
        state = "done" if job.is_done(where.out) else "begun" if is_begun else ""
        rows.append((job.name, duration(job.forecast), state))
    print_table(f"{len(jobs)} jobs in {where.out}", ("job", "CPU time", "state"), rows)
    click.echo(_outlook(forecast, where))


def _outlook(forecast: Forecast, where: Where) -> str:
    """Return the sentence that says before the start how long it takes."""
    from marsexplorer.paper.scheduling.forecast import duration

    to_do = len(forecast.courses) - forecast.done
    if not to_do:
        return f"all {len(forecast.courses)} jobs are done in {where.out}"
    cores = f"{forecast.workers} core{'s' if forecast.workers != 1 else ''}"
    done = f", {forecast.done} are done already" if forecast.done else ""
    return f"{to_do} jobs to do in {where.out}{done}: about {duration(forecast.seconds_left)} on {cores}"


def _run(jobs: list[Job], where: Where) -> list[Failure]:
    """Run the jobs with a bar and return those that failed."""
    from marsexplorer.paper.scheduling.forecast import Forecast
    from marsexplorer.paper.scheduling.schedule import BusyError, Schedule, lock

    try:
        with lock(where.out) as descriptor:
            click.echo(_outlook(Forecast.of(jobs, where.out, where.workers), where), err=True)
            with _progress() as on_change:
                return Schedule(jobs, where.out, where.workers, on_change, _say_stopping).run(
                    descriptor
                )
    except BusyError as error:
        raise click.ClickException(str(error)) from error
    except KeyboardInterrupt:
        click.echo(
            f"stopped; the jobs are saved in {where.out}. The same command goes on: {where.command}",
            err=True,
        )
        raise


def _say_stopping() -> None:
    click.echo(
        "stopping: every job saves after its round, some seconds; Ctrl-C again stops at once",
        err=True,
    )


@contextmanager
def _progress() -> Iterator[Callable[[Forecast], None]]:
    """Yield `on_change` that moves a bar over CPU seconds on stderr, or prints a line now and then where it is no terminal."""
    import time

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    from marsexplorer.paper.scheduling.forecast import duration

    console = Console(stderr=True)
    columns = (TextColumn("{task.fields[jobs]}"), BarColumn(), TextColumn("{task.fields[note]}"))
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None, jobs="", note="starting")
        printed = time.monotonic()

        def on_change(forecast: Forecast) -> None:
            nonlocal printed
            left, spent = forecast.cpu_left, forecast.cpu_spent
            jobs = f"{forecast.done} of {len(forecast.courses)} jobs"
            note = f"{duration(spent)} of {duration(spent + left)} CPU time, about {duration(forecast.seconds_left)} left"
            bar.update(task, completed=spent, total=max(spent + left, 1e-9), jobs=jobs, note=note)
            if not console.is_terminal and time.monotonic() - printed > PRINT_INTERVAL_S:
                click.echo(f"{jobs}, {note}", err=True)
                printed = time.monotonic()

        yield on_change


def _complain(failures: list[Failure], folder: Path) -> None:
    """Raise ClickException in one sentence when jobs failed."""
    if not failures:
        return
    first = failures[0]
    where = f"{folder / first.name}/error.txt"
    raise click.ClickException(
        f"{len(failures)} job{'s' if len(failures) != 1 else ''} failed and the others are done; "
        f"{first.name}: {first.error} ({where} says where); the same command tries again"
    )
