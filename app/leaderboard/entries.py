"""The entries of the leaderboard: one for each configuration that people play, and one for each closed study."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from app.leaderboard.closed_studies import ClosedStudies, ranked_seeds
from app.leaderboard.jobs import EvaluationJob
from app.statistics.human_level import VolunteerFigures
from app.storage.reader import Reader
from app.study.data import StudyData
from app.study.policy_files import PolicyFiles
from marsexplorer.config import LEVELS, EnvConfig
from marsexplorer.policies import PolicyNotFoundError

FIRST_SEED = 1_000_000_000
"""Policies play the terrains of this seed and the next ones: training refuses them."""

OFFERED = (
    *(EnvConfig.of(level, 21) for level in LEVELS),
    EnvConfig.of("random", 42),
    EnvConfig.of("random", 84),
)
"""The configurations that the page's terrain dialog offers: each has an entry, even if nobody has played it."""


@dataclass(frozen=True)
class LeaderboardEntry:
    """A configuration and the terrains on which policies are compared with people.

    id        in the page's address
    human     the figure of `app.statistics.human_level`, or of a study with its pictures; None while nobody has played
    seeds     of the policies' terrains
    study     its name; None for an entry of the playground
    policies  names (or paths); None means everything on offer
    files     of a study's policies
    """

    id: str
    title: str
    config: EnvConfig
    human: dict[str, Any] | None
    seeds: tuple[int, ...]
    study: str | None = None
    policies: tuple[str, ...] | None = None
    files: PolicyFiles | None = None

    def jobs(self, sources: dict[str, str]) -> dict[str, EvaluationJob]:
        """Return what has to be evaluated by the policy's name, quick policies first.

        sources  what `policies.load` takes, by name. A study's policies are played from their own files; where one is lost,
                 the job names the place where it was kept, and fails
        """
        slow = ("random", "planner")  # by hundreds of moves, by milliseconds a move
        chosen = list(sources) if self.policies is None else self.policies
        ordered = sorted(chosen, key=lambda name: slow.index(name) + 1 if name in slow else 0)
        return {
            name: EvaluationJob(self._source(name, sources), self.config, self.seeds)
            for name in ordered
        }

    def _source(self, name: str, sources: dict[str, str]) -> str:
        if self.files is None or name not in self.files.hashes:
            return sources.get(name, name)
        try:
            return self.files.source(name)
        except PolicyNotFoundError:
            return str(self.files.place(name))

    def to_dict(self) -> dict[str, Any]:
        """Return the entry as the list of the leaderboard shows it."""
        human = self.human or {"players": 0, "episodes": 0}
        return {
            "id": self.id,
            "title": self.title,
            "study": self.study,
            "level": self.config.level,
            "rows": self.config.rows,
            "cols": self.config.cols,
            "max_steps": self.config.limit,
            "config_hash": self.config.hash,
            "terrains": len(self.seeds),
            "players": human["players"],
            "episodes": human["episodes"],
        }


def list_entries(
    reader: Reader, studies: ClosedStudies, volunteers: VolunteerFigures
) -> list[LeaderboardEntry]:
    """Return every entry: closed studies, then what people have played, the most played first, then the rest."""
    found = {
        f"study-{data.protocol.name}": _of_study(data, human)
        for data, human in studies.closed(reader)
    }
    for figure in volunteers.human_level(reader)["figures"]:
        config = EnvConfig(**figure["config"])
        found[config.hash] = _of_config(config, figure)
    for config in OFFERED:
        found.setdefault(config.hash, offered_entry(config))
    return list(found.values())


def offered_entry(config: EnvConfig) -> LeaderboardEntry:
    """Return the entry of a configuration on offer as it is while nobody has played it."""
    return _of_config(config, None)


def held_out_seeds(config: EnvConfig) -> tuple[int, ...]:
    """Return the seeds of the policies' terrains: 100, fewer on large grids, where an episode takes a planner a minute."""
    count = 100 if config.n <= 900 else 40 if config.n <= 2500 else 10
    return tuple(range(FIRST_SEED, FIRST_SEED + count))


def _of_study(data: StudyData, human: dict[str, Any] | None) -> LeaderboardEntry:
    protocol = data.protocol
    names = (f"study-{protocol.name}", protocol.title, protocol.env_config)
    return LeaderboardEntry(
        *names, human, ranked_seeds(data), protocol.name, protocol.policies, data.policy_files
    )


def _of_config(config: EnvConfig, human: dict[str, Any] | None) -> LeaderboardEntry:
    name = f"{config.level}-{config.rows}x{config.cols}"
    title = f"{config.level} {config.rows} × {config.cols}"
    if EnvConfig.of(config.level, (config.rows, config.cols)) != config:
        name, title = f"{name}-{config.hash[:8]}", f"{title} (settings {config.hash[:8]})"
    return LeaderboardEntry(name, title, config, human, held_out_seeds(config))
