"""The trainings of the design, as jobs: which there are, and how each goes."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import torch

from marsexplorer.compat.env import KoutrasCodeVector
from marsexplorer.config import EnvConfig
from marsexplorer.files import replace_whole
from marsexplorer.training.envs import MixedEnvs, TrainingEnvs, make_vector_env
from marsexplorer.training.ppo import RolloutBuffer, TrainingRun, make_update
from marsexplorer.vector import MarsExplorerVector
from research.difference.code_envs import CodeEnvs
from research.difference.held_out import episode_means, play_held_out
from research.paper.jobs import OnProgress, read_lines, write_lines
from research.paper.trainers.settings import APPENDIX_PASSES, PPOSettings, ppo_settings
from research.paper.trial import hardware

WORLDS = ESTIMATES = ("text", "code")
LEAVING = ("free", "costs")
SEEDS = (0, 1, 2)
MOVES, MOVES_OF_RANDOM = 800_000, 9_000_000
LINES = 100
"""Of the curve of a training."""
CHECKPOINT_INTERVAL_S = 120.0
CODE_ESTIMATES = {"gamma": 0.9, "gae_lambda": 1.0}
"""The discount and lambda of the authors' configuration."""
CODE_ENDS = {"bonus_reward": 400, "collision_reward": -400, "out_of_bounds_reward": -400}
"""Of the authors' defaults."""


@dataclass(frozen=True)
class Training:
    """One training.

    world, estimates  "text" or "code"
    leaving           "free" or "costs"
    passes            "light" or "full"
    level             "videos", or "random" in the code's world
    """

    world: str
    estimates: str
    leaving: str
    seed: int
    passes: str = "light"
    level: str = "videos"
    moves: int = MOVES

    @property
    def name(self) -> str:
        """Name of its folder."""
        kind = f"{self.world}-{self.estimates}-{self.leaving}-{self.passes}-{self.level}"
        return f"{kind}-s{self.seed}"

    @property
    def settings(self) -> PPOSettings:
        """PPO by the letter with what this one has of the code."""
        changes: dict[str, Any] = dict(CODE_ESTIMATES) if self.estimates == "code" else {}
        if self.passes == "full":
            changes |= APPENDIX_PASSES
        return replace(ppo_settings("paper"), **changes)

    @property
    def config(self) -> EnvConfig:
        """The text's level, which has the size and the network of the code's too."""
        return EnvConfig.of("3-1-2" if self.leaving == "free" else "3-1-1")

    def is_done(self, folder: Path) -> bool:
        """Return whether its log ends with a result."""
        lines = read_lines(folder / self.name / "log.jsonl")
        return (
            bool(lines) and lines[-1]["kind"] == "result" and lines[0]["training"] == asdict(self)
        )

    def code_batch(self, num_envs: int) -> KoutrasCodeVector:
        """Return environments of the code's world."""
        ends = CODE_ENDS if self.leaving == "costs" else {}
        preset = "videos" if self.level == "videos" else "explorer"
        return KoutrasCodeVector(num_envs, preset, ends, "uint8")

    def batch(self, num_envs: int) -> MarsExplorerVector | KoutrasCodeVector:
        """Return environments of its world."""
        if self.world == "code":
            return self.code_batch(num_envs)
        return make_vector_env(self.config, num_envs)

    def begin(self) -> TrainingRun:
        """The run at its beginning, with gradient steps on a CUDA device if there is one."""
        device = "cuda" if torch.cuda.is_available() else "cpu"
        settings = self.settings
        run = TrainingRun.begin(settings, [self.config], self.moves, self.seed, device)
        if self.world == "code":
            envs: Any = CodeEnvs(self.code_batch(settings.num_envs), self.seed)
            run.envs = MixedEnvs([envs])
        return run

    def run(self, folder: Path, on_progress: OnProgress) -> None:
        """Train, from a checkpoint if there is one, play held-out terrains, write the log."""
        torch.set_num_threads(1)
        torch.set_flush_denormal(True)
        home = folder / self.name
        home.mkdir(parents=True, exist_ok=True)
        checkpoint = home / "checkpoint.pt"
        run, lines, machines = self.begin(), list[dict[str, Any]](), [hardware()]
        if checkpoint.is_file():
            stored = torch.load(checkpoint, "cpu", weights_only=True)
            run.load_state_dict(stored["run"])
            lines, machines = stored["lines"], [*dict.fromkeys([*stored["machines"], *machines])]
        buffer = RolloutBuffer.empty(run.config, run.envs.observe())

        def head() -> dict[str, Any]:
            return {"kind": "training", "training": asdict(self), "machines": machines}

        def save() -> None:
            state = {"run": run.state_dict(), "lines": lines, "machines": machines}
            with replace_whole(checkpoint) as path:
                torch.save(state, path)
            write_lines(home / "log.jsonl", [head(), *lines])

        saved = time.monotonic()
        interval = self.moves // LINES
        (envs,) = run.envs.parts
        while run.updates_done < run.num_updates:
            before = run.global_step
            numbers = make_update(run, buffer)
            if before // interval < run.global_step // interval:
                lines.append(curve_line(run.global_step, envs, numbers))
            try:
                on_progress(0.98 * run.updates_done / run.num_updates)
            except KeyboardInterrupt:
                save()
                raise
            if time.monotonic() - saved > CHECKPOINT_INTERVAL_S:
                save()
                saved = time.monotonic()
        result = play_held_out(self.batch, run.player, self.seed)
        last = {"kind": "result", "moves": run.global_step, **result}
        write_lines(home / "log.jsonl", [head(), *lines, last])
        checkpoint.unlink(missing_ok=True)


def curve_line(moves: int, envs: TrainingEnvs, numbers: dict[str, float]) -> dict[str, Any]:
    """A line of the curve: means over the last episodes, and the update's numbers."""
    rounded = {name: round(number, 4) for name, number in numbers.items()}
    return {"kind": "curve", "moves": moves, **episode_means(envs.recent), **rounded}


def combinations() -> list[Training]:
    """Return the 24 trainings of the three factors, by seed first."""
    kinds = product(SEEDS, WORLDS, ESTIMATES, LEAVING)
    return [Training(world, estimates, leaving, seed) for seed, world, estimates, leaving in kinds]


def full_passes() -> list[Training]:
    """Return the trainings with as many gradient steps as the authors'."""
    return [Training("code", "code", "free", seed, passes="full") for seed in SEEDS]


def random_level() -> list[Training]:
    """Return the trainings on the level of figure 4, as long as the authors'."""
    return [
        Training("code", "code", "costs", seed, level="random", moves=MOVES_OF_RANDOM)
        for seed in SEEDS
    ]


PARTS = {"combinations": combinations, "full": full_passes, "random": random_level}
