"""`marsexplorer refine`: a trained policy learns what other moves would have cost it."""

from __future__ import annotations

import json
import multiprocessing
import platform
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from app.cli.console import PATH, interruptible, reason
from app.cli.train import commit, tried

if TYPE_CHECKING:
    from marsexplorer.training.refine import Refining, Report


@click.command(short_help="Let a trained policy learn from moves it did not make.")
@click.argument("policy", default="ppo")
@click.option(
    "--rounds",
    type=click.IntRange(min=1),
    default=30,
    show_default=True,
    help="More find more; the first is the longest.",
)
@click.option(
    "--seed", type=click.IntRange(0, 1000), default=0, show_default=True, help="The same seed and rounds give the same weights."
)
@click.option("--out", type=PATH, help="Folder of the run.  [default: runs/POLICY-refined-sSEED]")
@click.option("--workers", type=click.IntRange(min=1), help="Processes that play.  [default: one per core]")
def refine(policy: str, rounds: int, seed: int, out: Path | None, workers: int | None) -> None:
    """Improve a policy that `train --recipe best` made, POLICY being its name or file.

    Its episodes on 21x21 are branched: at some moments another move is made and the episode played to its end, and the
    network learns which moves would have been the better ones. On larger grids it is held where it was. The folder --out
    gets the policy with its card and a log, whole after every round, so Ctrl-C loses the round under way alone. Takes
    some 3 GiB of memory, and 1 GiB more for each process.

    \b
    Examples:
      marsexplorer refine                                           the shipped policy, 30 rounds
      marsexplorer refine runs/mine/mine.safetensors --rounds 10
      marsexplorer serve --policy runs/mine-refined-s0/mine-refined-s0.safetensors
    """
    from marsexplorer.config import EnvConfig
    from marsexplorer.evaluation.play import cores
    from marsexplorer.policies.base import PolicyFileError
    from marsexplorer.policies.files.card import read_card, shipped
    from marsexplorer.policies.network.model import load_net
    from marsexplorer.training.refine import Plan, Refining

    path = shipped().get(policy, Path(policy))
    try:
        net, card = load_net(path), read_card(path)
    except PolicyFileError as error:
        raise click.UsageError(str(error)) from error
    folder = out or Path("runs") / f"{path.stem}-refined-s{seed}"
    file = folder / f"{folder.resolve().name}.safetensors"
    if file.exists():
        raise click.UsageError(f"{file} exists already; go on from it (marsexplorer refine {file}) or give another --out")
    words = f"marsexplorer refine {policy} --rounds {rounds} --seed {seed} --out {folder.name}"
    processes = workers or cores()
    softer = 1.0 if "pairs" in card.get("training", {}) else Plan.softer  # refined before: no longer certain of every move
    plan = Plan(opening=max(1, round(0.6 * rounds)), first=max(1, round(0.45 * rounds)), softer=softer)
    run = Refining(net, seed, plan)
    book = _Book(
        file, run, card, {"command": words, "commit": commit(), "hardware": f"{platform.machine()}, {processes} cores"}
    )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with _bar(rounds) as tell:
            interruptible(lambda: _play(run, rounds, processes, book, tell))
    except OSError as error:
        raise click.ClickException(f"cannot write to {folder}: {reason(error)}; choose another --out") from error
    except KeyboardInterrupt:
        left = (
            f"{file} is as it was after round {run.done}" if run.done else "nothing is written before the first round is done"
        )
        click.echo(f"stopped; {left}", err=True)
        raise
    click.echo(f"{file}: {tried(file, book.keep, EnvConfig())}")


def _play(run: Refining, rounds: int, processes: int, book: _Book, tell: Callable[[float, str | None], None]) -> None:
    from marsexplorer.evaluation.play import one_thread

    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, spawn, one_thread) as pool:
        while run.done < rounds:
            report = run.round(pool, lambda gone: tell(run.done + gone, None))
            book.heard(report)
            steps = ", ".join(f"{mean:.1f} at {size}" for size, mean in report.steps.items())
            tell(run.done, f"round {report.round}, {report.pairs:,} pairs: {steps} moves an episode")


class _Book:
    """Writes the policy with its card, and the log, whole after every round."""

    def __init__(self, file: Path, run: Refining, card: dict[str, Any], own: dict[str, Any]) -> None:
        self._file, self._run, self._own, self._card = file, run, own, card
        self._lines: list[dict[str, Any]] = []
        self._began = time.monotonic()

    def heard(self, report: Report) -> None:
        from marsexplorer.files import write_whole

        self._lines.append({**asdict(report), "seconds": round(time.monotonic() - self._began, 1)})
        text = "".join(json.dumps(line) + "\n" for line in self._lines)
        with write_whole(self._file.with_name("log.jsonl")) as file:
            file.write(text.encode())
        self.keep({"results": {}})

    def keep(self, results: dict[str, Any]) -> None:
        from marsexplorer.policies.network.model import save_network

        run, card = self._run, self._card
        numbers = {"rounds": run.done, "pairs": run.found, "seconds": self._lines[-1]["seconds"], "seed": run.seed}
        begun = {key: card.get(key) for key in ("command", "commit", "hardware", "training")}
        training = {**numbers, "plan": asdict(run.plan), "log": self._lines, "began_with": begun}
        summary = f"{card.get('summary', 'A network.')} Refined on {run.found:,} pairs of moves."
        save_network(run.net, self._file, {**card, **self._own, "summary": summary, **results, "training": training})


@contextmanager
def _bar(rounds: int) -> Iterator[Callable[[float, str | None], None]]:
    """Yield a `tell(rounds done, note)` that moves a bar on stderr, or prints each note where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("refining"), BarColumn(), TextColumn("{task.fields[note]}"), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=rounds, note="the first round is a long one")

        def tell(done: float, note: str | None) -> None:
            progress.update(task, completed=done)
            if note:
                progress.update(task, note=note)
                if not console.is_terminal:
                    click.echo(note, err=True)

        yield tell
