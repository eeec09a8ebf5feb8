"""The command `marsexplorer train`: train a policy by PPO."""

from __future__ import annotations

import platform
import shlex
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click import UsageError, echo, option

from humanplay.command.console import noted_progress, written
from humanplay.command.options import COUNT, flag, path_option, several
from humanplay.tasks.mars.cli.cards import commit, measure_policy
from humanplay.tasks.mars.cli.options import env_config_of, levels_option, seed_option, sizes_option

if TYPE_CHECKING:
    from marsexplorer.config import EnvConfig
    from marsexplorer.training.config import TrainConfig
    from marsexplorer.training.ppo import TrainingRun, UpdateMetrics

DEFAULT_MINUTES = 30.0
TIMED_UPDATES = 4
"""Updates that are timed to find how many steps fit into --minutes."""
PRINT_INTERVAL_S = 15
"""Seconds between two lines where stderr is no terminal."""


@click.command(short_help="Train a policy on this machine.")
@option(
    "--recipe",
    type=click.Choice(["best", "priced"]),
    default="best",
    help="best learns from nothing; priced begins as rules by the prices of unknown cells.",
)
@levels_option("random")
@sizes_option("21")
@option(
    "--minutes",
    type=click.FloatRange(min=0, min_open=True),
    help="Train for about this long; a short measurement sets the steps.  [default: 30]",
)
@option("--steps", type=COUNT, help="Train for this many moves, rounded up to whole updates.")
@several(
    "--set",
    "settings",
    "Change a field of the recipe, such as gamma=0.99; repeatable. A wrong one lists all.",
    metavar="FIELD=VALUE",
)
@seed_option("The same seed and steps give the same weights.")
@path_option("--out", "Folder of the run.  [default: runs/RECIPE-LEVEL-SIZE-sSEED]")
@flag("--resume", "Go on with the run in --out: the command that began it, with --resume.")
@option(
    "--device",
    type=click.Choice(["cpu", "cuda"]),
    default="cpu",
    help="Where gradients are computed.",
)
def train(
    recipe: str,
    levels: tuple[str, ...],
    sizes: tuple[int | tuple[int, int], ...],
    minutes: float | None,
    steps: int | None,
    settings: tuple[str, ...],
    seed: int,
    out: Path | None,
    resume: bool,
    device: str,
) -> None:
    """Train a network by PPO and write it to a policy file with its card.

    The folder --out gets the policy file, a log, a learning curve (curve.png), TensorBoard events and, every minute,
    a checkpoint. Ctrl-C keeps all of it, and --resume goes on to the same result as without the interruption. At the end
    the policy and the frontier rules play terrains that training never uses, 200 of 21x21 and fewer larger ones; the policy's
    card gets the figures.

    \b
    Examples:
      marsexplorer train                                          30 minutes on level random, 21x21
      marsexplorer train --minutes 5 --seed 1 --out runs/quick
      marsexplorer train --minutes 5 --set gamma=0.99 --set target_entropy=0.5,0.05
      marsexplorer train --level all --size 21 --size 42 --steps 10000000 --out runs/general
      marsexplorer train --recipe priced --level all --size 21 --size 42 --size 84
      humanplay serve --policy runs/quick/quick.onnx
    """
    if minutes is not None and steps is not None:
        raise UsageError("--minutes and --steps both say how long; give one of them")
    from marsexplorer.training.config import RECIPES, with_fields
    from marsexplorer.training.ppo import TrainingRun
    from marsexplorer.training.run_folder import steps_of

    configs = configs_of(levels, sizes)
    _check_device(device)
    try:
        config = with_fields(RECIPES[recipe], settings)
    except ValueError as error:
        raise UsageError(f"--set: {error}") from error
    sides = [f"{size[0]}x{size[1]}" if isinstance(size, tuple) else str(size) for size in sizes]
    folder = out or Path("runs") / f"{recipe}-{'+'.join(levels)}-{'+'.join(sides)}-s{seed}"
    if not resume and (folder / "checkpoint.pt").exists():
        raise UsageError(f"{folder} holds a run already; go on with --resume, or another --out")
    try:
        if resume and steps is None:
            steps = steps_of(folder)
        steps = steps or _steps_for(minutes or DEFAULT_MINUTES, config, configs, device)
        options = [f"--level {level}" for level in levels] + [f"--size {side}" for side in sides]
        options += [f"--set {shlex.quote(setting)}" for setting in settings]
        command = f"marsexplorer train --recipe {recipe} {' '.join(options)} --steps {steps} --seed {seed} --out "
        here = "" if device == "cpu" else f" --device {device}"
        again = f"{command}{shlex.quote(str(folder))}{here}"
        command += folder.name
        echo(again, err=True)
        warm_up = config.value_warmup_updates * config.batch_size
        if steps <= warm_up:
            echo(
                f"{warm_up:,} moves train the value alone, so this learns no move: take more --steps",
                err=True,
            )
        run = TrainingRun.begin(config, configs, steps, seed, device)
        with written(f"to {folder}"):
            try:
                _train(run, steps, folder, resume, command)
            except KeyboardInterrupt:
                resume_option = " --resume" if (folder / "checkpoint.pt").exists() else ""
                echo(f"go on with: {again}{resume_option}", err=True)
                raise
    except ValueError as error:
        raise UsageError(str(error)) from error


def _train(run: TrainingRun, steps: int, folder: Path, resume: bool, command: str) -> None:
    """Make the run, write its folder and print the policy's held-out figures."""
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
            echo(f"stopped after {run.global_step:,} of {steps:,} moves", err=True)
            raise
    policy = run_folder.policy
    echo(f"{policy}: {measure_policy(policy, run_folder.save_policy, _measured_configs(run))}")


def _measured_configs(run: TrainingRun) -> list[EnvConfig]:
    """The configurations that the policy is measured on: the first level, all sizes."""
    return [config for config in run.env_configs if config.level == run.env_configs[0].level]


def _card(run: TrainingRun, steps: int, command: str) -> dict[str, object]:
    """Return what the policy's card says besides the numbers of the run."""
    boards = (f"{config.level} {config.rows}x{config.cols}" for config in run.env_configs)
    places = ", ".join(dict.fromkeys(boards))
    policy = "A network trained by PPO"
    if run.config.prior_scale:
        policy = "A network that began as rules by the prices of unknown cells, trained by PPO"
    return {
        "summary": f"{policy}: {steps:,} moves on {places}.",
        "command": command,
        "commit": commit(),
        "hardware": f"{platform.machine()}, one thread" if run.device == "cpu" else run.device,
        "size": [run.env_configs[0].rows, run.env_configs[0].cols],
    }


def _steps_for(minutes: float, config: TrainConfig, configs: list[EnvConfig], device: str) -> int:
    """Return the steps that fit into `minutes`, by timing updates of a trial run."""
    from marsexplorer.training.ppo import TrainingRun
    from marsexplorer.training.ppo import train as train_network

    echo("measuring how fast this machine is", err=True)
    times = [time.monotonic()]
    run = TrainingRun.begin(config, configs, TIMED_UPDATES * config.batch_size, 0, device)
    train_network(run, lambda _: times.append(time.monotonic()))
    seconds_per_update = (times[-1] - times[1]) / (TIMED_UPDATES - 1)
    return max(1, int(minutes * 60 / seconds_per_update)) * config.batch_size


def _check_device(device: str) -> None:
    """Raise UsageError when torch cannot compute on the device."""
    if device == "cpu":
        return
    import torch

    if not torch.cuda.is_available():
        raise UsageError(
            "--device cuda needs a CUDA device and a CUDA build of torch; this one has none: leave it out"
        )


@contextmanager
def _progress_bar(run: TrainingRun) -> Iterator[Callable[[UpdateMetrics, float], None]]:
    """Yield an `on_update`: it moves a bar, or prints lines if stderr is no terminal."""
    with noted_progress("playing", run.num_updates) as advance:
        started, first_step, printed = time.monotonic(), run.global_step, 0.0

        def on_update(metrics: UpdateMetrics, seconds: float) -> None:
            nonlocal printed
            now = time.monotonic()
            speed = (metrics.global_step - first_step) / max(now - started, 1e-9)
            played = f"{metrics.global_step / 1e6:.2f} M moves, {speed:,.0f}/s"
            earned = "no episode has ended yet"
            if not isnan(metrics.episode_return):
                steps = f"{metrics.episode_steps:.1f} moves an episode"
                returned = f"return {metrics.episode_return:.0f}"
                earned = f"{returned}, {steps}, {metrics.explored:.1%} explored"
            note, line = f"{played}: {earned}", ""
            if now - printed > PRINT_INTERVAL_S or run.updates_done == run.num_updates:
                line, printed = f"{note}, entropy {metrics.entropy:.2f}", now
            advance(run.updates_done, note, line)

        yield on_update


def configs_of(levels: Sequence[str], sizes: Sequence[int | tuple[int, int]]) -> list[EnvConfig]:
    """Return the configurations of every size and level; UsageError if there is none.

    `all` stands for the levels of FAMILIES.
    """
    from marsexplorer.training.config import FAMILIES

    groups = (FAMILIES if level == "all" else (level,) for level in levels)
    names = dict.fromkeys(chain.from_iterable(groups))
    return [env_config_of(level, size) for size in dict.fromkeys(sizes) for level in names]
