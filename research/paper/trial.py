"""A trial: the training of one algorithm on one level and size with one seed, and the measurement of what it learnt.

Its folder has

    log.jsonl          "kind": "trial", the trial, its settings and versions; then lines of "kind": "curve"; last "result"
    NAME.onnx          the policy with its card
    checkpoint.pt      of a training that is not finished: where it stands, saved every CHECKPOINT_INTERVAL_S and when it is
                       stopped. It goes on from there exactly, or from CARRIED, where an earlier machine left it

A line of the curve is of the moment: `moves` and `cpu_s` (CPU seconds of this process, None after another kind of machine and
beside an accelerator, whose time they do not tell) so far, `episodes` ended so far, and
means over the last EPISODES_PER_LINE episodes as they were played in training: normalized `score`, `coverage`, `steps`,
and how they ended, as shares (`explored` is completion, then `collided`, `out_of_bounds`, `timed_out`).
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
"""What the card says of each episode, and the log does not."""
HELD_OUT_TERRAINS = 200
"""Terrains that the trained policy is measured on."""
LIBRARIES = ("torch", "numpy", "gymnasium", "tianshou")
CHECKPOINT_INTERVAL_S = 600.0
LARGEST_CHECKPOINT = 10_000_000
"""Bytes of a checkpoint that is carried to another machine."""
CARRIED = Path(__file__).parent / "data" / "checkpoints"
"""What --export wrote of trainings that are not finished: NAME.pt."""
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
        """Train, from a checkpoint where there is one, and measure, and write the policy and the log."""
        torch.set_num_threads(1)
        # The optimisers' means of units that are dead fade to numbers that cost ten times as much.
        torch.set_flush_denormal(True)
        own, begun = folder / self.name, time.process_time()
        own.mkdir(parents=True, exist_ok=True)
        trainer = begin(self.algorithm, self.variant, self.config, self.seed, self.moves)
        interval = max(1, self.moves // LINES)
        lines: list[dict[str, Any]] = []
        machines = [hardware()]
        checkpoint = own / "checkpoint.pt"
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
        policy = own / f"{self.name}.onnx"
        trainer.save_policy(policy, self._card(trainer, machines))

        def on_episode(played: int, episodes: int) -> None:
            on_progress(TRAINING_SHARE + (1.0 - TRAINING_SHARE) * played / episodes)

        result = measure(policy, self, on_episode)
        results = {f"{self.level} {self.size}x{self.size}": result}
        trainer.save_policy(policy, {**self._card(trainer, machines), "results": results})
        figures = {name: each for name, each in result.items() if name not in EPISODES}
        last = {"kind": "result", "moves": trainer.moves, "cpu_s": lines[-1]["cpu_s"], **figures}
        write_lines(own / "log.jsonl", [self._head(trainer, machines), *lines, last])
        checkpoint.unlink(missing_ok=True)

    def _stored(self, own: Path) -> dict[str, Any] | None:
        """Return the checkpoint in the trial's own folder, else the one of this trial in CARRIED; None where neither is.

        ValueError when the own one is of a trial with other options.
        """
        for path in (own, CARRIED / f"{self.name}.pt"):
            if not path.is_file():
                continue
            stored: dict[str, Any] = torch.load(path, "cpu", weights_only=True)
            if stored["trial"] == asdict(self):
                return stored
            if path == own:
                raise ValueError(
                    f"{own} is of another trial ({stored['trial']}); give another --out"
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
        what = f"{self.algorithm} ({self.variant}): {trainer.moves:,} moves on {self.level}"
        return {
            "summary": f"{what}, seed {self.seed}.",
            "hardware": "; then ".join(machines),
            "size": [self.size, self.size],
            "training": training,
        }


def carry(folder: Path, target: Path) -> list[str]:
    """Copy the checkpoints of the trials in `folder` to `target`, and say each in a sentence; those of finished ones go."""
    said = []
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
            said.append(f"{checkpoint} stays: {size / 1e6:.0f} MB are too many to carry")
            continue
        target.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(checkpoint, copy)
        said.append(f"{copy}: {torch.load(copy, 'cpu', weights_only=True)['moves']:,} moves so far")
    return said


def read_unfinished(folder: Path = CARRIED) -> list[dict[str, Any]]:
    """Return how far the carried trials are: `trial`, `moves`, and the last line of the curve as `line`."""
    found = (torch.load(path, "cpu", weights_only=True) for path in sorted(folder.glob("*.pt")))
    return [
        {
            "trial": Trial(**each["trial"]),
            "moves": each["moves"],
            "line": (each["lines"] or [{}])[-1],
        }
        for each in found
    ]


def accelerator() -> str:
    """Return the name of the CUDA device that PPO and Rainbow compute their gradient steps on, "" where there is none."""
    return torch.cuda.get_device_name() if torch.cuda.is_available() else ""


def processor(info: Path = Path("/proc/cpuinfo")) -> str:
    """Return the model of the processor, "" where the system does not say it."""
    with suppress(OSError):
        if found := re.search(r"^model name\s*: (.+)$", info.read_text(), re.M):
            return found[1].strip()
    named = platform.processor()
    return "" if named == platform.machine() else named


def hardware() -> str:
    """Return what a trial runs on, in words: the machine, its processor, and what works beside it."""
    beside = accelerator()
    parts = (platform.machine(), processor(), "one thread", beside and f"beside {beside}")
    return ", ".join(filter(None, parts))


def names_processor(logged: str | None) -> bool:
    """Return whether the hardware that was logged has the model of the processor, which earlier logs do not."""
    return ", " in (logged or "").partition(", one thread")[0]


def _curve_line(trainer: Trainer, cpu_s: float | None, numbers: dict[str, float]) -> dict[str, Any]:
    rounded = {
        name: round(value, 6) if np.isfinite(value) else None for name, value in numbers.items()
    }
    return {"kind": "curve", "moves": trainer.moves, "cpu_s": cpu_s, **rounded}


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
