"""Policies on a study's ranked terrains, episode for episode what people meet there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from app.statistics.summaries import EpisodeSummary, coverage_curve, visit_counts
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import Result, make_chunks, play_chunks
from marsexplorer.evaluation.intervals import Floats
from marsexplorer.evaluation.run import Progress


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


def run_policies(
    names: Sequence[str], config: EnvConfig, seeds: Mapping[int, int], terrains: int, progress: Progress | None = None
) -> tuple[PolicyRun, ...]:
    """Return one run per policy (a name or path), each on every terrain whose seed is known.

    seeds     by terrain index; progress is called with (episodes played, episodes in all)
    """
    chosen = list(dict.fromkeys(names))
    for name in chosen:
        policies.load(name, config.sensor_radius)  # what cannot be played is refused before anything is
    index_of = {seed: index for index, seed in seeds.items()}
    found: dict[str, dict[int, Result]] = {name: {} for name in chosen}
    done = 0
    for part in play_chunks(make_chunks(chosen, [config], list(seeds.values()), traces=True), None):
        for result in part:
            found[result.policy][index_of[result.seed]] = result
        done += len(part)
        if progress:
            progress(done, len(chosen) * len(seeds))
    return tuple(_run(name, config, found[name], terrains) for name in chosen)


def _run(name: str, config: EnvConfig, results: Mapping[int, Result], terrains: int) -> PolicyRun:
    score, steps = np.full(terrains, np.nan), np.full(terrains, np.nan)
    for index, result in results.items():
        score[index], steps[index] = result.score, result.steps_to_99
    outcomes = tuple(results[index].outcome if index in results else "" for index in range(terrains))
    groups = [[_summary(result, config)] for _, result in sorted(results.items())]
    pictures = {"curve": coverage_curve(config, groups), "visits": visit_counts(config, groups)} if groups else {}
    return PolicyRun(name, score, steps, outcomes, pictures)


def _summary(result: Result, config: EnvConfig) -> EpisodeSummary:
    assert result.trace is not None
    path = [divmod(cell, config.cols) for cell in result.trace.path]
    return EpisodeSummary(result.outcome, result.score, result.steps_to_99, result.trace.discovered, path)
