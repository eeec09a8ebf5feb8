"""What the commands about policies share: an error of the disk in one sentence, and what a trained policy's card says."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from click import ClickException, echo

from humanplay.cli.console import reason

if TYPE_CHECKING:
    from marsexplorer.config import EnvConfig

HELD_OUT_TERRAINS = 200
"""Terrains of 21x21 or less that a finished policy is measured on for its card; on larger grids fewer, with as many cells."""


@contextmanager
def written(place: Path | str, option: str = "--out") -> Iterator[None]:
    """Turn an error of the disk into one sentence: what cannot be written, why, and the option to give another of."""
    try:
        yield
    except OSError as error:
        why = f"{reason(error)}; choose another {option}"
        raise ClickException(f"cannot write {place}: {why}") from error


@contextmanager
def noted_progress(what: str, total: int, note: str = "") -> Iterator[Callable[..., None]]:
    """Yield `advance(done, note, line)`: it moves a bar with a note on stderr, or prints the line where that is no terminal.

    An empty note leaves the one before, and of an empty line nothing is printed.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console, noted = Console(stderr=True), TextColumn("{task.fields[note]}")
    columns = (TextColumn(what), BarColumn(), noted, TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=total, note=note)

        def advance(done: float, note: str = "", line: str = "") -> None:
            bar.update(task, completed=done)
            if note:
                bar.update(task, note=note)
            if line and not console.is_terminal:
                echo(line, err=True)

        yield advance


def commit() -> str | None:
    """Return the commit of the checkout this runs from; None outside one, also where a package lies in another checkout."""
    root = Path(__file__).resolve().parents[4]
    command = ["git", "-C", str(root), "rev-parse", "--show-toplevel", "HEAD"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    top, head = done.stdout.splitlines()
    return head if Path(top) == root else None


def hardware(processes: int) -> str:
    """Return what the card says of the machine."""
    return f"{platform.machine()}, {processes} cores"


def measure_policy(
    file: Path, save_policy: Callable[[dict[str, Any]], None], configs: list[EnvConfig]
) -> str:
    """Return a sentence on how the policy in a file does on held-out terrains of each configuration.

    save_policy   is called with the numbers, to write them into the card
    """
    from humanplay.jobs import Jobs
    from marsexplorer.config import EnvConfig
    from marsexplorer.evaluation.cards import result_for_card
    from marsexplorer.training.envs import EVALUATION_SEEDS

    results, sentences = {}, []
    with Jobs() as jobs:
        for config in configs:
            terrains = min(HELD_OUT_TERRAINS, max(2, HELD_OUT_TERRAINS * EnvConfig().n // config.n))
            where, first = f"{config.level} {config.rows}x{config.cols}", EVALUATION_SEEDS.start
            found = results[where] = result_for_card(file, config, terrains, first, executor=jobs)
            steps = f"{found['steps']:.1f} steps to 99 % on {terrains} terrains of {where} ({found['completion']:.0%} explored)"
            sentences.append(f"{steps}, the best rule {found['best_rule_steps']:.1f}")
    save_policy({"results": results})
    return "; ".join(sentences)
