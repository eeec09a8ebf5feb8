"""The command `marsexplorer refine`: a trained policy learns what other moves would have cost it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from app.cli.console import PATH, reason, seed_option
from app.cli.training.cards import commit, hardware, measure_policy

if TYPE_CHECKING:
    from marsexplorer.training.refine import RefineRun, RoundMetrics


@click.command(short_help="Improve a trained policy by trying other moves.")
@click.argument("policy", default="ppo")
@click.option(
    "--rounds",
    type=click.IntRange(min=1),
    default=30,
    show_default=True,
    help="Rounds of playing and learning; the first takes longest.",
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
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes that play episodes.  [default: one for each core]",
)
def refine(
    policy: str,
    rounds: int,
    sizes: tuple[int, ...],
    seed: int,
    out: Path | None,
    workers: int | None,
) -> None:
    """Improve a policy that `train` made, POLICY being its name or file.

    Its episodes are branched: at some steps another move is made and the episode is played to its end, so that the network
    learns which moves would have been better. On grids that are not branched the network is kept close to what it
    was. The folder --out gets the policy with its card and a log after every round; Ctrl-C
    loses only the round under way. Refining takes about 3 GiB of memory, and 1 GiB more for each process.

    \b
    Examples:
      marsexplorer refine                                           the shipped policy, 30 rounds
      marsexplorer refine runs/mine/mine.onnx --rounds 10
      marsexplorer serve --policy runs/mine-refined-s0/mine-refined-s0.onnx
    """
    from app.jobs import cores
    from marsexplorer.config import EnvConfig
    from marsexplorer.policies.base import PolicyFileError
    from marsexplorer.policies.files.card import read_card, shipped
    from marsexplorer.training.network import load_net
    from marsexplorer.training.refine import RefineRun, config_for

    path = shipped().get(policy, Path(policy))
    try:
        net, card = load_net(path), read_card(path)
    except PolicyFileError as error:
        raise click.UsageError(str(error)) from error
    folder = out or Path("runs") / f"{path.stem}-refined-s{seed}"
    file = folder / f"{folder.resolve().name}.onnx"
    if file.exists():
        raise click.UsageError(
            f"{file} exists already; go on from it (marsexplorer refine {file}) or give another --out"
        )
    options = "".join(f" --size {size}" for size in sizes if sizes != (21,))
    command = (
        f"marsexplorer refine {policy}{options} --rounds {rounds} --seed {seed} --out {folder.name}"
    )
    processes = workers or cores()
    run = RefineRun(
        net, seed, config_for(rounds, sizes, was_refined="pairs" in card.get("training", {}))
    )
    own_card = {"command": command, "commit": commit(), "hardware": hardware(processes)}
    output = RefineOutput(file, run, rounds, card, own_card, folder / "log.jsonl")
    try:
        refine_policy(output, processes)
    except OSError as error:
        raise click.ClickException(
            f"cannot write to {folder}: {reason(error)}; choose another --out"
        ) from error
    except KeyboardInterrupt:
        left = (
            f"{file} is as it was after round {run.rounds_done}"
            if run.rounds_done
            else "nothing is written before the first round is done"
        )
        click.echo(f"stopped; {left}", err=True)
        raise
    click.echo(f"{file}: {measure_policy(file, output.save_policy, [EnvConfig()])}")


ROUND_LOG_COLUMNS = {
    "round": "round",
    "num_pairs": "pairs",
    "better_share": "better",
    "loss": "loss",
    "episode_steps": "steps",
}
"""Field of RoundMetrics -> its name in log.jsonl and in the policy's card, which stays what it was."""


def refine_policy(output: RefineOutput, processes: int) -> None:
    """Make the rounds that are left and write them; Ctrl-C ends the one under way."""
    output.file.parent.mkdir(parents=True, exist_ok=True)
    with _progress_bar(output.rounds) as advance:
        _make_rounds(output, processes, advance)


def _make_rounds(
    output: RefineOutput, processes: int, advance: Callable[[float, str | None], None]
) -> None:
    """Make the rounds, with the episodes played in processes of their own."""
    from app.jobs import Jobs

    run, rounds = output.run, output.rounds
    if run.rounds_done >= rounds:
        output.save_policy({"results": {}})
        return
    with Jobs(processes) as jobs:
        while run.rounds_done < rounds:
            metrics = run.train_round(jobs, lambda done: advance(run.rounds_done + done, None))
            output.save_round(metrics)
            steps = ", ".join(
                f"{mean:.1f} at {size}" for size, mean in metrics.episode_steps.items()
            )
            advance(
                run.rounds_done,
                f"round {metrics.round}, {metrics.num_pairs:,} pairs: {steps} moves an episode",
            )


@dataclass
class RefineOutput:
    """Writes the policy with its card, and the log, whole after every round.

    file        of the policy
    run, rounds how many rounds it has in all
    card        of the policy that the run began with; own_card: what replaces parts of it
    log         file of the log, a line for each round
    checkpoint  what `resume` goes on from; None: no such file
    """

    file: Path
    run: RefineRun
    rounds: int
    card: dict[str, Any]
    own_card: dict[str, Any]
    log: Path
    checkpoint: Path | None = None
    _lines: list[dict[str, Any]] = field(default_factory=list)
    _started: float = field(default_factory=time.monotonic)

    def resume(self) -> None:
        """Set the run to where its checkpoint left it, if there is one; ValueError when that is of another run."""
        import torch

        if self.checkpoint is None or not self.checkpoint.is_file():
            return
        found = torch.load(self.checkpoint, weights_only=True)
        began = json.loads(found["identity"])
        if began != self._identity:
            differing = ", ".join(
                name for name, value in self._identity.items() if began.get(name) != value
            )
            raise ValueError(
                f"{self.checkpoint} is of another run ({differing}); give the options it began with"
            )
        self.run.load_state_dict(found["run"])
        lines = (
            [json.loads(line) for line in self.log.read_text().splitlines()]
            if self.log.is_file()
            else []
        )
        self._lines = [line for line in lines if line["round"] <= self.run.rounds_done]
        self._started -= found["seconds"]

    @property
    def _identity(self) -> dict[str, Any]:
        """What must agree for the checkpoint to be gone on from."""
        return {"rounds": self.rounds, **self.run.identity}

    def save_round(self, metrics: RoundMetrics) -> None:
        """Add a round to the log and write all files; after the last round the checkpoint keeps no samples."""
        import torch

        from marsexplorer.files import replace_whole, write_whole

        line = {ROUND_LOG_COLUMNS[name]: value for name, value in asdict(metrics).items()}
        self._lines.append({**line, "seconds": round(time.monotonic() - self._started, 1)})
        text = "".join(json.dumps(line) + "\n" for line in self._lines)
        with write_whole(self.log) as file:
            file.write(text.encode())
        self.save_policy({"results": {}})
        if self.checkpoint:
            state = self.run.state_dict(with_samples=self.run.rounds_done < self.rounds)
            seconds = self._lines[-1]["seconds"]
            with replace_whole(self.checkpoint) as path:
                torch.save(
                    {"identity": json.dumps(self._identity), "run": state, "seconds": seconds}, path
                )

    def save_policy(self, results: dict[str, Any]) -> None:
        """Write the policy file; `results` are added to its card."""
        from marsexplorer.training.network import save_network

        run, card = self.run, self.card
        seconds = self._lines[-1]["seconds"] if self._lines else 0.0
        numbers = {
            "rounds": run.rounds_done,
            "pairs": run.num_pairs,
            "seconds": seconds,
            "seed": run.seed,
        }
        began_with = {
            key: card.get(key) for key in ("command", "commit", "hardware", "results", "training")
        }
        training = {
            **numbers,
            "plan": asdict(run.config),
            "log": self._lines,
            "began_with": began_with,
        }
        parts = [
            str(card.get("summary", "A network.")),
            f"Refined on {run.num_pairs:,} pairs of moves." * (run.rounds_done > 0),
        ]
        summary = " ".join(part for part in parts if part)
        whole = {**card, **self.own_card, "summary": summary, **results, "training": training}
        save_network(run.net, self.file, whole)


@contextmanager
def _progress_bar(rounds: int) -> Iterator[Callable[[float, str | None], None]]:
    """Yield `advance(rounds done, note)` that moves a bar on stderr, or prints each note where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (
        TextColumn("refining"),
        BarColumn(),
        TextColumn("{task.fields[note]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=rounds, note="the first round is a long one")

        def advance(done: float, note: str | None) -> None:
            progress.update(task, completed=done)
            if note:
                progress.update(task, note=note)
                if not console.is_terminal:
                    click.echo(note, err=True)

        yield advance
