"""Episodes of one policy on one level and size, as a job, for figures 6 and 7.

Every policy plays the terrains of the same seeds. The job's folder has result.jsonl with one line:
what was played, how it ended, and the figure's measures; see `quadrants` and `scale`. In `data/`,
`ppo-earlier` is the earlier `ppo`, without prices, which is no longer shipped. `ppo-paper-21-s2`
there are seed 2's policies by the letter, each of the level that it plays; that of 1-1-2 is of a
second training with the same settings and seed, since the first, which figure 5 has, was not kept.

How hard a level's terrains are is measured without training: the moves of an informed search, which
is shown the map, tell how much there is to do, and those of the better rule how much it costs to
find that out on the way.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import ClassVar

from marsexplorer import policies as policy_files
from marsexplorer.config import CORE_VERSION, LEVELS, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation import RULES, Result
from marsexplorer.evaluation.episodes import play_episode, result_of
from marsexplorer.random_numbers import mix
from research.informed.informed import INFORMED, informed_actions
from research.paper.jobs import Job, Line, OnProgress, read_lines, write_lines
from research.paper.tables import Estimate

FIRST_SEED = 1_000_000_000
"""Of the terrains: training refuses these (`marsexplorer.training.envs.EVALUATION_SEEDS`)."""

EPISODES = 100
"""Terrains of each level and size, as in the paper."""

LARGEST_INFORMED = 42
"""Side up to which the informed search is asked: at 84 its budget finds no walk that reaches 99
%.
"""

INFORMED_TRIES = 4
"""Searches with other random numbers, until one finds a walk."""

DIFFICULTIES = tuple(level for level in LEVELS if level != "random")
"""The paper's 12 levels, d_t-d_m-d_b (section 3.3)."""
TERRAINS = {level[:3]: level for level in DIFFICULTIES if level.endswith("-1")}
"""d_t-d_m -> a level with such terrains; d_b changes the rewards alone."""
DIFFICULTY_EPISODES = {"small": 20, "full": 100, "authors": 100}
"""Budget -> terrains of each level."""


@dataclass(frozen=True)
class Play:
    """The episodes of one policy as a job; a figure's own job adds its measures.

    policy      its name or path, or INFORMED
    level       a name in LEVELS
    size        side of the square grid, cells
    episodes    how many, on the terrains of first_seed, first_seed + 1, ...
    label       the policy's name in results; empty takes its name, or the file's without its ending
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
        """The policy's name in results."""
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
    def identity(self) -> Line:
        """The played episodes, JSON-ready; results of another identity are another job's."""
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
        """The figure's measures of the episodes, JSON-ready."""
        raise NotImplementedError

    def is_done(self, folder: Path) -> bool:
        """Whether the result of these episodes is under `folder / name`."""
        lines = read_lines(folder / self.name / "result.jsonl")
        return len(lines) == 1 and self.identity.items() <= lines[0].items()

    def run(self, folder: Path, on_progress: OnProgress) -> None:
        play, results, begun = self._player(), [], time.process_time()
        for number in range(self.episodes):
            seed = self.first_seed + number
            if (episode := play(seed)) is not None:
                results.append(result_of(self.called, episode, seed, traces=True))
            on_progress((number + 1) / self.episodes)
        seconds = {"cpu_s": round(time.process_time() - begun, 2)}
        line = {**self.identity, **seconds, **endings(results), **self.measure(results)}
        write_lines(folder / self.name / "result.jsonl", [line])

    def _player(self) -> Callable[[int], Episode | None]:
        """A function that plays the episode of a seed; None if the search finds no walk."""
        config = self.config
        if self.policy == INFORMED:
            return partial(informed_episode, config)
        policy = policy_files.load(self.policy, config.sensor_radius)
        return lambda seed: play_episode(policy, config, seed)


def informed_episode(config: EnvConfig, seed: int) -> Episode | None:
    """The shortest walk of the informed search on a seed's terrain, or None."""
    episode = Episode.begin(config, seed=seed)
    for number in range(INFORMED_TRIES):
        searched = mix(seed ^ mix(number)) if number else seed
        try:
            actions = informed_actions(config, episode.terrain, searched)
        except ValueError:  # no walk was found: the search ended some cells short of 99 %
            continue
        for action in actions:
            episode.step(int(action))
        return episode
    return None


def can_play(policy: str, config: EnvConfig) -> bool:
    """Whether a policy can play a configuration.

    Some networks take one size, and the informed search small grids. PolicyNotFoundError and
    PolicyFileError if there is no such policy.
    """
    if policy == INFORMED:
        return max(config.rows, config.cols) <= LARGEST_INFORMED
    return size_of(policy) in (None, (config.rows, config.cols))


@lru_cache(maxsize=64)
def size_of(policy: str) -> tuple[int, int] | None:
    """(rows, cols) of the only size that a policy plays, None for any."""
    size = getattr(policy_files.load(policy), "size", None)
    return None if size is None else (int(size[0]), int(size[1]))


def endings(results: Sequence[Result]) -> Line:
    """How episodes ended: `played`, `outcomes` by name, mean `steps` and `coverage`."""
    count = max(1, len(results))
    return {
        "played": len(results),
        "outcomes": dict(sorted(Counter(result.outcome for result in results).items())),
        "steps": round(sum(result.steps for result in results) / count, 2),
        "coverage": round(sum(result.coverage for result in results) / count, 5),
    }


@dataclass(frozen=True)
class Difficulty(Play):
    """The episodes of a rule or of the informed search on one level, beside figure 5."""

    figure: ClassVar[int] = 5
    kind: ClassVar[str] = "difficulty"

    def measure(self, results: Sequence[Result]) -> Line:
        """The moves to 99 %, JSON-ready."""
        return {"steps_to_99": asdict(Estimate.of([result.steps_to_99 for result in results]))}


def with_own_names(plays: Sequence[Play]) -> Sequence[Play]:
    """The plays themselves; ValueError if two have the same name."""
    if len({play.name for play in plays}) < len(plays):
        policies = ", ".join(dict.fromkeys(play.policy for play in plays))
        raise ValueError(f"each policy needs a name of its own, got {policies}")
    return plays


def difficulty_jobs(budget: str, size: int) -> list[Job]:
    """The jobs that measure the six kinds of terrain."""
    return [
        Difficulty(policy, level, size, DIFFICULTY_EPISODES[budget])
        for level in TERRAINS.values()
        for policy in (INFORMED, *RULES)
    ]


def read_results(folder: Path, figure: int) -> list[Line]:
    """The results of a figure in a folder, in order of name.

    They are of jobs (NAME/result.jsonl) or gathered (NAME.jsonl). If a folder has both of the same
    policy, level and size, the job's counts. FileNotFoundError if there is none.
    """
    gathered = sorted(folder.glob(f"figure{figure}-*.jsonl"))
    files = [*gathered, *sorted(folder.glob(f"figure{figure}-*/result.jsonl"))]
    lines = {_place_of(line): line for path in files for line in read_lines(path)}
    if not lines:
        raise FileNotFoundError(
            f"no results of figure {figure} in {folder}: expected folders figure{figure}-*/ with a result.jsonl; "
            f"run `python -m research.paper --figure {figure}` first"
        )
    return list(lines.values())


def _place_of(line: Line) -> tuple[object, ...]:
    """The key of a result: the policy or the walks, the level and the size."""
    return line.get("policy"), line.get("null"), line.get("level"), line["rows"]


def gather(folder: Path, figure: int, target: Path) -> list[Path]:
    """Write the results of a figure into a file a policy; return the paths.

    The files are figureN-POLICY.jsonl; the null walks have one too.
    """
    groups: dict[str, list[Line]] = {}
    for line in read_results(folder, figure):
        groups.setdefault(line.get("policy", "null"), []).append(line)
    return [
        write_lines(target / f"figure{figure}-{name}.jsonl", lines)
        for name, lines in groups.items()
    ]
