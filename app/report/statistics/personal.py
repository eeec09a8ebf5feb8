"""One player's own episodes: the list, the best of each configuration, and where they stand among the volunteers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from app.db.reader import Reader
from app.db.trial import Trial
from app.db.volunteers import players_of
from app.task import Configuration


def describe_own(trial: Trial) -> dict[str, Any]:
    """Return an episode of a player's own list; `kind` is "daily", "ranked" or "practice"."""
    config = trial.config
    return {
        "episode": trial.id,
        "kind": "daily" if trial.day else "ranked" if trial.counts else "practice",
        "day": trial.day,
        "level": config.level,
        "rows": getattr(config, "rows", None),
        "cols": getattr(config, "cols", None),
        "outcome": trial.outcome,
        "moves": trial.steps,
        "coverage": trial.coverage,
        "score": trial.score,
        "ended_ms": trial.ended_ms,
        "not_attested": trial.attestation_reason,
    }


def personal_bests(reader: Reader, trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Return a figure for each configuration among a player's episodes, the most played first.

    `best` is the explored episode with the fewest moves on a terrain that was new to the player, by their own hand; None
    without one. `people` places their ranked episodes among the volunteers'.
    """
    by_config: dict[Configuration, list[Trial]] = {}
    for trial in trials:
        by_config.setdefault(trial.config, []).append(trial)
    found = [_figure(reader, config, own) for config, own in by_config.items()]
    return sorted(found, key=lambda figure: -figure["episodes"])


def _figure(reader: Reader, config: Configuration, own: Sequence[Trial]) -> dict[str, Any]:
    explored = [trial for trial in own if trial.outcome == "explored"]
    fresh = [
        trial
        for trial in explored
        if trial.driver == "human" and not trial.seed_chosen and not trial.terrain_met_before
    ]
    best = min(fresh, key=lambda trial: (trial.steps or 0, trial.ended_ms or 0), default=None)
    return {
        "level": config.level,
        "rows": getattr(config, "rows", None),
        "cols": getattr(config, "cols", None),
        "max_steps": config.limit,
        "episodes": len(own),
        "explored": len(explored),
        "best": None if best is None else describe_own(best),
        "people": _standing(reader, config, own),
    }


def _standing(reader: Reader, config: Configuration, own: Sequence[Trial]) -> dict[str, Any]:
    """Return each volunteer's mean moves to 99 %, sorted and without names, and the player's own: None without ranked ones."""
    volunteers = players_of(reader, config.hash)
    ranked = [trial.steps_to_target or 0 for trial in own if trial.counts]
    return {
        "means": sorted(round(each.steps / each.episodes, 1) for each in volunteers),
        "you": round(_mean(ranked), 1) if ranked else None,
        "ranked": len(ranked),
    }


def _mean(values: Sequence[int]) -> float:
    return math.fsum(values) / len(values)
