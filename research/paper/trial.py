"""A trial: the training of one algorithm on one level and size with one seed, and the measurement of what it learnt.

Its folder has

    log.jsonl          "kind": "trial", the trial, its settings and versions; then lines of "kind": "curve"; last "result"
    NAME.onnx          the policy with its card

A line of the curve is of the moment: `moves` and `cpu_s` (CPU seconds of this process) so far, `episodes` ended so far, and
means over the last EPISODES_PER_LINE episodes as they were played in training: normalized `score`, `coverage`, `steps`,
and how they ended, as shares (`explored` is completion, then `collided`, `out_of_bounds`, `timed_out`).
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import torch

from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import score
from marsexplorer.evaluation import RULES, evaluate
from marsexplorer.evaluation.cards import digest
from marsexplorer.training.envs import EVALUATION_SEEDS, RecentEpisodes
from research.paper.algorithms import Trainer, begin
from research.paper.jobs import OnProgress, read_lines, write_lines

EPISODES_PER_LINE = 100
LINES = 100
"""Lines of the curve of a whole trial."""
ENDINGS = ("explored", "collided", "out_of_bounds", "timed_out")
EPISODES = ("moves", "actions")
"""What the card says of each episode, and the log does not."""
HELD_OUT_TERRAINS = 200
"""Terrains that the trained policy is measured on."""
LIBRARIES = ("torch", "numpy", "gymnasium", "tianshou")
HARDWARE = f"{platform.machine()}, one thread"
TRAINING_SHARE = 0.95
"""What training counts of a trial's progress; the rest is the measurement."""


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

    def is_done(self, folder: Path) -> bool:
        """Return whether its log ends with a result."""
        lines = read_lines(folder / self.name / "log.jsonl")
        return bool(lines) and lines[-1]["kind"] == "result" and lines[0]["trial"] == asdict(self)

    def run(self, folder: Path, on_progress: OnProgress) -> None:
        """Train and measure, and write the policy and the log."""
        torch.set_num_threads(1)
        own, begun = folder / self.name, time.process_time()
        own.mkdir(parents=True, exist_ok=True)
        trainer = begin(self.algorithm, self.variant, self.config, self.seed, self.moves)
        interval = max(1, self.moves // LINES)
        lines: list[dict[str, Any]] = []
        while trainer.moves < self.moves:
            before = trainer.moves
            numbers = trainer.advance()
            if before // interval < trainer.moves // interval or trainer.moves >= self.moves:
                means = recent_means(self.config, trainer.envs.recent)
                lines.append(_curve_line(trainer, time.process_time() - begun, means | numbers))
            on_progress(TRAINING_SHARE * min(1.0, trainer.moves / self.moves))
        cpu_s = round(time.process_time() - begun, 2)
        policy = own / f"{self.name}.onnx"
        trainer.save_policy(policy, self._card(trainer))

        def on_episode(played: int, episodes: int) -> None:
            on_progress(TRAINING_SHARE + (1.0 - TRAINING_SHARE) * played / episodes)

        result = measure(policy, self, on_episode)
        results = {f"{self.level} {self.size}x{self.size}": result}
        trainer.save_policy(policy, {**self._card(trainer), "results": results})
        figures = {name: each for name, each in result.items() if name not in EPISODES}
        last = {"kind": "result", "moves": trainer.moves, "cpu_s": cpu_s, **figures}
        write_lines(own / "log.jsonl", [self._head(trainer), *lines, last])

    def _head(self, trainer: Trainer) -> dict[str, Any]:
        return {
            "kind": "trial",
            "trial": asdict(self),
            "settings": trainer.settings,
            "versions": {name: _version(name) for name in LIBRARIES},
            "hardware": HARDWARE,
        }

    def _card(self, trainer: Trainer) -> dict[str, Any]:
        training = {"trial": asdict(self), "settings": trainer.settings, "moves": trainer.moves}
        what = f"{self.algorithm} ({self.variant}): {trainer.moves:,} moves on {self.level}"
        return {
            "summary": f"{what}, seed {self.seed}.",
            "hardware": HARDWARE,
            "size": [self.size, self.size],
            "training": training,
        }


def _curve_line(trainer: Trainer, cpu_s: float, numbers: dict[str, float]) -> dict[str, Any]:
    rounded = {
        name: round(value, 6) if np.isfinite(value) else None for name, value in numbers.items()
    }
    return {"kind": "curve", "moves": trainer.moves, "cpu_s": round(cpu_s, 2), **rounded}


def recent_means(config: EnvConfig, recent: RecentEpisodes) -> dict[str, float]:
    """Return the means over the last EPISODES_PER_LINE episodes, NaN before the first has ended."""
    columns: dict[str, list[float]] = {
        "score": [score(config, each) for each in recent.returns],
        "coverage": list(recent.coverages),
        "steps": [float(each) for each in recent.steps],
        **{ending: [outcome == ending for outcome in recent.outcomes] for ending in ENDINGS},
    }
    means = {
        name: float(np.mean(values[-EPISODES_PER_LINE:])) if values else float("nan")
        for name, values in columns.items()
    }
    return {"episodes": float(recent.count), **means}


def measure(policy: Path, trial: Trial, on_episode: Callable[[int, int], None]) -> dict[str, Any]:
    """Return how the policy in a file does on held-out terrains, and the best frontier rule on the same."""
    table = evaluate(
        [str(policy), *RULES],
        trial.config,
        trial.terrains,
        EVALUATION_SEEDS.start,
        on_episode,
        traces=True,
    )
    own, *rules = table.rows
    played = [result for result in table.results if result.policy == own.policy]
    outcomes = [result.outcome for result in played]
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
        "moves": [each.steps for each in played],
        **habits([each.trace.actions for each in played if each.trace]),
        "actions": [digest(each.trace.actions) for each in played if each.trace],
    }


def habits(episodes: Sequence[Sequence[int]]) -> dict[str, Any]:
    """Return the commonest action of some episodes, its share of all moves, and the entropy of the moves in nats."""
    counts = np.bincount([action for episode in episodes for action in episode], minlength=4)
    shares = counts / counts.sum()
    entropy = -sum(share * np.log(share) for share in shares if share)
    return {
        "commonest": ACTIONS[int(shares.argmax())],
        "commonest_share": round(float(shares.max()), 4),
        "entropy_of_moves": round(float(entropy), 4),
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
