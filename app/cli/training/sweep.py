"""The command `marsexplorer sweep`: one training run for every level, size and seed, on a Ray cluster."""

from __future__ import annotations

import csv
import io
import platform
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import (
    PATH,
    configs_of,
    interruptible,
    levels_option,
    print_table,
    progress,
    reason,
    sizes_option,
)

if TYPE_CHECKING:
    from marsexplorer.config import EnvConfig
    from marsexplorer.training.sweep import SweepResult, SweepRun

FIGURES = ("steps", "completion", "score", "rule_ratio")


@click.command(short_help="Train on many levels and seeds with Ray.")
@levels_option("random")
@sizes_option("21")
@click.option(
    "--seed",
    "seeds",
    type=click.IntRange(0, 1000),
    multiple=True,
    default=[0],
    help="Training seed; repeatable.",
)
@click.option(
    "--recipe",
    type=click.Choice(["best", "paper"]),
    default="best",
    show_default=True,
    help="As in train.",
)
@click.option(
    "--steps",
    type=click.IntRange(min=1),
    default=4_000_000,
    show_default=True,
    help="Moves of each training.",
)
@click.option(
    "--episodes",
    type=click.IntRange(min=2),
    default=200,
    show_default=True,
    help="Held-out terrains to measure each policy on.",
)
@click.option(
    "--ray",
    default="local",
    show_default=True,
    metavar="ADDRESS",
    help="Ray cluster: HOST:PORT, auto, or local.",
)
@click.option(
    "--out",
    type=PATH,
    required=True,
    help="Folder that all machines can reach: policies, logs and sweep.csv.",
)
def sweep(
    levels: tuple[str, ...],
    sizes: tuple[int | tuple[int, int], ...],
    seeds: tuple[int, ...],
    recipe: str,
    steps: int,
    episodes: int,
    ray: str,
    out: Path,
) -> None:
    """Train one policy for every level, size and seed, each on one core, and measure all on terrains kept for evaluation.

    The training runs are trials of Ray Tune, on this machine or on a cluster that runs already. Each writes a folder as
    `marsexplorer train` does; sweep.csv has a line for each. To train one policy on several levels at once, use
    `marsexplorer train --level all`. This command needs the extra `ray`.

    \b
    Examples:
      marsexplorer sweep --level all --seed 0 --seed 1 --seed 2 --out runs/levels
      marsexplorer sweep --level random --size 21 --size 42 --steps 10000000 --ray head:6379 --out /shared/sizes
    """
    configs, each_seed = configs_of(levels, sizes), dict.fromkeys(seeds)
    runs = [
        _sweep_run(config, seed, recipe, steps, episodes)
        for config in configs
        for seed in each_seed
    ]
    if (out / "sweep.csv").exists():
        raise click.UsageError(f"{out} holds a sweep already; give another --out")
    from marsexplorer.files import write_whole

    try:
        out.mkdir(parents=True, exist_ok=True)
        with write_whole(out / "sweep.csv") as file:
            results = _run(runs, out, ray)
            file.write(_csv(results).encode())
    except OSError as error:
        raise click.ClickException(
            f"cannot write to {out}: {reason(error)}; choose another --out"
        ) from error
    _show(results)
    failed = [each for each in results if each.error]
    if failed:
        raise click.ClickException(
            f"{len(failed)} of {len(runs)} trainings failed, the first with: {failed[0].error}"
        )


def _sweep_run(config: EnvConfig, seed: int, recipe: str, steps: int, episodes: int) -> SweepRun:
    from marsexplorer.training.sweep import SweepRun

    side = f"{config.rows}x{config.cols}"
    card = {
        "summary": f"PPO ({recipe}): {steps:,} moves on {config.level} {side}, seed {seed}.",
        "command": f"marsexplorer train --recipe {recipe} --level {config.level} --size {side} --steps {steps} --seed {seed}",
        "hardware": f"{platform.machine()}, one thread",
        "size": [config.rows, config.cols],
    }
    return SweepRun(
        name=f"{recipe}-{config.level}-{side}-s{seed}",
        recipe=recipe,
        config=config.to_dict(),
        steps=steps,
        seed=seed,
        episodes=episodes,
        card=card,
    )


def _run(runs: list[SweepRun], out: Path, address: str) -> list[SweepResult]:
    from marsexplorer.evaluation.cluster import ClusterError
    from marsexplorer.training.sweep import sweep as run_sweep

    with progress("training") as advance:
        advance(0, len(runs))
        try:
            return interruptible(lambda: run_sweep(runs, out, address, advance))
        except ClusterError as error:
            raise click.ClickException(str(error)) from error


def _csv(results: list[SweepResult]) -> str:
    from marsexplorer.files import to_cell

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", "recipe", "level", "rows", "cols", "seed", "moves", *FIGURES, "error"])
    for each in results:
        run = each.run
        where = (run.config["level"], run.config["rows"], run.config["cols"])
        cells = (run.name, run.recipe, *where, run.seed, run.steps, *_figures(each), each.error)
        writer.writerow(map(to_cell, cells))
    return text.getvalue()


def _figures(result: SweepResult) -> list[float]:
    return [getattr(result, field.name) for field in fields(result) if field.name in FIGURES]


def _show(results: list[SweepResult]) -> None:
    rows = []
    for each in results:
        steps, completion, score, ratio = _figures(each)
        run = each.run
        where = (run.config["level"], f"{run.config['rows']}x{run.config['cols']}", str(run.seed))
        rows.append(
            (run.name, *where, f"{completion:.1%}", f"{steps:.1f}", f"{ratio:.3f}", f"{score:.4f}")
        )
    columns = (
        "policy",
        "level",
        "size",
        "seed",
        "completion",
        "steps to 99 %",
        "to rule",
        "mean score",
    )
    print_table(f"{results[0].run.episodes} held-out terrains each", columns, rows)
