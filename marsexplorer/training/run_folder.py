"""The folder of a training run: log, learning curve, checkpoints, policy file.

NAME.onnx          the policy with its card, NAME being the folder's
checkpoint.pt      what `--resume` goes on from, tensors, numbers and lists without pickled code:
                   identity (JSON of `TrainingRun.identity`), run (`TrainingRun.state_dict`),
                   seconds
log.jsonl          a line for each update
curve.png          moves of an episode against steps played: as sampled in training, and greedily on
                   validation terrains
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
from marsexplorer.training.envs import TrainingEnvs
from marsexplorer.training.ppo import TrainingRun, UpdateMetrics, forward

VALIDATION_SEED = 2 * 10**9
"""Seed of the first validation terrain: those are neither trained on nor evaluated on."""
NUM_VALIDATIONS = 20
"""Times in a run that the greedy policy is measured on the validation terrains, besides the one
after the first update: readers of JSON lines take the columns from the first lines.
"""
VALIDATION_EPISODES = 100
CHECKPOINT_INTERVAL_S = 60.0
"""Seconds between checkpoints."""

LOG_COLUMNS = {
    "global_step": "moves",
    "episode_steps": "steps",
    "explored": "explored",
    "episode_return": "returned",
    "entropy": "entropy",
    "ratio_change": "moved",
    "explained_variance": "explained",
}
"""Field of UpdateMetrics -> its name in log.jsonl, in TensorBoard and in the policy's card,
which stays what it was.
"""


class RunFolder:
    """Writes the folder of a run under way; files are replaced whole.

    Pass `on_update` to `train`, and call `save` at the end.

    card       the policy's card besides the numbers of the run
    on_update  called with the metrics of each update and the seconds that the run has taken
    """

    def __init__(
        self,
        folder: Path,
        run: TrainingRun,
        card: dict[str, Any],
        on_update: Callable[[UpdateMetrics, float], None],
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self._run, self._card, self._on_update = folder, run, card, on_update
        self.policy = folder / f"{folder.resolve().name}.onnx"
        self._lines: list[dict[str, Any]] = []
        self._seconds_before, self._started, self._saved = 0.0, time.monotonic(), time.monotonic()
        from tensorboardX import SummaryWriter  # it takes a second to load

        self._tensorboard = SummaryWriter(str(folder))

    @property
    def seconds(self) -> float:
        """Seconds that the run has taken, those before an interruption included."""
        return self._seconds_before + time.monotonic() - self._started

    def resume(self) -> None:
        """Set the run to its checkpoint; ValueError if the folder has none of this run."""
        path = self.folder / "checkpoint.pt"
        if not path.is_file():
            raise ValueError(
                f"no checkpoint in {self.folder}; leave --resume out to begin a run there"
            )
        checkpoint = torch.load(path, "cpu", weights_only=True)
        if differing := differing_names(checkpoint["identity"], self._run.identity):
            raise ValueError(
                f"the checkpoint in {self.folder} is of another run ({differing}); give the options it began with"
            )
        self._run.load_state_dict(checkpoint["run"])
        self._seconds_before = checkpoint["seconds"]
        lines = read_log(self.folder / "log.jsonl")
        self._lines = [line for line in lines if line["moves"] <= self._run.global_step]

    def on_update(self, metrics: UpdateMetrics) -> None:
        """Log an update; save all if the last checkpoint is CHECKPOINT_INTERVAL_S old."""
        line: dict[str, Any] = {
            LOG_COLUMNS[name]: None if number != number else number
            for name, number in asdict(metrics).items()
        }
        line["seconds"] = round(self.seconds, 1)
        run = self._run
        interval = max(1, run.num_updates // NUM_VALIDATIONS)
        if run.updates_done % interval == 0 or run.updates_done in (1, run.num_updates):
            line["greedy"], line["greedy_explored"] = validate(run)
        self._lines.append(line)
        for name, number in line.items():
            if number is not None and name != "moves":
                self._tensorboard.add_scalar(f"train/{name}", number, metrics.global_step)
        if time.monotonic() - self._saved > CHECKPOINT_INTERVAL_S:
            self.save()
        self._on_update(metrics, self.seconds)

    def save(self) -> None:
        """Write the checkpoint, the log, the learning curve and the policy file."""
        self._saved = time.monotonic()
        checkpoint = {"identity": json.dumps(self._run.identity), "seconds": self.seconds}
        checkpoint["run"] = self._run.state_dict()
        with replace_whole(self.folder / "checkpoint.pt") as path:
            torch.save(checkpoint, path)
        write_log(self.folder / "log.jsonl", self._lines)
        with replace_whole(self.folder / "curve.png") as path:
            plot_learning_curve(self._lines, path)
        self.save_policy({})

    def save_policy(self, results: dict[str, Any]) -> None:
        """Write the policy file; `results` are added to its card."""
        run = self._run
        training = {
            "moves": run.global_step,
            "updates": run.updates_done,
            "seconds": round(self.seconds),
            "seed": run.seed,
            "recipe": run.config.to_dict(),
            "curve": [line for line in self._lines if "greedy" in line],
        }
        card = {**self._card, **results, "training": training}
        run.config.save_policy(run.player, self.policy, card)


def steps_of(folder: Path) -> int:
    """The moves that the run in a folder was begun with, from its checkpoint.

    ValueError if there is none.
    """
    path = folder / "checkpoint.pt"
    if not path.is_file():
        raise ValueError(f"no checkpoint in {folder}; leave --resume out to begin a run there")
    identity = json.loads(torch.load(path, weights_only=True)["identity"])
    config = identity["config"]
    return int(identity["num_updates"] * config["num_envs"] * config["num_steps"])


def differing_names(stored: str, identity: dict[str, Any]) -> str:
    """The names in which a checkpoint's identity (JSON) differs from this run's."""
    checkpoint, expected = json.loads(stored), json.loads(json.dumps(identity))
    return ", ".join(
        name for name in expected | checkpoint if checkpoint.get(name) != expected.get(name)
    )


def read_log(path: Path) -> list[dict[str, Any]]:
    """The lines of a log, none if there is no such file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []


def write_log(path: Path, lines: list[dict[str, Any]]) -> None:
    """Write a log, whole or not at all."""
    with write_whole(path) as file:
        file.write("".join(json.dumps(line) + "\n" for line in lines).encode())


def validate(run: TrainingRun) -> tuple[float, float]:
    """(mean moves, share explored) of the greedy policy on 100 terrains.

    Unfinished episodes count max_steps.
    """
    config = run.env_configs[0]
    envs = TrainingEnvs(config, VALIDATION_EPISODES, VALIDATION_SEED, run.config.make_encoder)
    steps = np.zeros(VALIDATION_EPISODES, np.int64)
    explored = np.zeros(VALIDATION_EPISODES, np.bool_)
    with torch.no_grad():
        for count in range(1, config.limit + 1):
            step = envs.step(forward(run, envs.observe())[0].argmax(1).numpy())
            first_end = step.dones & (steps == 0)
            explored |= first_end & step.explored
            steps[first_end] = np.where(step.explored[first_end], count, config.limit)
            if steps.all():
                break
    return float(np.where(steps == 0, config.limit, steps).mean()), float(explored.mean())


def plot_learning_curve(lines: list[dict[str, Any]], path: Path) -> None:
    """Draw the learning curve from the log's lines and write it as a PNG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.add_subplot()
    sampled = [(line["moves"] / 1e6, line["steps"]) for line in lines if line["steps"] is not None]
    greedy = [(line["moves"] / 1e6, line["greedy"]) for line in lines if "greedy" in line]
    if sampled:
        axes.plot(*zip(*sampled, strict=True), color="#c8603c", label="in training, moves sampled")
    if greedy:
        label = f"greedy, {VALIDATION_EPISODES} terrains kept apart"
        axes.plot(*zip(*greedy, strict=True), color="#1b7f79", marker="o", label=label)
    axes.set_xlabel("million moves played")
    axes.set_ylabel("moves an episode")
    axes.grid(alpha=0.3)
    if sampled or greedy:
        axes.legend()
    figure.savefig(path, format="png", dpi=120)
