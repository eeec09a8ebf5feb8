"""`marsexplorer train`: a policy of one's own by PPO, with a log, a learning curve and checkpoints."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from app.cli.console import PATH, Size, config_of, reason

if TYPE_CHECKING:
    from marsexplorer.config import EnvConfig
    from marsexplorer.training.config import Recipe
    from marsexplorer.training.ppo import Report, Run

HELD_OUT = 200
"""Terrains that the finished policy is tried on for its card."""


@click.command(short_help="Train a policy on this machine.")
@click.option(
    "--recipe",
    type=click.Choice(["best", "paper"]),
    default="best",
    show_default=True,
    help="best explores best; paper is what the paper did.",
)
@click.option(
    "--level",
    "levels",
    multiple=True,
    default=("random",),
    show_default=True,
    help="random, t-m-b from 1-1-1 to 3-2-2, or all; repeatable.",
)
@click.option(
    "--size",
    "sizes",
    type=Size(),
    multiple=True,
    default=("21",),
    show_default=True,
    help="21, or 42x84 for rows x columns; repeatable.",
)
@click.option(
    "--minutes",
    type=click.FloatRange(min=0, min_open=True),
    help="Train for about so long: a short measurement fixes the steps.  [default: 30]",
)
@click.option("--steps", type=click.IntRange(min=1), help="Train for so many moves instead, rounded up to whole updates.")
@click.option(
    "--seed", type=click.IntRange(0, 1000), default=0, show_default=True, help="The same seed and steps give the same weights."
)
@click.option("--out", type=PATH, help="Folder of the run.  [default: runs/RECIPE-LEVEL-SIZE-sSEED]")
@click.option(
    "--resume", is_flag=True, help="Go on with the run in --out; give the options it began with, --steps as it printed."
)
@click.option(
    "--device", type=click.Choice(["cpu", "cuda"]), default="cpu", show_default=True, help="Where the network computes."
)
def train(
    recipe: str,
    levels: tuple[str, ...],
    sizes: tuple[Any, ...],
    minutes: float | None,
    steps: int | None,
    seed: int,
    out: Path | None,
    resume: bool,
    device: str,
) -> None:
    """Train a network by PPO and write it with its card inside.

    The folder --out gets the policy file, a log, a learning curve (curve.png), TensorBoard events and, every minute,
    a checkpoint. Ctrl-C keeps all of it, and --resume goes on to the same result as if nothing had happened. At the end
    the policy plays 200 terrains that training never sees, beside the frontier rules; its card says how that went.

    \b
    Examples:
      marsexplorer train                                          30 minutes on level random, 21x21
      marsexplorer train --minutes 5 --seed 1 --out runs/quick
      marsexplorer train --level all --size 21 --size 42 --steps 10000000 --out runs/general
      marsexplorer train --recipe paper --minutes 60
      marsexplorer serve --policy runs/quick/quick.safetensors
    """
    if minutes is not None and steps is not None:
        raise click.UsageError("--minutes and --steps both say how long; give one of them")
    if resume and (steps is None or out is None):
        raise click.UsageError("--resume needs --out and the --steps that the run began with (its first line printed them)")
    from marsexplorer.training.config import FAMILIES, RECIPES

    names = tuple(dict.fromkeys(name for level in levels for name in (FAMILIES if level == "all" else (level,))))
    configs = [config_of(level, size) for size in dict.fromkeys(sizes) for level in names]
    _check_device(device)
    chosen = RECIPES[recipe]
    folder = out or Path("runs") / f"{recipe}-{'+'.join(levels)}-{'+'.join(_side(size) for size in sizes)}-s{seed}"
    if not resume and (folder / "checkpoint.pt").exists():
        raise click.UsageError(f"{folder} holds a run already; go on with --resume, or give another --out")
    try:
        steps = steps or _measured(chosen, configs, minutes or 30.0, device)
        asked = " ".join([*(f"--level {level}" for level in levels), *(f"--size {_side(size)}" for size in sizes)])
        words = f"marsexplorer train --recipe {recipe} {asked} --steps {steps} --seed {seed} --out {folder.name}"
        click.echo(f"{words}{'' if device == 'cpu' else f' --device {device}'}", err=True)
        _run(chosen, configs, steps, seed, device, folder, resume, words)
    except OSError as error:
        raise click.ClickException(f"cannot write to {folder}: {reason(error)}; choose another --out") from error
    except ValueError as error:
        raise click.UsageError(str(error)) from error


def _run(
    recipe: Recipe, configs: list[EnvConfig], steps: int, seed: int, device: str, folder: Path, resume: bool, words: str
) -> None:
    from marsexplorer.training.config import LIMITS
    from marsexplorer.training.ppo import Run
    from marsexplorer.training.ppo import train as play
    from marsexplorer.training.run_folder import Logbook

    run = Run.begin(recipe, configs, steps, seed, device)
    where = ", ".join(dict.fromkeys(f"{config.level} {config.rows}x{config.cols}" for config in configs))
    what = "PPO as in the paper" if recipe.name == "paper" else "A network trained by PPO"
    card = {
        "summary": f"{what}: {steps:,} moves on {where}.",
        "command": words,
        "commit": commit(),
        "hardware": f"{platform.machine()}, one thread" if device == "cpu" else device,
        "limits": LIMITS[recipe.name],
        "size": [configs[0].rows, configs[0].cols],
    }
    with _bar(run) as tell:
        book = Logbook(folder, run, card, tell)
        if resume:
            book.resume()
        try:
            play(run, book.heard)
            book.keep()
        except KeyboardInterrupt:
            book.keep()
            click.echo(f"stopped after {run.moves:,} of {steps:,} moves; go on with: {words} --resume", err=True)
            raise
    click.echo(f"{book.policy}: {tried(book.policy, book.keep_policy, configs[0])}")


def tried(file: Path, keep: Callable[[dict[str, Any]], None], config: EnvConfig) -> str:
    """Return how the finished policy does on held-out terrains, in words; `keep` puts the numbers into its card."""
    from marsexplorer.evaluation import evaluate
    from marsexplorer.training.envs import EVALUATION_SEEDS

    table = evaluate([str(file), "frontier-cost", "frontier-utility"], config, HELD_OUT, EVALUATION_SEEDS.start)
    own, *rules = table.rows
    best = min(row.steps_mean for row in rules)
    where = f"{config.level} {config.rows}x{config.cols}"
    numbers = {
        "terrains": HELD_OUT,
        "first_seed": EVALUATION_SEEDS.start,
        "steps": round(own.steps_mean, 2),
        "completion": own.completion,
        "collisions": own.collisions,
        "score": round(own.score_mean, 4),
        "best_rule_steps": round(best, 2),
    }
    keep({"results": {where: numbers}})
    said = f"{own.steps_mean:.1f} steps to 99 % on {HELD_OUT} terrains of {where} ({own.completion:.0%} explored)"
    return f"{said}, the best rule {best:.1f}"


def _measured(recipe: Recipe, configs: list[EnvConfig], minutes: float, device: str) -> int:
    """Return the moves that `minutes` will do for, by timing a few updates of a run that is thrown away."""
    import time

    from marsexplorer.training.ppo import Run
    from marsexplorer.training.ppo import train as play

    click.echo("measuring how fast this machine is", err=True)
    updates = 4
    times = [time.monotonic()]
    run = Run.begin(recipe, configs, updates * recipe.boards * recipe.horizon, 0, device)
    play(run, lambda _: times.append(time.monotonic()))
    each = (times[-1] - times[1]) / (updates - 1)
    return max(1, int(minutes * 60 / each)) * recipe.boards * recipe.horizon


def _side(size: int | tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}" if isinstance(size, tuple) else str(size)


def _check_device(device: str) -> None:
    if device == "cpu":
        return
    import torch

    if not torch.cuda.is_available():
        raise click.UsageError("--device cuda needs a CUDA device and a CUDA build of torch; this one has none: leave it out")


def commit() -> str | None:
    """Return the commit of the checkout this runs from, None outside one."""
    try:
        done = subprocess.run(
            ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
        )
    except OSError:
        return None
    return done.stdout.strip() or None


@contextmanager
def _bar(run: Run) -> Iterator[Callable[[Report, float], None]]:
    """Yield a `tell` that moves a progress bar on stderr, or prints a line now and then where stderr is no terminal."""
    import time

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("playing"), BarColumn(), TextColumn("{task.fields[note]}"), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=run.updates, note="")
        began, first, said = time.monotonic(), run.moves, 0.0

        def tell(report: Report, seconds: float) -> None:
            nonlocal said
            now = time.monotonic()
            speed = (report.moves - first) / max(now - began, 1e-9)
            lately = f"return {report.returned:.0f}, {report.steps:.1f} moves an episode, {report.explored:.1%} explored"
            note = f"{report.moves / 1e6:.2f} M moves, {speed:,.0f}/s: {lately}"
            progress.update(task, completed=run.done, note=note)
            if not console.is_terminal and (now - said > 15 or run.done == run.updates):
                click.echo(f"{note}, entropy {report.entropy:.2f}", err=True)
                said = now

        yield tell
