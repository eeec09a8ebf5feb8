"""The folder of a training run: its log, learning curve, checkpoints and policy file.

NAME.safetensors   the policy with its card, NAME being the folder's
checkpoint.pt      what `--resume` goes on from (tensors and numbers, no pickled code)
log.jsonl          a line an update
curve.png          moves an episode against moves played: as sampled in training, and greedily on terrains kept apart
events.out.*       the log for TensorBoard
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from marsexplorer.files import replace_whole, write_whole
from marsexplorer.policies.network.model import save_network
from marsexplorer.training.envs import Boards
from marsexplorer.training.ppo import Report, Run, think

VALIDATION_SEED = 2 * 10**9
"""First of the terrains that the curve's greedy trials are on: neither trained on nor evaluated on."""
TRIALS = 20
"""Greedy trials in a run."""
TRIAL_BOARDS = 100
KEEP_S = 60.0
"""Seconds between checkpoints."""


class Logbook:
    """Writes the folder as the run goes; `heard` is the run's `tell`, and `keep` ends it. Every file is replaced whole.

    card   what the policy's card says besides the numbers of the run
    """

    def __init__(self, folder: Path, run: Run, card: dict[str, Any], tell: Callable[[Report, float], None]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self._run, self._card, self._tell = folder, run, card, tell
        self.policy = folder / f"{folder.resolve().name}.safetensors"
        self._lines: list[dict[str, Any]] = []
        self._spent_before, self._began, self._kept = 0.0, time.monotonic(), time.monotonic()
        self._events = events(folder)

    @property
    def seconds(self) -> float:
        """Seconds the run has taken, those before an interruption included."""
        return self._spent_before + time.monotonic() - self._began

    def resume(self) -> None:
        """Return with the run where its checkpoint left it; ValueError when the folder holds none of this run."""
        path = self.folder / "checkpoint.pt"
        if not path.is_file():
            raise ValueError(f"no checkpoint in {self.folder}; leave --resume out to begin a run there")
        kept = torch.load(path, weights_only=True)
        wanted = json.loads(json.dumps(self._run.identity))
        if (came := json.loads(kept["identity"])) != wanted:
            differs = ", ".join(name for name in wanted if came.get(name) != wanted[name])
            raise ValueError(f"the checkpoint in {self.folder} is of another run ({differs}); give the options it began with")
        self._run.load(kept["run"])
        self._spent_before = kept["seconds"]
        log = self.folder / "log.jsonl"
        lines = [json.loads(line) for line in log.read_text().splitlines()] if log.is_file() else []
        self._lines = [line for line in lines if line["moves"] <= self._run.moves]

    def heard(self, report: Report) -> None:
        """Take an update's report in; every now and then keep the run."""
        line = {name: None if value != value else value for name, value in asdict(report).items()}
        line["seconds"] = round(self.seconds, 1)
        every = max(1, self._run.updates // TRIALS)
        if self._run.done % every == 0 or self._run.done == self._run.updates:
            line["greedy"], line["greedy_explored"] = trial(self._run)
        self._lines.append(line)
        for name, value in line.items():
            if value is not None and name != "moves":
                self._events.add_scalar(f"train/{name}", value, report.moves)
        if time.monotonic() - self._kept > KEEP_S:
            self.keep()
        self._tell(report, self.seconds)

    def keep(self) -> None:
        """Write everything."""
        self._kept = time.monotonic()
        state = {"identity": json.dumps(self._run.identity), "run": self._run.save(), "seconds": self.seconds}
        with replace_whole(self.folder / "checkpoint.pt") as unfinished:
            torch.save(state, unfinished)
        text = "".join(json.dumps(line) + "\n" for line in self._lines)
        with write_whole(self.folder / "log.jsonl") as file:
            file.write(text.encode())
        with replace_whole(self.folder / "curve.png") as unfinished:
            draw(self._lines, unfinished)
        self.keep_policy({})

    def keep_policy(self, results: dict[str, Any]) -> None:
        """Write the policy file; `results` go into its card."""
        run = self._run
        numbers = {"moves": run.moves, "updates": run.done, "seconds": round(self.seconds), "seed": run.seed}
        training = {**numbers, "recipe": run.recipe.to_dict(), "curve": [line for line in self._lines if "greedy" in line]}
        save_network(run.net, self.policy, {**self._card, **results, "training": training}, run.recipe.format)


def trial(run: Run) -> tuple[float, float]:
    """Return (mean moves, share explored) of the most probable moves on 100 terrains; unfinished ones count max_steps."""
    config = run.configs[0]
    boards = Boards(config, TRIAL_BOARDS, VALIDATION_SEED, run.recipe.view)
    steps, explored = np.zeros(TRIAL_BOARDS, np.int64), np.zeros(TRIAL_BOARDS, np.bool_)
    with torch.no_grad():
        for count in range(1, config.limit + 1):
            step = boards.step(think(run, boards.look())[0].argmax(1).cpu().numpy())
            fresh = step.ended & (steps == 0)
            explored |= fresh & step.explored
            steps[fresh] = np.where(step.explored[fresh], count, config.limit)
            if steps.all():
                break
    return float(np.where(steps == 0, config.limit, steps).mean()), float(explored.mean())


def events(folder: Path) -> Any:
    """Return a writer of TensorBoard events."""
    from tensorboardX import SummaryWriter

    return SummaryWriter(str(folder))


def draw(lines: list[dict[str, Any]], path: Path) -> None:
    """Draw the learning curve."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.add_subplot()
    played = [(line["moves"] / 1e6, line["steps"]) for line in lines if line["steps"] is not None]
    tried = [(line["moves"] / 1e6, line["greedy"]) for line in lines if "greedy" in line]
    if played:
        axes.plot(*zip(*played, strict=True), color="#c8603c", label="in training, moves sampled")
    if tried:
        axes.plot(*zip(*tried, strict=True), color="#1b7f79", marker="o", label=f"greedy, {TRIAL_BOARDS} terrains kept apart")
    axes.set_xlabel("million moves played")
    axes.set_ylabel("moves an episode")
    axes.grid(alpha=0.3)
    if played or tried:
        axes.legend()
    figure.savefig(path, format="png", dpi=120)
