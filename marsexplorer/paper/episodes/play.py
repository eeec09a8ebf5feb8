"""Episodes of one policy on one level and size, as a job: what figures 6 and 7 are measured on.

Every policy plays the terrains of the same seeds. The folder of the job has

    episodes.jsonl  what has been played so far: first what is played, then an episode a line, its seed and its moves
    result.jsonl    one line: what was played, how it ended, and what the figure measures; see `visits` and `scale`

The moves are the cause of an episode, so the measures are worked out from them by replay, also those of an interrupted job.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, ClassVar

from marsexplorer import policies as policy_files
from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation import INFORMED, Result
from marsexplorer.evaluation.episodes import play_episode, result_of
from marsexplorer.evaluation.informed import informed_actions
from marsexplorer.files import write_whole
from marsexplorer.paper.job import OnProgress
from marsexplorer.random_numbers import mix

FIRST_SEED = 1_000_000_000
"""Of the terrains: training refuses these (`marsexplorer.training.envs.EVALUATION_SEEDS`)."""

EPISODES = 100
"""Terrains of each level and size, as in the paper."""

SAVE_EVERY_S = 5.0
"""Seconds after which what has been played is written."""

LARGEST_INFORMED = 42
"""Side up to which the informed search is asked: at 84 its budget finds no walk that reaches 99 %."""

INFORMED_TRIES = 4
"""Searches with other random numbers, until one finds a walk."""

START_S = 3.0
"""CPU seconds of a job before its first episode: libraries are imported, and the policy is loaded."""

SECONDS = {
    "frontier-cost": (0.0012, 1.77),
    "frontier-utility": (0.0035, 2.0),
    "ppo": (0.038, 1.07),
    "planner": (0.16, 1.5),
    INFORMED: (0.4, 1.2),
}
"""Policy -> CPU seconds of an episode at 21 x 21, and the power of the number of cells that they grow with."""

OTHER_SECONDS = (0.06, 1.1)
"""The same for policies that are not in `SECONDS`."""

Line = dict[str, Any]
"""A JSON object of a file."""


@dataclass(frozen=True)
class Play:
    """The episodes of one policy as a job; a figure's own job adds what it measures.

    policy      its name or path, or INFORMED
    level       a name in LEVELS
    size        side of the square grid, cells
    episodes    how many, on the terrains of first_seed, first_seed + 1, ...
    label       what the policy is called in results; empty takes the name, or the file's without its ending
    """

    policy: str
    level: str
    size: int = 21
    episodes: int = EPISODES
    first_seed: int = FIRST_SEED
    label: str = ""

    figure: ClassVar[int] = 0
    kind: ClassVar[str] = ""

    @property
    def called(self) -> str:
        """What the policy is called in results."""
        return self.label or Path(self.policy).stem

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"figure{self.figure}-{self.called}-{self.level}-{self.size}"

    @property
    def config(self) -> EnvConfig:
        """The environment."""
        return EnvConfig.of(self.level, self.size)

    @property
    def forecast(self) -> float:
        """CPU seconds, about."""
        seconds, power = SECONDS.get(self.policy, OTHER_SECONDS)
        return START_S + self.episodes * seconds * float((self.config.n / 441) ** power)

    @property
    def identity(self) -> Line:
        """What is played, JSON-ready; results of another identity are not of this job."""
        digest = None if self.policy == INFORMED else policy_files.policy_hash(self.policy)
        return {
            "kind": self.kind,
            "figure": self.figure,
            "policy": self.called,
            "policy_sha256": digest,
            "core_version": CORE_VERSION,
            "level": self.level,
            "rows": self.size,
            "cols": self.size,
            "episodes": self.episodes,
            "first_seed": self.first_seed,
        }

    def measure(self, results: Sequence[Result]) -> Line:
        """Return what the figure measures on the episodes, JSON-ready."""
        raise NotImplementedError

    def is_done(self, folder: Path) -> bool:
        """Return whether the result of these episodes lies under `folder / name`."""
        lines = read_lines(folder / self.name / "result.jsonl")
        return len(lines) == 1 and self.identity.items() <= lines[0].items()

    def run(self, folder: Path, on_progress: OnProgress) -> None:
        """Play what has not been played yet, and measure."""
        own, identity = folder / self.name, self.identity
        own.mkdir(parents=True, exist_ok=True)
        head, *played = read_lines(own / "episodes.jsonl") or [identity]
        if (
            not identity.items() <= head.items()
        ):  # of another file of the policy, or of other terrains
            head, played = identity, []
        before, begun, saved = head.get("cpu_s", 0.0), time.process_time(), time.monotonic()

        def save() -> None:
            seconds = round(before + time.process_time() - begun, 2)
            write_lines(own / "episodes.jsonl", [{**identity, "cpu_s": seconds}, *played])

        play = self._player()
        for seed in range(self.first_seed + len(played), self.first_seed + self.episodes):
            played.append({"seed": seed, "actions": play(seed)})
            if time.monotonic() - saved > SAVE_EVERY_S:
                save()
                saved = time.monotonic()
            on_progress(len(played) / self.episodes)
        save()
        results = [self._replay(line) for line in played if line["actions"] is not None]
        cpu_s = read_lines(own / "episodes.jsonl")[0]["cpu_s"]
        write_lines(
            own / "result.jsonl",
            [{**identity, "cpu_s": cpu_s, **endings(results), **self.measure(results)}],
        )

    def _player(self) -> Callable[[int], str | None]:
        """Return what plays the episode of a seed and returns its moves, a digit each; None when the search finds no walk."""
        config = self.config
        if self.policy == INFORMED:
            return partial(informed_moves, config)
        policy = policy_files.load(self.policy, config.sensor_radius)
        return lambda seed: digits(play_episode(policy, config, seed).actions)

    def _replay(self, line: Line) -> Result:
        """Return the figures of an episode that has been played, with its trace."""
        episode = Episode.begin(self.config, seed=line["seed"])
        for digit in line["actions"]:
            episode.step(int(digit))
        return result_of(self.called, episode, line["seed"], traces=True)


def informed_moves(config: EnvConfig, seed: int) -> str | None:
    """Return the moves of the shortest walk found by the informed search on the terrain of a seed, None when it finds none."""
    terrain = Episode.begin(config, seed=seed).terrain
    for number in range(INFORMED_TRIES):
        try:
            actions = informed_actions(config, terrain, mix(seed ^ mix(number)) if number else seed)
        except ValueError:  # no walk was found: the search ended some cells short of 99 %
            continue
        return digits(actions)
    return None


def digits(actions: Iterable[int]) -> str:
    """Return actions as text, a digit each."""
    return "".join(map(str, actions))


def can_play(policy: str, config: EnvConfig) -> bool:
    """Return whether a policy can play a configuration: some networks take one size, and the informed search small grids.

    PolicyNotFoundError and PolicyFileError when there is no such policy.
    """
    if policy == INFORMED:
        return max(config.rows, config.cols) <= LARGEST_INFORMED
    return size_of(policy) in (None, (config.rows, config.cols))


@lru_cache(maxsize=64)
def size_of(policy: str) -> tuple[int, int] | None:
    """Return (rows, cols) of the only size that a policy plays, None for any."""
    size = getattr(policy_files.load(policy), "size", None)
    return None if size is None else (int(size[0]), int(size[1]))


def endings(results: Sequence[Result]) -> Line:
    """Return how episodes ended, JSON-ready: `played` of them, `outcomes` by name, and the mean `steps` and `coverage`."""
    count = max(1, len(results))
    return {
        "played": len(results),
        "outcomes": dict(sorted(Counter(result.outcome for result in results).items())),
        "steps": round(sum(result.steps for result in results) / count, 2),
        "coverage": round(sum(result.coverage for result in results) / count, 5),
    }


def read_lines(path: Path) -> list[Line]:
    """Return the objects of a file of JSON Lines, none where there is no file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []


def write_lines(path: Path, lines: Sequence[Line]) -> None:
    """Write a file of JSON Lines whole, without spaces."""
    with write_whole(path) as file:
        file.write(
            "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines).encode()
        )
