"""The command `marsexplorer refine`: a trained policy learns what other moves would have cost it."""

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

from app.cli.console import PATH, interruptible, reason, seed_option
from app.cli.training.train import commit, measure_policy

if TYPE_CHECKING:
    from marsexplorer.training.refine import RefineRun, RoundMetrics

ROUND_LOG_COLUMNS = {
    "round": "round",
    "num_pairs": "pairs",
    "better_share": "better",
    "loss": "loss",
    "episode_steps": "steps",
}
"""Field of RoundMetrics -> its name in log.jsonl and in the policy's card, which stays what it was."""


@click.command(short_help="Improve a trained policy by trying other moves.")
@click.argument("policy", default="ppo")
@click.option(
    "--rounds",
    type=click.IntRange(min=0),
    default=30,
    show_default=True,
    help="Rounds of playing and learning; the first takes longest. With --prices, 0 adds them and learns nothing.",
)
@click.option(
    "--prices",
    is_flag=True,
    help="First give the network what follows from the prices of unknown cells; on large grids it then begins by their rules.",
)
@click.option(
    "--size",
    "sizes",
    type=click.IntRange(21, 84),
    multiple=True,
    default=(21,),
    show_default=True,
    help="Side of the square grids whose episodes are branched; repeatable.",
)
@seed_option("The same seed and rounds give the same weights.")
@click.option("--out", type=PATH, help="Folder of the run.  [default: runs/POLICY-refined-sSEED]")
@click.option("--workers", type=click.IntRange(min=1), help="Processes that play episodes.  [default: one for each core]")
def refine(
    policy: str, rounds: int, prices: bool, sizes: tuple[int, ...], seed: int, out: Path | None, workers: int | None
) -> None:
    """Improve a policy that `train --recipe best` made, POLICY being its name or file.

    Its episodes are branched: at some steps another move is made and the episode is played to its end, so that the network
    learns which moves would have been better. On grids that are not branched the network is kept close to what it was, or to
    the rules that --prices brings. The folder --out gets the policy with its card and a log after every round; Ctrl-C
    loses only the round under way. Refining takes about 3 GiB of memory, and 1 GiB more for each process.

    \b
    Examples:
      marsexplorer refine                                           the shipped policy, 30 rounds
      marsexplorer refine runs/mine/mine.safetensors --rounds 10
      marsexplorer refine ppo --prices --rounds 0 --out runs/priced    some seconds: better on large grids, else the same
      marsexplorer serve --policy runs/mine-refined-s0/mine-refined-s0.safetensors
    """
    from marsexplorer.config import EnvConfig
    from marsexplorer.evaluation.episodes import cores
    from marsexplorer.policies.base import PolicyFileError
    from marsexplorer.policies.files.card import read_card, shipped
    from marsexplorer.policies.network.model import load_net, with_prices
    from marsexplorer.training.refine import RefineConfig, RefineRun

    path = shipped().get(policy, Path(policy))
    try:
        net, card = load_net(path), read_card(path)
    except PolicyFileError as error:
        raise click.UsageError(str(error)) from error
    if prices and net.sees_prices:
        raise click.UsageError(f"{policy} sees prices already; leave --prices out")
    if not prices and not rounds:
        raise click.UsageError("--rounds 0 changes nothing without --prices; give more rounds, or --prices")
    net = with_prices(net) if prices else net
    folder = out or Path("runs") / f"{path.stem}-refined-s{seed}"
    file = folder / f"{folder.resolve().name}.safetensors"
    if file.exists():
        raise click.UsageError(f"{file} exists already; go on from it (marsexplorer refine {file}) or give another --out")
    options = "".join([" --prices" * prices, *(f" --size {size}" for size in sizes if sizes != (21,))])
    command = f"marsexplorer refine {policy}{options} --rounds {rounds} --seed {seed} --out {folder.name}"
    processes = workers or cores()
    was_refined = "pairs" in card.get("training", {})  # then it is no longer almost certain of every move
    config = RefineConfig(
        sizes=tuple(dict.fromkeys(sizes)),
        first_round_tasks=max(1, round(0.6 * rounds)),
        first_round_steps=max(1, round(0.45 * rounds)),
        logit_scale=1.0 if was_refined else RefineConfig.logit_scale,
    )
    run = RefineRun(net, seed, config)
    own_card = {"command": command, "commit": commit(), "hardware": f"{platform.machine()}, {processes} cores"}
    output = _RefineOutput(file, run, card, own_card, prices)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with _progress_bar(rounds) as advance:
            interruptible(lambda: _refine(run, rounds, processes, output, advance))
    except OSError as error:
        raise click.ClickException(f"cannot write to {folder}: {reason(error)}; choose another --out") from error
    except KeyboardInterrupt:
        left = (
            f"{file} is as it was after round {run.rounds_done}"
            if run.rounds_done
            else "nothing is written before the first round is done"
        )
        click.echo(f"stopped; {left}", err=True)
        raise
    click.echo(f"{file}: {measure_policy(file, output.save_policy, EnvConfig())}")


def _refine(
    run: RefineRun, rounds: int, processes: int, output: _RefineOutput, advance: Callable[[float, str | None], None]
) -> None:
    """Make the rounds, with the episodes played in processes of their own."""
    from marsexplorer.evaluation.episodes import one_thread

    if not rounds:
        output.save_policy({"results": {}})
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, spawn, one_thread) as pool:
        while run.rounds_done < rounds:
            metrics = run.train_round(pool, lambda done: advance(run.rounds_done + done, None))
            output.save_round(metrics)
            steps = ", ".join(f"{mean:.1f} at {size}" for size, mean in metrics.episode_steps.items())
            advance(run.rounds_done, f"round {metrics.round}, {metrics.num_pairs:,} pairs: {steps} moves an episode")


class _RefineOutput:
    """Writes the policy with its card, and the log, whole after every round.

    card         of the policy that the run began with; own_card: what replaces parts of it
    adds_prices  whether the network that the run began with was given prices by it
    """

    def __init__(self, file: Path, run: RefineRun, card: dict[str, Any], own_card: dict[str, Any], adds_prices: bool) -> None:
        self._adds_prices = adds_prices
        self._file, self._run, self._own_card, self._card = file, run, own_card, card
        self._lines: list[dict[str, Any]] = []
        self._started = time.monotonic()

    def save_round(self, metrics: RoundMetrics) -> None:
        """Add a round to the log and write both files."""
        from marsexplorer.files import write_whole

        line = {ROUND_LOG_COLUMNS[name]: value for name, value in asdict(metrics).items()}
        self._lines.append({**line, "seconds": round(time.monotonic() - self._started, 1)})
        text = "".join(json.dumps(line) + "\n" for line in self._lines)
        with write_whole(self._file.with_name("log.jsonl")) as file:
            file.write(text.encode())
        self.save_policy({"results": {}})

    def save_policy(self, results: dict[str, Any]) -> None:
        """Write the policy file; `results` are added to its card."""
        from marsexplorer.policies.files.weights import save_network
        from marsexplorer.policies.network.model import format_of

        run, card = self._run, self._card
        seconds = self._lines[-1]["seconds"] if self._lines else 0.0
        numbers = {"rounds": run.rounds_done, "pairs": run.num_pairs, "seconds": seconds, "seed": run.seed}
        began_with = {key: card.get(key) for key in ("command", "commit", "hardware", "training")}
        training = {**numbers, "plan": asdict(run.config), "log": self._lines, "began_with": began_with}
        parts = [
            str(card.get("summary", "A network.")),
            "On larger grids it begins by the prices of unknown cells." * self._adds_prices,
            f"Refined on {run.num_pairs:,} pairs of moves." * (run.rounds_done > 0),
        ]
        summary = " ".join(part for part in parts if part)
        whole = {**card, **self._own_card, "summary": summary, **results, "training": training}
        save_network(run.net, self._file, whole, format_of(run.net))


@contextmanager
def _progress_bar(rounds: int) -> Iterator[Callable[[float, str | None], None]]:
    """Yield `advance(rounds done, note)` that moves a bar on stderr, or prints each note where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("refining"), BarColumn(), TextColumn("{task.fields[note]}"), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=rounds, note="the first round is a long one")

        def advance(done: float, note: str | None) -> None:
            progress.update(task, completed=done)
            if note:
                progress.update(task, note=note)
                if not console.is_terminal:
                    click.echo(note, err=True)

        yield advance
