"""`python -m research.paper.generalisation`: does PPO hold on other terrains?

    levels    it is trained on one of the paper's 12 levels and plays all twelve
    terrains  it is trained on 10, 100 or 1,000 terrains of level random (variants `works@N`), or on
              new ones in every episode, and plays terrains that it was not trained on

Trainings and plays are jobs as those of the figures are: what is done stays, and what was stopped
goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import click

from humanplay.command.console import progress
from humanplay.command.options import PATH
from humanplay.jobs import cores
from marsexplorer.evaluation import Result
from research.paper.episodes.play import DIFFICULTIES, Play
from research.paper.figures.curves import add_records, read_records
from research.paper.jobs import Job, Line, read_lines, run_jobs, write_lines
from research.paper.plan import BUDGETS, LEVEL, SEEDS, SIZE
from research.paper.trial import Trial, carry

POOLS = (10, 100, 1000)
"""Numbers of training terrains, besides no limit."""
FILE = "generalisation.jsonl"


@dataclass(frozen=True)
class Elsewhere(Play):
    """The episodes of a policy on a level that it may not have been trained on."""

    figure: ClassVar[int] = 8
    kind: ClassVar[str] = "generalisation"

    def measure(self, results: Sequence[Result]) -> Line:
        """The mean moves to 99 %, an unfinished episode counting the limit."""
        return {"steps_to_99": sum(result.steps_to_99 for result in results) / max(1, len(results))}


def trainings(seeds: int) -> list[Trial]:
    """The trainings, seed by seed: on each of the 12 levels, then on few terrains."""
    moves = BUDGETS["full"].levels["works"], BUDGETS["full"].moves["ppo-works"]
    trials = []
    for seed in range(seeds):
        trials += [Trial("ppo", "works", level, SIZE, seed, moves[0]) for level in DIFFICULTIES]
        trials += [Trial("ppo", f"works@{pool}", LEVEL, SIZE, seed, moves[1]) for pool in POOLS]
    return trials


def plays(folder: Path, seeds: int) -> list[Job]:
    """The plays of the policies of levels trained in a folder, each on all twelve."""
    return [
        Elsewhere(str(folder / trial.name / f"{trial.name}.onnx"), level, SIZE)
        for trial in trainings(seeds)
        if trial.level != LEVEL and trial.is_done(folder)
        for level in DIFFICULTIES
    ]


@click.command(context_settings={"show_default": True})
@click.option("--seeds", type=click.IntRange(1, 100), default=SEEDS, help="Trainings of each kind.")
@click.option(
    "--out", type=PATH, default=Path("runs/paper-generalisation"), help="Results' folder."
)
@click.option("--workers", type=click.IntRange(min=1), help="Processes.  [default: all cores]")
@click.option(
    "--export", type=PATH, help="Do nothing: write what is finished in --out to files here."
)
def main(seeds: int, out: Path, workers: int | None, export: Path | None) -> None:
    """Train PPO on each level and on few terrains, and play it on other terrains.

    \b
    Examples:
      nice -n 19 python -m research.paper.generalisation --workers 1
      python -m research.paper.generalisation --export research/paper/data
    """
    if export is not None:
        pools = [record for record in read_records(out) if "@" in record.trial.variant]
        if pools:
            click.echo(add_records(pools, export / "figure4.jsonl"))
        files = sorted(out.glob("figure8-*/result.jsonl"))
        lines = [line for path in files for line in read_lines(path)]
        click.echo(write_lines(export / FILE, lines) if lines else f"nothing is played in {out}")
        for sentence in carry(out, export / "checkpoints"):
            click.echo(sentence)
        return
    failures: dict[str, str] = {}
    for make in (lambda: [*trainings(seeds)], lambda: plays(out, seeds)):
        with progress("jobs") as advance:
            failures |= run_jobs(make(), out, workers or cores(), advance)
    if failures:
        name, error = next(iter(failures.items()))
        raise click.ClickException(f"failed: {', '.join(failures)}; {name}: {error}")


if __name__ == "__main__":
    main(prog_name="python -m research.paper.generalisation")
