"""Policies on a study's ranked terrains, episode for episode what people meet there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from app.statistics.summaries import coverage_curve, summary_of, visit_counts
from app.study.policy_episodes import PolicyEpisode
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.intervals import Floats


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


def runs_of(
    episodes: Sequence[PolicyEpisode], config: EnvConfig, terrains: int, names: Sequence[str] = ()
) -> tuple[PolicyRun, ...]:
    """Return one run per policy from its episodes, which are replayed; `names` without an episode are empty runs."""
    found: dict[str, dict[int, PolicyEpisode]] = {name: {} for name in names}
    for each in episodes:
        found.setdefault(each.policy, {})[each.terrain] = each
    return tuple(_run(name, config, by_terrain, terrains) for name, by_terrain in found.items())


def _run(
    name: str, config: EnvConfig, episodes: Mapping[int, PolicyEpisode], terrains: int
) -> PolicyRun:
    score, steps = np.full(terrains, np.nan), np.full(terrains, np.nan)
    summaries = {index: summary_of(each.replay(config)) for index, each in sorted(episodes.items())}
    for index, summary in summaries.items():
        score[index], steps[index] = summary.score, summary.steps
    outcomes = tuple(
        summaries[index].outcome if index in summaries else "" for index in range(terrains)
    )
    groups = [[summary] for summary in summaries.values()]
    pictures = (
        {"curve": coverage_curve(config, groups), "visits": visit_counts(config, groups)}
        if groups
        else {}
    )
    return PolicyRun(name, score, steps, outcomes, pictures)
