"""Policies on a study's ranked terrains, episode for episode what people meet there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from app.leaderboard.tally import Played, curve, visits
from app.leaderboard.worker import played
from app.report.intervals import Floats
from marsexplorer import policies
from marsexplorer.config import EnvConfig

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class PolicyRun:
    """A policy's episodes by terrain index; NaN (and the outcome "") where the terrain's seed is not known."""

    name: str
    score: Floats
    steps: Floats
    outcomes: tuple[str, ...]
    pictures: dict[str, Any] = field(default_factory=dict, repr=False)

    def values(self, metric: Literal["score", "steps"]) -> Floats:
        """Return float64[terrains] of a metric."""
        return self.score if metric == "score" else self.steps


def play(
    names: Sequence[str], config: EnvConfig, seeds: Mapping[int, int], terrains: int, progress: Progress | None = None
) -> tuple[PolicyRun, ...]:
    """Return one run per policy (a name or path), each on every terrain whose seed is known.

    seeds     by terrain index; progress is called with (episodes played, episodes in all)
    """
    loaded = [(name, policies.load(name, config.sensor_radius)) for name in dict.fromkeys(names)]
    done, runs = 0, []
    for name, policy in loaded:
        episodes: dict[int, Played] = {}
        for index, seed in sorted(seeds.items()):
            episodes[index] = played(policy, config, seed)
            done += 1
            if progress:
                progress(done, len(loaded) * len(seeds))
        runs.append(_run(name, config, episodes, terrains))
    return tuple(runs)


def _run(name: str, config: EnvConfig, episodes: Mapping[int, Played], terrains: int) -> PolicyRun:
    score, steps = np.full(terrains, np.nan), np.full(terrains, np.nan)
    for index, episode in episodes.items():
        score[index], steps[index] = episode.score, episode.steps
    outcomes = tuple(episodes[index].outcome if index in episodes else "" for index in range(terrains))
    groups = [[episode] for episode in episodes.values()]
    pictures = {"curve": curve(config, groups), "visits": visits(config, groups)} if groups else {}
    return PolicyRun(name, score, steps, outcomes, pictures)
