"""The command `python -m research.sweep`: a training for every level, size, seed."""

from __future__ import annotations

import csv
import io
import platform
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import click
from click import ClickException, UsageError, option

from humanplay.command.console import print_table, progress, written
from humanplay.command.options import COUNT, path_option, several
from humanplay.jobs import Jobs
from humanplay.tasks.mars.cli.cluster import Cluster, ClusterError
from humanplay.tasks.mars.cli.options import levels_option, sizes_option
from humanplay.tasks.mars.cli.train import configs_of
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import RULES, evaluate
from marsexplorer.files import to_cell, write_whole
from marsexplorer.training.config import RECIPES
from marsexplorer.training.envs import EVALUATION_SEEDS
from marsexplorer.training.ppo import TrainingRun, train
from marsexplorer.training.run_folder import RunFolder
from research.paper.tables import per_cent


@dataclass(frozen=True)
class SweepRun:
    """One training run: options of `marsexplorer train`, and terrains to measure on.

    name      of its folder and policy file
    recipe    a name in RECIPES
    config    the fields of its EnvConfig as a dictionary
    steps     moves to train for
    episodes  held-out terrains to measure on
    card      what the policy's card says besides numbers
    """

    name: str
    recipe: str
    config: dict[str, Any]
    steps: int
    seed: int
    episodes: int
    card: dict[str, Any]


@dataclass(frozen=True)
class SweepResult:
    """The outcome of a run; after an error the measures are NaN.

    steps, completion, score  means on held-out terrains; rule_ratio: mean steps over those of the
                              best frontier rule there
    policy                    the policy file
    """

    run: SweepRun
    steps: float
    completion: float
    score: float
    rule_ratio: float
    policy: Path | None
    error: str = ""


NAN = float("nan")
FIGURES = ("steps", "completion", "score", "rule_ratio")


@click.command(context_settings={"show_default": True})
@levels_option("random")
@sizes_option("21")
@several("--seed", "seeds", "Training seed; repeatable.", type=click.IntRange(0, 1000), default=[0])
@option("--recipe", type=click.Choice(["best", "priced"]), default="best", help="As in train.")
@option("--steps", type=COUNT, default=4_000_000, help="Moves of each training.")
@option("--episodes", type=click.IntRange(min=2), default=200, help="Held-out terrains a policy.")
@option("--ray", metavar="ADDRESS", help="Train on a Ray cluster: HOST:PORT, auto, or local.")
@path_option("--out", "Folder that all machines reach: policies, logs, sweep.csv.", required=True)
def sweep(
    levels: tuple[str, ...],
    sizes: tuple[int | tuple[int, int], ...],
    seeds: tuple[int, ...],
    recipe: str,
    steps: int,
    episodes: int,
    ray: str | None,
    out: Path,
) -> None:
    """Train a policy for every level, size and seed, and measure all of them.

    As many are trained at the same time as there are cores, here or on a Ray cluster. Each writes a
    folder as `marsexplorer train` does; sweep.csv has a line for each. To train one policy on
    several levels at once, use `marsexplorer train --level all`.

    \b
    Examples:
      python -m research.sweep --level all --seed 0 --seed 1 --seed 2 --out runs/levels
      python -m research.sweep --level random --size 21 --size 42 --steps 10000000 --ray head:6379 --out /shared/sizes
    """
    runs = [
        _sweep_run(config, seed, recipe, steps, episodes)
        for config, seed in product(configs_of(levels, sizes), dict.fromkeys(seeds))
    ]
    if (out / "sweep.csv").exists():
        raise UsageError(f"{out} holds a sweep already; give another --out")
    with written(f"to {out}"):
        out.mkdir(parents=True, exist_ok=True)
        with write_whole(out / "sweep.csv") as file:
            results = _run(runs, out, ray)
            file.write(_csv(results).encode())
    _show(results)
    if failed := [result for result in results if result.error]:
        raise ClickException(
            f"{len(failed)} of {len(runs)} trainings failed, the first with: {failed[0].error}"
        )


def _sweep_run(config: EnvConfig, seed: int, recipe: str, steps: int, episodes: int) -> SweepRun:
    side = f"{config.rows}x{config.cols}"
    card = {
        "summary": f"PPO ({recipe}): {steps:,} moves on {config.level} {side}, seed {seed}.",
        "command": f"marsexplorer train --recipe {recipe} --level {config.level} --size {side} --steps {steps} --seed {seed}",
        "hardware": f"{platform.machine()}, one thread",
        "size": [config.rows, config.cols],
    }
    name = f"{recipe}-{config.level}-{side}-s{seed}"
    return SweepRun(name, recipe, config.to_dict(), steps, seed, episodes, card)


def _run(runs: Sequence[SweepRun], out: Path, address: str | None) -> list[SweepResult]:
    try:
        with Cluster(address) if address else Jobs() as jobs, progress("training") as advance:
            advance(0, len(runs))
            return train_all(jobs, runs, out.resolve(), advance)
    except ClusterError as error:
        raise ClickException(str(error)) from error


def train_all(
    executor: Executor, runs: Sequence[SweepRun], out: Path, advance: Callable[[int, int], None]
) -> list[SweepResult]:
    """Train and measure each run; the results are in the order of the runs.

    A run that fails leaves the others running.

    Args:
        executor: Trains.
        runs: The runs.
        out: Folder that all machines see: each run's own (policy file, log, learning curve) is
            out/NAME.
        advance: Called with (runs ended, runs in all).
    """
    futures = [executor.submit(train_one, run, out) for run in runs]
    for done, _ in enumerate(as_completed(futures), 1):
        advance(done, len(runs))
    results = []
    for run, future in zip(runs, futures, strict=True):
        if (error := future.exception()) is None:
            results.append(future.result())
        else:
            sentences = str(error).strip().splitlines() or [type(error).__name__]
            results.append(SweepResult(run, NAN, NAN, NAN, NAN, None, sentences[-1]))
    return results


def train_one(sweep_run: SweepRun, out: Path) -> SweepResult:
    """Train, measure and write one run, in this process."""
    config = EnvConfig(**sweep_run.config)
    run = TrainingRun.begin(RECIPES[sweep_run.recipe], [config], sweep_run.steps, sweep_run.seed)
    folder = RunFolder(out / sweep_run.name, run, sweep_run.card, lambda metrics, seconds: None)
    train(run, folder.on_update)
    folder.save()
    names = [str(folder.policy), *RULES]
    table = evaluate(names, config, sweep_run.episodes, EVALUATION_SEEDS.start)
    row, ratio = table.rows[0], table.compared(table.rows[0])
    assert ratio is not None
    means = (row.steps_mean, row.completion, row.score_mean, ratio.ratio_mean)
    result = SweepResult(sweep_run, *means, folder.policy)
    setting = f"{config.level} {config.rows}x{config.cols}"
    terrains = {"terrains": sweep_run.episodes, "first_seed": EVALUATION_SEEDS.start}
    figures = {name: getattr(result, name) for name in FIGURES}
    folder.save_policy(
        {"results": {setting: {**terrains, **figures, "collisions": row.collisions}}}
    )
    return result


def _csv(results: list[SweepResult]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", "recipe", "level", "rows", "cols", "seed", "moves", *FIGURES, "error"])
    for result in results:
        run = result.run
        setting = (run.config["level"], run.config["rows"], run.config["cols"])
        cells = (
            run.name,
            run.recipe,
            *setting,
            run.seed,
            run.steps,
            *_figures(result),
            result.error,
        )
        writer.writerow(map(to_cell, cells))
    return text.getvalue()


def _figures(result: SweepResult) -> list[float]:
    return [getattr(result, name) for name in FIGURES]


def _show(results: list[SweepResult]) -> None:
    rows = []
    for result in results:
        steps, completion, score, ratio = _figures(result)
        run = result.run
        setting = (run.config["level"], f"{run.config['rows']}x{run.config['cols']}", str(run.seed))
        figures = (per_cent(completion, 1), f"{steps:.1f}", f"{ratio:.3f}", f"{score:.4f}")
        rows.append((run.name, *setting, *figures))
    columns = ["policy", "level", "size", "seed"]
    columns += ["completion", "steps to 99 %", "to rule", "mean score"]
    print_table(f"{results[0].run.episodes} held-out terrains each", columns, rows)
