"""The command `python -m research.refinement`: learn from the cost of other moves."""

from __future__ import annotations

import platform
import signal
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import click

from humanplay.command.console import noted_progress, written
from humanplay.command.options import COUNT, path_option, several
from humanplay.jobs import Jobs, cores
from humanplay.tasks.mars.cli.cards import commit, measure_policy
from humanplay.tasks.mars.cli.options import seed_option
from humanplay.tasks.mars.cli.policies import file_of, policy_errors
from marsexplorer.config import EnvConfig
from marsexplorer.policies.files.card import read_card
from marsexplorer.training.network import load_net, save_network
from marsexplorer.training.run_folder import write_log
from research.refinement.refine import RefineRun, RoundMetrics, config_for

COMMAND = "python -m research.refinement"


@click.command(context_settings={"show_default": True})
@click.argument("policy", default="ppo")
@click.option("--rounds", type=COUNT, default=30, help="Rounds of play; the first takes longest.")
@several(
    "--size",
    "sizes",
    "Side of the square grids whose episodes are branched; repeatable.",
    type=click.IntRange(21, 84),
    default=(21,),
)
@seed_option("The same seed and rounds give the same weights.")
@path_option("--out", "Folder of the run.  [default: runs/POLICY-refined-sSEED]")
@click.option("--workers", type=COUNT, help="Processes that play.  [default: one for each core]")
def refine(
    policy: str,
    rounds: int,
    sizes: tuple[int, ...],
    seed: int,
    out: Path | None,
    workers: int | None,
) -> None:
    """Improve a policy that `marsexplorer train` made, POLICY being its name or file.

    Its episodes are branched: at some steps another move is made and the episode is played to its
    end, so that the network learns which moves would have been better. On grids that are not
    branched the network is kept close to what it was. The folder --out gets the policy with its
    card and a log after every round; Ctrl-C loses only the round under way. Refining takes about 3
    GiB of memory, and 1 GiB more for each process.

    \b
    Examples:
      python -m research.refinement                              the shipped policy, 30 rounds
      python -m research.refinement runs/mine/mine.onnx --rounds 10
      humanplay serve --policy runs/mine-refined-s0/mine-refined-s0.onnx
    """
    with policy_errors():
        path = file_of(policy)
        net, card = load_net(path), read_card(path)
    folder = out or Path("runs") / f"{path.stem}-refined-s{seed}"
    file = folder / f"{folder.resolve().name}.onnx"
    if file.exists():
        raise click.UsageError(
            f"{file} exists already; go on from it ({COMMAND} {file}) or give another --out"
        )
    options = "".join(f" --size {size}" for size in sizes if sizes != (21,))
    command = f"{COMMAND} {policy}{options} --rounds {rounds} --seed {seed} --out {folder.name}"
    processes, was_refined = workers or cores(), "pairs" in card.get("training", {})
    run = RefineRun(net, seed, config_for(rounds, sizes, was_refined))
    machine = f"{platform.machine()}, {processes} cores"
    own_card = {"command": command, "commit": commit(), "hardware": machine}
    output = RefineOutput(file, run, card, own_card)
    try:
        with written(f"to {folder}"):
            refine_policy(output, rounds, processes)
    except KeyboardInterrupt:
        left = "nothing is written before the first round is done"
        if run.rounds_done:
            left = f"{file} is as it was after round {run.rounds_done}"
        click.echo(f"stopped; {left}", err=True)
        raise
    click.echo(f"{file}: {measure_policy(file, output.save_policy, [EnvConfig()])}")


_SAME = {"round": "round", "loss": "loss"}
_NAMED = {"num_pairs": "pairs", "better_share": "better", "episode_steps": "steps"}
ROUND_LOG_COLUMNS = {**_SAME, **_NAMED}
"""Field of RoundMetrics -> its name in log.jsonl and in the policy's card, which stays what it
was.
"""


def refine_policy(output: RefineOutput, rounds: int, processes: int) -> None:
    """Make the rounds in so many processes, and write them; Ctrl-C ends a round early."""
    run = output.run
    output.file.parent.mkdir(parents=True, exist_ok=True)
    bar = noted_progress("refining", rounds, "the first round is a long one")
    with bar as advance, Jobs(processes) as jobs:
        while run.rounds_done < rounds:
            metrics = run.train_round(jobs, lambda done: advance(run.rounds_done + done))
            output.save_round(metrics)
            means = metrics.episode_steps.items()
            steps = ", ".join(f"{mean:.1f} at {size}" for size, mean in means)
            note = f"round {metrics.round}, {metrics.num_pairs:,} pairs: {steps} moves an episode"
            advance(run.rounds_done, note, note)


@dataclass
class RefineOutput:
    """Writes the policy with its card, and log.jsonl beside it, after every round.

    file      of the policy
    card      of the policy that the run began with
    own_card  what replaces parts of it
    """

    file: Path
    run: RefineRun
    card: dict[str, Any]
    own_card: dict[str, Any]
    _lines: list[dict[str, Any]] = field(default_factory=list)
    _started: float = field(default_factory=time.monotonic)

    def save_round(self, metrics: RoundMetrics) -> None:
        """Add a round to the log and write both files."""
        line = {ROUND_LOG_COLUMNS[name]: number for name, number in asdict(metrics).items()}
        self._lines.append({**line, "seconds": round(time.monotonic() - self._started, 1)})
        write_log(self.file.with_name("log.jsonl"), self._lines)
        self.save_policy({"results": {}})

    def save_policy(self, results: dict[str, Any]) -> None:
        """Write the policy file; `results` are added to its card."""
        run, card = self.run, self.card
        fields = ("command", "commit", "hardware", "results", "training")
        training = {
            "rounds": run.rounds_done,
            "pairs": run.num_pairs,
            "seconds": self._lines[-1]["seconds"],
            "seed": run.seed,
            "plan": asdict(run.config),
            "log": self._lines,
            "began_with": {key: card.get(key) for key in fields},
        }
        refined = f"Refined on {run.num_pairs:,} pairs of moves."
        summary = f"{card.get('summary', 'A network.')} {refined}"
        whole = {**card, **self.own_card, "summary": summary, **results, "training": training}
        save_network(run.net, self.file, whole)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # it keeps what it has done
    refine(prog_name=COMMAND)
