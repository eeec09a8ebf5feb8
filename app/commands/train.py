"""The command `marsexplorer train`: a policy of one's own, from the planner's example and then by playing."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from marsexplorer.training.ppo import Tell

STAGES = {"label": "watching the planner", "clone": "imitating the planner", "ppo": "playing"}


@click.command(short_help="Train a policy on this machine.")
@click.option("--level", default="random", show_default=True, help="random, or t-m-b from 1-1-1 to 3-2-2.")
@click.option("--size", type=click.IntRange(5, 128), default=21, show_default=True, help="Cells a side of the terrains.")
@click.option("--steps", type=click.IntRange(min=1), default=4_000_000, show_default=True, help="Moves to play with PPO.")
@click.option(
    "--labels", type=click.IntRange(min=0), default=60_000, show_default=True, help="Moves of the planner to imitate first."
)
@click.option("--seed", type=click.IntRange(0, 90), default=0, show_default=True, help="The same seed gives the same weights.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="The policy file to write, ending in .safetensors.")
def train(level: str, size: int, steps: int, labels: int, seed: int, out: Path) -> None:
    """Train a network on one core and write it with its card inside.

    It first imitates the planner, then improves by PPO on the rewards of the task. The file is written every 25
    updates and at the end, so Ctrl-C keeps what there is. On one core expect some thousand moves a second.

    \b
    Examples:
      marsexplorer train --out mine.safetensors
      marsexplorer train --level 3-2-1 --steps 1000000 --seed 1 --out hard.safetensors
      marsexplorer serve --policy mine.safetensors
    """
    from dataclasses import replace

    from marsexplorer.config import EnvConfig
    from marsexplorer.training.ppo import Recipe, checkpoint_to
    from marsexplorer.training.ppo import train as run

    if out.suffix != ".safetensors":
        raise click.UsageError(f"--out must end in .safetensors, got {out.name}")
    try:
        config = EnvConfig.of(level, size)
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    command = (
        f"marsexplorer train --level {level} --size {size} --steps {steps} --labels {labels} --seed {seed} --out {out.name}"
    )
    card = {
        "summary": f"A network that imitated the planner and then played {steps:,} moves (PPO), on {level} {size}x{size}.",
        "command": command,
        "hardware": f"one core of {platform.machine()}",
        "config": config.to_dict(),
        "limits": "Deterministic; a guard follows the nearest frontier for 8 moves where it would go in circles.",
    }
    try:
        with _bar() as tell:
            run(config, steps, seed, replace(Recipe(), labels=labels), tell, checkpoint_to(out, card))
    except OSError as error:
        raise click.ClickException(f"cannot write {out}: {(error.strerror or str(error)).lower()}") from error
    except KeyboardInterrupt:
        click.echo(
            f"stopped; {out} holds the last checkpoint" if out.exists() else "stopped before the first checkpoint", err=True
        )
        raise
    click.echo(f"{out}: try it with `marsexplorer evaluate --policy {out} --policy frontier-cost`")


@contextmanager
def _bar() -> Iterator[Tell]:
    """Yield a `tell` that moves a progress bar on stderr, or prints a line now and then where stderr is no terminal."""
    import time

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from marsexplorer.training.ppo import Progress as State

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=None, note="")
        said, stage = 0.0, ""

        def tell(state: State) -> None:
            nonlocal said, stage
            progress.update(task, description=STAGES[state.stage], completed=state.done, total=state.total, note=state.note)
            now = time.monotonic()
            if not console.is_terminal and (state.stage != stage or now - said > 15):
                click.echo(f"{STAGES[state.stage]}: {state.done:,} of {state.total:,}  {state.note}", err=True)
                said, stage = now, state.stage

        yield tell
