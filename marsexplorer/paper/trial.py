"""A trial: the training of one algorithm on one level and size with one seed, and the measurement of what it learnt.

Its folder has

    log.jsonl          "kind": "trial", the trial, its settings and versions; then lines of "kind": "curve"; last "result"
    checkpoint.pt      what an interrupted trial goes on from: tensors and numbers, no pickled code
    NAME.safetensors   the policy with its card

A line of the curve is of the moment: `moves` and `cpu_s` (CPU seconds of this process) so far, `episodes` ended so far, and
means over the last EPISODES_PER_LINE episodes as they were played in training: normalized `score`, `coverage`, `steps`,
and how they ended, as shares (`explored` is completion, then `collided`, `out_of_bounds`, `timed_out`).
"""

from __future__ import annotations

import json
import platform
import time
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import torch

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import RULES, evaluate
from marsexplorer.evaluation.run import Progress
from marsexplorer.files import replace_whole, write_whole
from marsexplorer.paper.algorithms import begin
from marsexplorer.paper.job import OnProgress
from marsexplorer.paper.trainer import Trainer
from marsexplorer.score import score
from marsexplorer.training.envs import EVALUATION_SEEDS, RecentEpisodes
from marsexplorer.training.interrupts import postponed_interrupt

FORMAT_VERSION = 1
EPISODES_PER_LINE = 100
LINES = 100
"""Lines of the curve of a whole trial."""
CHECKPOINT_INTERVAL_S = 60.0
"""Seconds between checkpoints, at least."""
SAVING_SHARE = 0.04
"""Share of the time that saving may take: where a replay buffer makes it slow, checkpoints are further apart."""
ENDINGS = ("explored", "collided", "out_of_bounds", "timed_out")
HELD_OUT_TERRAINS = 200
"""Terrains that the trained policy is measured on."""
LIBRARIES = ("torch", "numpy", "gymnasium", "tianshou")
MOVES_PER_CPU_SECOND = {
    "a2c": 5400.0,
    "a2c-works": 3000.0,
    "a2c-tuned": 7000.0,
    "ppo": 2200.0,
    "ppo-appendix": 270.0,
    "ppo-tuned": 11000.0,
    "ppo-tuned-no-batch": 2200.0,
    "rainbow": 230.0,
    "rainbow-tuned": 830.0,
    "sac": 117.0,
    "sac-tuned": 465.0,
}
"""What forecasts begin from: of an algorithm and variant, else of `works` for works-no-CHANGE, else of the algorithm."""
START_CPU_S = 6.0
"""CPU seconds in which libraries are imported."""
CPU_S_PER_TERRAIN = 0.08
"""CPU seconds of a held-out terrain, for the policy and both rules."""


@dataclass(frozen=True)
class Trial:
    """One training as a job.

    algorithm, variant  of `algorithms.begin`
    level, size         of the environment; size is the side of a square grid, cells
    seed                of everything drawn in training
    moves               to train for
    terrains            held-out terrains to measure the policy on
    """

    algorithm: str
    variant: str
    level: str
    size: int
    seed: int
    moves: int
    terrains: int = HELD_OUT_TERRAINS

    @property
    def name(self) -> str:
        """Name of its folder and policy file."""
        return f"{self.algorithm}-{self.variant}-{self.level}-{self.size}-s{self.seed}"

    @property
    def config(self) -> EnvConfig:
        """The environment."""
        return EnvConfig.of(self.level, self.size)

    @property
    def forecast(self) -> float:
        """CPU seconds, about."""
        return (
            self.moves / moves_per_cpu_second(self.algorithm, self.variant)
            + START_CPU_S
            + self._measuring_s
        )

    @property
    def _measuring_s(self) -> float:
        """CPU seconds of the measurement, about."""
        return CPU_S_PER_TERRAIN * self.terrains

    def is_done(self, folder: Path) -> bool:
        """Return whether its log ends with a result."""
        lines = read_log(folder / self.name / "log.jsonl")
        return bool(lines) and lines[-1]["kind"] == "result" and lines[0]["trial"] == asdict(self)

    def run(self, folder: Path, on_progress: OnProgress) -> None:
        """Train, from the checkpoint if there is one, and measure; ValueError when the folder holds another trial.

        on_progress   called with the share of both that is done, 0..1; what it raises stops either
        """
        if self.is_done(folder):
            (folder / self.name / "checkpoint.pt").unlink(missing_ok=True)  # a kill can leave it
            return
        torch.set_num_threads(1)
        trainer = begin(self.algorithm, self.variant, self.config, self.seed, self.moves)
        run = _Run(self, trainer, folder / self.name)
        run.resume()
        training = 1.0 - self._measuring_s / self.forecast
        try:
            while trainer.moves < self.moves:
                run.advance()
                on_progress(training * min(1.0, trainer.moves / self.moves))
        except KeyboardInterrupt:
            run.stop()
            raise
        run.finish(
            lambda played, episodes: on_progress(training + (1.0 - training) * played / episodes)
        )


def moves_per_cpu_second(algorithm: str, variant: str) -> float:
    """Return about how fast an algorithm trains on one core."""
    names = (f"{algorithm}-{variant}", f"{algorithm}-{variant.partition('-no-')[0]}", algorithm)
    return next(
        (MOVES_PER_CPU_SECOND[name] for name in names if name in MOVES_PER_CPU_SECOND), 1000.0
    )


class _Run:
    """A trial under way and its files."""

    def __init__(self, trial: Trial, trainer: Trainer, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._trial, self._trainer, self._folder = trial, trainer, folder
        self.policy = folder / f"{trial.name}.safetensors"
        self._head = {
            "kind": "trial",
            "trial": asdict(trial),
            "settings": trainer.settings,
            "versions": {name: _version(name) for name in LIBRARIES},
            "hardware": f"{platform.machine()}, one thread",
        }
        self._lines: list[dict[str, Any]] = []
        self._cpu_before, self._cpu_begun = 0.0, time.process_time()
        self._save_due, self._is_between_rounds = time.monotonic() + CHECKPOINT_INTERVAL_S, True

    @property
    def cpu_seconds(self) -> float:
        """CPU seconds of this process for the trial, those before an interruption included."""
        return self._cpu_before + time.process_time() - self._cpu_begun

    def resume(self) -> None:
        """Set everything to where the checkpoint left it, if there is one."""
        path, lines = self._folder / "checkpoint.pt", read_log(self._folder / "log.jsonl")
        checkpoint = torch.load(path, weights_only=True) if path.is_file() else None
        found = {**self._identity, "trial": lines[0]["trial"]} if lines else self._identity
        if checkpoint is not None:
            found = json.loads(checkpoint["identity"])
        if found != self._identity:
            raise ValueError(
                f"{self._folder} holds another trial; give another --out, or the options that it began with"
            )
        for unfinished in self._folder.glob(
            ".*.part"
        ):  # a killed process leaves the file that it was writing
            unfinished.unlink()
        if checkpoint is None:
            return
        self._trainer.load_state_dict(checkpoint["trainer"])
        self._cpu_before = checkpoint["cpu_s"]
        self._lines = [
            line
            for line in lines
            if line["kind"] == "curve" and line["moves"] <= self._trainer.moves
        ]

    @property
    def _identity(self) -> dict[str, Any]:
        """What must agree for a checkpoint to go on."""
        head: dict[str, Any] = json.loads(
            json.dumps({name: self._head[name] for name in ("trial", "settings")})
        )
        return {"version": FORMAT_VERSION, **head}

    def advance(self) -> None:
        """Make one round; add a line to the curve where one is due, and save when the last checkpoint is old.

        KeyboardInterrupt comes after the round; only a second Ctrl-C breaks into it.
        """
        trainer, interval = self._trainer, max(1, self._trial.moves // LINES)
        before = trainer.moves
        with postponed_interrupt():
            self._is_between_rounds = False
            numbers = trainer.advance()
            if before // interval < trainer.moves // interval or trainer.moves >= self._trial.moves:
                self._lines.append(self._line(numbers))
            self._is_between_rounds = True
        if time.monotonic() > self._save_due:
            self.save()

    def stop(self) -> None:
        """Save, unless a round was broken off: then the last checkpoint is the newest whole state."""
        if self._is_between_rounds:
            self.save()

    def _line(self, numbers: dict[str, float]) -> dict[str, Any]:
        means = recent_means(self._trial.config, self._trainer.envs.recent)
        rounded = {
            name: round(value, 6) if np.isfinite(value) else None
            for name, value in {**means, **numbers}.items()
        }
        return {
            "kind": "curve",
            "moves": self._trainer.moves,
            "cpu_s": round(self.cpu_seconds, 2),
            **rounded,
        }

    def save(self) -> None:
        """Write the log, the policy and the checkpoint.

        The checkpoint is last, so whenever the process is killed the log has every line up to it; lines beyond are dropped.
        """
        begun = time.monotonic()
        self._write_log(self._lines)
        self._save_policy({})
        checkpoint = {
            "identity": json.dumps(self._identity),
            "trainer": self._trainer.state_dict(),
            "cpu_s": self.cpu_seconds,
        }
        with replace_whole(self._folder / "checkpoint.pt") as path:
            torch.save(checkpoint, path)
        now = time.monotonic()
        self._save_due = now + max(CHECKPOINT_INTERVAL_S, (now - begun) / SAVING_SHARE)

    def finish(self, on_episode: Progress) -> None:
        """Measure the policy on held-out terrains, write the result and drop the checkpoint.

        on_episode   called with the episodes played and in all
        """
        self.save()
        cpu_s = round(self.cpu_seconds, 2)
        result = measure(self.policy, self._trial, on_episode)
        self._save_policy({f"{self._trial.level} {self._trial.size}x{self._trial.size}": result})
        last = {"kind": "result", "moves": self._trainer.moves, "cpu_s": cpu_s, **result}
        self._write_log([*self._lines, last])
        (self._folder / "checkpoint.pt").unlink()

    def _write_log(self, lines: list[dict[str, Any]]) -> None:
        text = "".join(json.dumps(line) + "\n" for line in [self._head, *lines])
        with write_whole(self._folder / "log.jsonl") as file:
            file.write(text.encode())

    def _save_policy(self, results: dict[str, Any]) -> None:
        trial, moves = self._trial, self._trainer.moves
        card = {
            "summary": f"{trial.algorithm} ({trial.variant}): {moves:,} moves on {trial.level}, seed {trial.seed}.",
            "hardware": self._head["hardware"],
            "size": [trial.size, trial.size],
            "training": {
                "trial": asdict(trial),
                "settings": self._trainer.settings,
                "moves": moves,
            },
            **({"results": results} if results else {}),
        }
        self._trainer.save_policy(self.policy, card)


def recent_means(config: EnvConfig, recent: RecentEpisodes) -> dict[str, float]:
    """Return the means over the last EPISODES_PER_LINE episodes, NaN before the first has ended."""
    steps, returns, coverages = (
        list(each)[-EPISODES_PER_LINE:] for each in (recent.steps, recent.returns, recent.coverages)
    )
    outcomes = list(recent.outcomes)[-EPISODES_PER_LINE:]
    count = len(outcomes)
    shares = {
        ending: outcomes.count(ending) / count if count else float("nan") for ending in ENDINGS
    }
    columns: dict[str, list[float]] = {
        "score": [score(config, each) for each in returns],
        "coverage": coverages,
        "steps": [float(each) for each in steps],
    }
    means = {
        name: float(np.mean(values)) if count else float("nan") for name, values in columns.items()
    }
    return {"episodes": float(recent.count), **means, **shares}


def measure(policy: Path, trial: Trial, on_episode: Progress) -> dict[str, Any]:
    """Return how the policy in a file does on held-out terrains, and the best frontier rule on the same."""
    table = evaluate(
        [str(policy), *RULES],
        trial.config,
        trial.terrains,
        EVALUATION_SEEDS.start,
        on_episode,
    )
    own, *rules = table.rows
    outcomes = [result.outcome for result in table.results if result.policy == own.policy]
    return {
        "terrains": trial.terrains,
        "first_seed": EVALUATION_SEEDS.start,
        "steps": round(own.steps_mean, 2),
        "completion": own.completion,
        "collisions": own.collisions,
        "score": round(own.score_mean, 4),
        "coverage": round(own.coverage_mean, 4),
        **{ending: outcomes.count(ending) / len(outcomes) for ending in ENDINGS},
        "best_rule_steps": round(min(row.steps_mean for row in rules), 2),
    }


def read_log(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a log, none where there is no file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
