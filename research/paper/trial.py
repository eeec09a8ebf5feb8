"""A trial: train one algorithm on one level with one seed, and measure it.

Its folder has

    log.jsonl          "kind": "trial", the trial, its settings and versions; then lines of "kind":
                       "curve"; last "result"
    NAME.onnx          the policy with its card
    checkpoint.pt      of an unfinished training, saved every CHECKPOINT_INTERVAL_S and when it is
                       stopped. It goes on from there exactly, or from CARRIED, where an earlier
                       machine left it

A line of the curve has the `moves`, `cpu_s` and `episodes` so far, and means over the last
EPISODES_PER_LINE episodes as they were played in training: normalized `score`, `coverage`, `steps`,
and how they ended, as shares (`explored` is completion, then `collided`, `out_of_bounds`,
`timed_out`). `cpu_s` are CPU seconds of this process: None after another kind of machine, and
beside an accelerator, whose time they do not include.
"""

from __future__ import annotations

import platform
import re
import shutil
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
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
from marsexplorer.files import replace_whole
from marsexplorer.training.envs import EVALUATION_SEEDS, RecentEpisodes
from research.paper.algorithms import Trainer, begin
from research.paper.jobs import OnProgress, read_lines, write_lines

EPISODES_PER_LINE = 100
LINES = 100
"""Lines of the curve of a whole trial."""
ENDINGS = ("explored", "collided", "out_of_bounds", "timed_out")
EPISODES = ("moves", "actions")
"""The fields of the card about each episode, which the log does not have."""
HELD_OUT_TERRAINS = 200
"""Terrains that the trained policy is measured on."""
LIBRARIES = ("torch", "numpy", "gymnasium", "tianshou")
CHECKPOINT_INTERVAL_S = 600.0
LARGEST_CHECKPOINT = 10_000_000
"""Bytes of a checkpoint that is carried to another machine."""
CARRIED = Path(__file__).parent / "data" / "checkpoints"
"""The checkpoints of unfinished trainings that --export wrote: NAME.pt."""
TRAINING_SHARE = 0.95
"""Share of training in a trial's progress; the rest is the measurement."""


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
        """Whether its log ends with a result."""
        lines = read_lines(folder / self.name / "log.jsonl")
        return bool(lines) and lines[-1]["kind"] == "result" and lines[0]["trial"] == asdict(self)

    def run(self, folder: Path, on_progress: OnProgress) -> None:
        """Train, from a checkpoint if there is one, measure, and write policy and log."""
        torch.set_num_threads(1)
        # The optimisers' means of units that are dead fade to numbers that cost ten times as much.
        torch.set_flush_denormal(True)
        trial_folder, begun = folder / self.name, time.process_time()
        trial_folder.mkdir(parents=True, exist_ok=True)
        trainer = begin(self.algorithm, self.variant, self.config, self.seed, self.moves)
        interval = max(1, self.moves // LINES)
        lines: list[dict[str, Any]] = []
        machines = [hardware()]
        checkpoint = trial_folder / "checkpoint.pt"
        if (stored := self._stored(checkpoint)) is not None:
            trainer.load_state_dict(stored["trainer"])
            lines, begun = stored["lines"], begun - stored["cpu_s"]
            machines = [*dict.fromkeys([*stored["machines"], *machines])]
        is_timed = len(machines) == 1 and not accelerator()

        def save() -> None:
            so_far = {"lines": lines, "cpu_s": time.process_time() - begun, "machines": machines}
            state = {"trainer": trainer.state_dict(), **so_far}
            with replace_whole(checkpoint) as path:
                torch.save({"trial": asdict(self), "moves": trainer.moves, **state}, path)

        saved = time.monotonic()
        while trainer.moves < self.moves:
            before = trainer.moves
            numbers = trainer.advance()
            if before // interval < trainer.moves // interval or trainer.moves >= self.moves:
                means = recent_means(self.config, trainer.envs.recent)
                cpu_s = round(time.process_time() - begun, 2) if is_timed else None
                lines.append(_curve_line(trainer, cpu_s, means | numbers))
            try:
                on_progress(TRAINING_SHARE * min(1.0, trainer.moves / self.moves))
            except KeyboardInterrupt:
                save()
                raise
            if time.monotonic() - saved > CHECKPOINT_INTERVAL_S:
                save()
                saved = time.monotonic()
        policy = trial_folder / f"{self.name}.onnx"
        trainer.save_policy(policy, self._card(trainer, machines))

        def on_episode(played: int, episodes: int) -> None:
            on_progress(TRAINING_SHARE + (1.0 - TRAINING_SHARE) * played / episodes)

        measured = measure(policy, self, on_episode)
        results = {f"{self.level} {self.size}x{self.size}": measured}
        trainer.save_policy(policy, {**self._card(trainer, machines), "results": results})
        measures = {name: measure for name, measure in measured.items() if name not in EPISODES}
        last = {"kind": "result", "moves": trainer.moves, "cpu_s": lines[-1]["cpu_s"], **measures}
        write_lines(trial_folder / "log.jsonl", [self._head(trainer, machines), *lines, last])
        checkpoint.unlink(missing_ok=True)

    def _stored(self, checkpoint: Path) -> dict[str, Any] | None:
        """The checkpoint of this trial, in its own folder or else in CARRIED, or None.

        ValueError if its own folder has the checkpoint of a trial with other options.
        """
        for path in (checkpoint, CARRIED / f"{self.name}.pt"):
            if not path.is_file():
                continue
            stored: dict[str, Any] = torch.load(path, "cpu", weights_only=True)
            if stored["trial"] == asdict(self):
                return stored
            if path == checkpoint:
                raise ValueError(
                    f"{checkpoint} is of another trial ({stored['trial']}); give another --out"
                )
        return None

    def _head(self, trainer: Trainer, machines: Sequence[str]) -> dict[str, Any]:
        return {
            "kind": "trial",
            "trial": asdict(self),
            "settings": trainer.settings,
            "versions": {name: _version(name) for name in LIBRARIES},
            "hardware": "; then ".join(machines),
        }

    def _card(self, trainer: Trainer, machines: Sequence[str]) -> dict[str, Any]:
        training = {"trial": asdict(self), "settings": trainer.settings, "moves": trainer.moves}
        return {
            "summary": f"{self.algorithm} ({self.variant}): {trainer.moves:,} moves on {self.level}, seed {self.seed}.",
            "hardware": "; then ".join(machines),
            "size": [self.size, self.size],
            "training": training,
        }


def carry(folder: Path, target: Path) -> list[str]:
    """Copy the checkpoints in `folder` to `target`; return a sentence about each.

    Copies of trials that have finished are deleted.
    """
    sentences = []
    for copy in target.glob("*.pt"):
        head = next(iter(read_lines(folder / copy.stem / "log.jsonl")), None)
        if (
            head is not None
            and head["trial"] == torch.load(copy, "cpu", weights_only=True)["trial"]
        ):
            copy.unlink()
    for checkpoint in sorted(folder.glob("*/checkpoint.pt")):
        copy = target / f"{checkpoint.parent.name}.pt"
        size = checkpoint.stat().st_size
        if size > LARGEST_CHECKPOINT:
            sentences.append(f"{checkpoint} stays: {size / 1e6:.0f} MB are too many to carry")
            continue
        target.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(checkpoint, copy)
        sentences.append(
            f"{copy}: {torch.load(copy, 'cpu', weights_only=True)['moves']:,} moves so far"
        )
    return sentences


def read_unfinished(folder: Path = CARRIED) -> list[dict[str, Any]]:
    """The progress of the carried trials: `trial`, `moves`, and last `line`."""
    checkpoints = (
        torch.load(path, "cpu", weights_only=True) for path in sorted(folder.glob("*.pt"))
    )
    return [
        {
            "trial": Trial(**checkpoint["trial"]),
            "moves": checkpoint["moves"],
            "line": (checkpoint["lines"] or [{}])[-1],
        }
        for checkpoint in checkpoints
    ]


def accelerator() -> str:
    """The name of the CUDA device that PPO and Rainbow learn on, "" if there is none."""
    return torch.cuda.get_device_name() if torch.cuda.is_available() else ""


def processor(info: Path = Path("/proc/cpuinfo")) -> str:
    """The model of the processor, "" if the system does not name it."""
    with suppress(OSError):
        if model := re.search(r"^model name\s*: (.+)$", info.read_text(), re.M):
            return model[1].strip()
    named = platform.processor()
    return "" if named == platform.machine() else named


def hardware() -> str:
    """The hardware of a trial in words: machine, processor, and accelerator."""
    beside = accelerator()
    parts = (platform.machine(), processor(), "one thread", beside and f"beside {beside}")
    return ", ".join(filter(None, parts))


def names_processor(logged: str | None) -> bool:
    """Whether logged hardware has the model of the processor; earlier logs do not."""
    return ", " in (logged or "").partition(", one thread")[0]


def _curve_line(trainer: Trainer, cpu_s: float | None, numbers: dict[str, float]) -> dict[str, Any]:
    rounded = {
        name: round(number, 6) if np.isfinite(number) else None for name, number in numbers.items()
    }
    return {"kind": "curve", "moves": trainer.moves, "cpu_s": cpu_s, **rounded}


def recent_means(config: EnvConfig, recent: RecentEpisodes) -> dict[str, float]:
    """The means over the last EPISODES_PER_LINE episodes, NaN before the first."""
    columns: dict[str, list[float]] = {
        "score": [score(config, total) for total in recent.returns],
        "coverage": list(recent.coverages),
        "steps": [float(steps) for steps in recent.steps],
        **{ending: [outcome == ending for outcome in recent.outcomes] for ending in ENDINGS},
    }
    means = {
        name: float(np.mean(values[-EPISODES_PER_LINE:])) if values else float("nan")
        for name, values in columns.items()
    }
    return {"episodes": float(recent.count), **means}


def measure(policy: Path, trial: Trial, on_episode: Callable[[int, int], None]) -> dict[str, Any]:
    """The measures of a policy on held-out terrains, with the best frontier rule's."""
    table = evaluate(
        [str(policy), *RULES],
        trial.config,
        trial.terrains,
        EVALUATION_SEEDS.start,
        on_episode,
        traces=True,
    )
    row, *rules = table.rows
    played = [result for result in table.results if result.policy == row.policy]
    outcomes = [result.outcome for result in played]
    return {
        "terrains": trial.terrains,
        "first_seed": EVALUATION_SEEDS.start,
        "steps": round(row.steps_mean, 2),
        "completion": row.completion,
        "collisions": row.collisions,
        "score": round(row.score_mean, 4),
        "coverage": round(row.coverage_mean, 4),
        **{ending: outcomes.count(ending) / len(outcomes) for ending in ENDINGS},
        "best_rule_steps": round(min(rule.steps_mean for rule in rules), 2),
        "moves": [result.steps for result in played],
        **habits([result.trace.actions for result in played if result.trace]),
        "actions": [digest(result.trace.actions) for result in played if result.trace],
    }


def habits(episodes: Sequence[Sequence[int]]) -> dict[str, Any]:
    """The commonest action of some episodes, its share, and the moves' entropy.

    entropy  in nats
    """
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
