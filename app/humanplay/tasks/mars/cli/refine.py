"""The command `marsexplorer refine`: a trained policy learns what other moves would have cost it."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click import UsageError, argument, echo, option

from humanplay.command.console import noted_progress, written
from humanplay.command.options import COUNT, WORKERS, path_option, several
from humanplay.tasks.mars.cli.cards import commit, hardware, measure_policy
from humanplay.tasks.mars.cli.options import seed_option
from humanplay.tasks.mars.cli.policies import file_of, policy_errors

if TYPE_CHECKING:
    from marsexplorer.training.refine import RefineRun, RoundMetrics


@click.command(short_help="Improve a trained policy by trying other moves.")
@argument("policy", default="ppo")
@option("--rounds", type=COUNT, default=30, help="Rounds of play; the first takes longest.")
@several(
    "--size",
    "sizes",
    "Side of the square grids whose episodes are branched; repeatable.",
    type=click.IntRange(21, 84),
    default=(21,),
)
@seed_option("The same seed and rounds give the same weights.")
@path_option("--out", "Folder of the run.  [default: runs/POLICY-refined-sSEED]")
@WORKERS
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
      humanplay serve --policy runs/mine-refined-s0/mine-refined-s0.onnx
    """
    from humanplay.jobs import cores
    from marsexplorer.config import EnvConfig
    from marsexplorer.policies.files.card import read_card
    from marsexplorer.training.network import load_net
    from marsexplorer.training.refine import RefineRun, config_for

    with policy_errors():
        path = file_of(policy)
        net, card = load_net(path), read_card(path)
    folder = out or Path("runs") / f"{path.stem}-refined-s{seed}"
    file = folder / f"{folder.resolve().name}.onnx"
    if file.exists():
        way_out = f"go on from it (marsexplorer refine {file}) or give another --out"
        raise UsageError(f"{file} exists already; {way_out}")
    options = "".join(f" --size {size}" for size in sizes if sizes != (21,))
    given = f"{policy}{options} --rounds {rounds} --seed {seed} --out {folder.name}"
    processes, was_refined = workers or cores(), "pairs" in card.get("training", {})
    run = RefineRun(net, seed, config_for(rounds, sizes, was_refined))
    own_card = own_card_of(f"marsexplorer refine {given}", processes)
    output = RefineOutput(file, run, rounds, card, own_card, folder / "log.jsonl")
    try:
        with written(f"to {folder}"):
            refine_policy(output, processes)
    except KeyboardInterrupt:
        left = "nothing is written before the first round is done"
        if run.rounds_done:
            left = f"{file} is as it was after round {run.rounds_done}"
        echo(f"stopped; {left}", err=True)
        raise
    echo(f"{file}: {measure_policy(file, output.save_policy, [EnvConfig()])}")


_SAME = {"round": "round", "loss": "loss"}
_NAMED = {"num_pairs": "pairs", "better_share": "better", "episode_steps": "steps"}
ROUND_LOG_COLUMNS = {**_SAME, **_NAMED}
"""Field of RoundMetrics -> its name in log.jsonl and in the policy's card, which stays what it was."""


def own_card_of(command: str, processes: int) -> dict[str, Any]:
    """Return what the card of a refined policy says of this run alone."""
    return {"command": command, "commit": commit(), "hardware": hardware(processes)}


def refine_policy(output: RefineOutput, processes: int) -> None:
    """Make the rounds that are left, in so many processes, and write them; Ctrl-C ends the one under way."""
    from humanplay.jobs import Jobs

    run, rounds = output.run, output.rounds
    output.file.parent.mkdir(parents=True, exist_ok=True)
    if run.rounds_done >= rounds:
        output.save_policy({"results": {}})
        return
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

        from marsexplorer.training.run_folder import differing_names, read_log

        if self.checkpoint is None or not self.checkpoint.is_file():
            return
        found = torch.load(self.checkpoint, weights_only=True)
        if differing := differing_names(found["identity"], self._identity):
            other = f"of another run ({differing})"
            raise ValueError(f"{self.checkpoint} is {other}; give the options it began with")
        self.run.load_state_dict(found["run"])
        lines = read_log(self.log)
        self._lines = [line for line in lines if line["round"] <= self.run.rounds_done]
        self._started -= found["seconds"]

    @property
    def _identity(self) -> dict[str, Any]:
        """What must agree for the checkpoint to be gone on from."""
        return {"rounds": self.rounds, **self.run.identity}

    def save_round(self, metrics: RoundMetrics) -> None:
        """Add a round to the log and write all files; after the last round the checkpoint keeps no samples."""
        import torch

        from marsexplorer.files import replace_whole
        from marsexplorer.training.run_folder import write_log

        line = {ROUND_LOG_COLUMNS[name]: value for name, value in asdict(metrics).items()}
        self._lines.append({**line, "seconds": round(time.monotonic() - self._started, 1)})
        write_log(self.log, self._lines)
        self.save_policy({"results": {}})
        if self.checkpoint:
            state = self.run.state_dict(with_samples=self.run.rounds_done < self.rounds)
            found = {"identity": json.dumps(self._identity), "run": state}
            with replace_whole(self.checkpoint) as path:
                torch.save({**found, "seconds": self._lines[-1]["seconds"]}, path)

    def save_policy(self, results: dict[str, Any]) -> None:
        """Write the policy file; `results` are added to its card."""
        from marsexplorer.training.network import save_network

        run, card = self.run, self.card
        kept = ("command", "commit", "hardware", "results", "training")
        training = {
            "rounds": run.rounds_done,
            "pairs": run.num_pairs,
            "seconds": self._lines[-1]["seconds"] if self._lines else 0.0,
            "seed": run.seed,
            "plan": asdict(run.config),
            "log": self._lines,
            "began_with": {key: card.get(key) for key in kept},
        }
        summary = str(card.get("summary", "A network."))
        if run.rounds_done:
            summary = f"{summary} Refined on {run.num_pairs:,} pairs of moves.".lstrip()
        whole = {**card, **self.own_card, "summary": summary, **results, "training": training}
        save_network(run.net, self.file, whole)
