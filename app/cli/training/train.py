"""The command `marsexplorer train`: train a policy by PPO, with a log, a learning curve and checkpoints."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from app.cli.console import PATH, configs_of, levels_option, reason, seed_option, sizes_option

if TYPE_CHECKING:
    from marsexplorer.config import EnvConfig
    from marsexplorer.training.config import TrainConfig
    from marsexplorer.training.ppo import TrainingRun, UpdateMetrics

DEFAULT_MINUTES = 30.0
TIMED_UPDATES = 4
"""Updates that are timed to find how many steps fit into --minutes."""
PRINT_INTERVAL_S = 15
"""Seconds between two lines where stderr is no terminal."""
HELD_OUT_TERRAINS = 200
"""Terrains that the finished policy is measured on for its card."""


@click.command(short_help="Train a policy on this machine.")
@click.option(
    "--recipe",
    type=click.Choice(["best", "paper"]),
    default="best",
    show_default=True,
    help="best explores best; paper is the training of the paper.",
)
@click.option(
    "--network",
    type=click.Choice(["authors", "rllib"]),
    help="With paper: sizes of the network as in the authors' repository, or RLlib's.  [default: authors]",
)
@click.option("--appendix", is_flag=True, help="With paper: 30 passes in minibatches of 128, for 6 of 500; much slower.")
@levels_option("random")
@sizes_option("21")
@click.option(
    "--minutes",
    type=click.FloatRange(min=0, min_open=True),
    help="Train for about this long; a short measurement sets the steps.  [default: 30]",
)
@click.option("--steps", type=click.IntRange(min=1), help="Train for this many moves instead, rounded up to whole updates.")
@seed_option("The same seed and steps give the same weights.")
@click.option("--out", type=PATH, help="Folder of the run.  [default: runs/RECIPE-LEVEL-SIZE-sSEED]")
@click.option(
    "--resume", is_flag=True, help="Go on with the run in --out; give the options it began with, --steps as it printed."
)
@click.option(
    "--device", type=click.Choice(["cpu", "cuda"]), default="cpu", show_default=True, help="Where the network computes."
)
def train(
    recipe: str,
    network: str | None,
    appendix: bool,
    levels: tuple[str, ...],
    sizes: tuple[Any, ...],
    minutes: float | None,
    steps: int | None,
    seed: int,
    out: Path | None,
    resume: bool,
    device: str,
) -> None:
    """Train a network by PPO and write it to a policy file with its card.

    The folder --out gets the policy file, a log, a learning curve (curve.png), TensorBoard events and, every minute,
    a checkpoint. Ctrl-C keeps all of it, and --resume goes on to the same result as without the interruption. At the end
    the policy and the frontier rules play 200 terrains that training never uses; the policy's card gets the figures.

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
    if recipe != "paper" and (appendix or network):
        raise click.UsageError("--appendix and --network are of the paper's recipe; add --recipe paper, or leave them out")
    from marsexplorer.training.config import APPENDIX_PASSES, RECIPES
    from marsexplorer.training.ppo import TrainingRun
    from marsexplorer.training.run_folder import resumed_config

    configs = configs_of(levels, sizes)
    _check_device(device)
    changes: dict[str, Any] = {**(APPENDIX_PASSES if appendix else {}), **({"network": network} if network else {})}
    config = replace(RECIPES[recipe], **changes)
    folder = out or Path("runs") / f"{recipe}-{'+'.join(levels)}-{'+'.join(_size_text(size) for size in sizes)}-s{seed}"
    if not resume and (folder / "checkpoint.pt").exists():
        raise click.UsageError(f"{folder} holds a run already; go on with --resume, or give another --out")
    try:
        if resume:
            config = resumed_config(folder, config)
        steps = steps or _steps_for(minutes or DEFAULT_MINUTES, config, configs, device)
        options = " ".join([*(f"--level {level}" for level in levels), *(f"--size {_size_text(size)}" for size in sizes)])
        what = f"{recipe}{' --appendix' if appendix else ''}{f' --network {network}' if network else ''}"
        command = f"marsexplorer train --recipe {what} {options} --steps {steps} --seed {seed} --out {folder.name}"
        click.echo(f"{command}{'' if device == 'cpu' else f' --device {device}'}", err=True)
        run = TrainingRun.begin(config, configs, steps, seed, device)
        _train(run, steps, folder, resume, command)
    except OSError as error:
        raise click.ClickException(f"cannot write to {folder}: {reason(error)}; choose another --out") from error
    except ValueError as error:
        raise click.UsageError(str(error)) from error


def _train(run: TrainingRun, steps: int, folder: Path, resume: bool, command: str) -> None:
    """Make the run, write its folder and print how the policy does on held-out terrains."""
    from marsexplorer.training.ppo import train as train_network
    from marsexplorer.training.run_folder import RunFolder

    with _progress_bar(run) as on_update:
        run_folder = RunFolder(folder, run, _card(run, steps, command), on_update)
        if resume:
            run_folder.resume()
        try:
            train_network(run, run_folder.on_update)
            run_folder.save()
        except KeyboardInterrupt:
            if run.is_between_updates:
                run_folder.save()
            click.echo(f"stopped after {run.global_step:,} of {steps:,} moves; go on with: {command} --resume", err=True)
            raise
    click.echo(f"{run_folder.policy}: {measure_policy(run_folder.policy, run_folder.save_policy, run.env_configs[0])}")


def _card(run: TrainingRun, steps: int, command: str) -> dict[str, Any]:
    """Return what the policy's card says besides the numbers of the run."""
    where = ", ".join(dict.fromkeys(f"{config.level} {config.rows}x{config.cols}" for config in run.env_configs))
    what = "PPO as in the paper" if run.config.name == "paper" else "A network trained by PPO"
    return {
        "summary": f"{what}: {steps:,} moves on {where}.",
        "command": command,
        "commit": commit(),
        "hardware": f"{platform.machine()}, one thread" if run.device == "cpu" else run.device,
        "size": [run.env_configs[0].rows, run.env_configs[0].cols],
    }


def measure_policy(file: Path, save_policy: Callable[[dict[str, Any]], None], config: EnvConfig) -> str:
    """Return a sentence on how the policy in a file does on held-out terrains.

    save_policy   is called with the numbers, to write them into the card
    """
    from marsexplorer.evaluation import RULES, evaluate
    from marsexplorer.training.envs import EVALUATION_SEEDS

    table = evaluate([str(file), *RULES], config, HELD_OUT_TERRAINS, EVALUATION_SEEDS.start)
    own, *rules = table.rows
    best = min(row.steps_mean for row in rules)
    where = f"{config.level} {config.rows}x{config.cols}"
    numbers = {
        "terrains": HELD_OUT_TERRAINS,
        "first_seed": EVALUATION_SEEDS.start,
        "steps": round(own.steps_mean, 2),
        "completion": own.completion,
        "collisions": own.collisions,
        "score": round(own.score_mean, 4),
        "best_rule_steps": round(best, 2),
    }
    save_policy({"results": {where: numbers}})
    steps = f"{own.steps_mean:.1f} steps to 99 % on {HELD_OUT_TERRAINS} terrains of {where} ({own.completion:.0%} explored)"
    return f"{steps}, the best rule {best:.1f}"


def _steps_for(minutes: float, config: TrainConfig, configs: list[EnvConfig], device: str) -> int:
    """Return the steps that fit into `minutes`, by timing a few updates of a run that is thrown away."""
    import time

    from marsexplorer.training.ppo import TrainingRun
    from marsexplorer.training.ppo import train as train_network

    click.echo("measuring how fast this machine is", err=True)
    times = [time.monotonic()]
    run = TrainingRun.begin(config, configs, TIMED_UPDATES * config.batch_size, 0, device)
    train_network(run, lambda _: times.append(time.monotonic()))
    seconds_per_update = (times[-1] - times[1]) / (TIMED_UPDATES - 1)
    return max(1, int(minutes * 60 / seconds_per_update)) * config.batch_size


def _size_text(size: int | tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}" if isinstance(size, tuple) else str(size)


def _check_device(device: str) -> None:
    """Raise UsageError when torch cannot compute on the device."""
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
def _progress_bar(run: TrainingRun) -> Iterator[Callable[[UpdateMetrics, float], None]]:
    """Yield an `on_update` that moves a bar on stderr, or prints a line now and then where stderr is no terminal."""
    import time

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("playing"), BarColumn(), TextColumn("{task.fields[note]}"), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=run.num_updates, note="")
        started, first_step, printed = time.monotonic(), run.global_step, 0.0

        def on_update(metrics: UpdateMetrics, seconds: float) -> None:
            nonlocal printed
            now = time.monotonic()
            speed = (metrics.global_step - first_step) / max(now - started, 1e-9)
            episodes = f"{metrics.episode_steps:.1f} moves an episode, {metrics.explored:.1%} explored"
            played = f"{metrics.global_step / 1e6:.2f} M moves, {speed:,.0f}/s"
            note = f"{played}: return {metrics.episode_return:.0f}, {episodes}"
            progress.update(task, completed=run.updates_done, note=note)
            if not console.is_terminal and (now - printed > PRINT_INTERVAL_S or run.updates_done == run.num_updates):
                click.echo(f"{note}, entropy {metrics.entropy:.2f}", err=True)
                printed = now

        yield on_update
