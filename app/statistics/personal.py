"""One player's own episodes: the list, the best of each configuration, and where they stand among the volunteers."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from app.storage.reader import Reader, cells_of, config_of
from marsexplorer.config import EnvConfig
from marsexplorer.score import steps_to_target

Row = dict[str, Any]


def describe_own(row: Row) -> dict[str, Any]:
    """Return an episode of a player's own list; `kind` is "daily", "ranked" or "practice"."""
    config = config_of(row)
    return {
        "episode": row["id"],
        "kind": _kind(row),
        "day": row["daily"],
        "level": config.level,
        "rows": config.rows,
        "cols": config.cols,
        "outcome": row["outcome"],
        "moves": row["steps"],
        "coverage": row["discovered"] / cells_of(row),
        "score": row["score"],
        "ended_ms": row["ended_ms"],
        "not_attested": row["attestation_reason"],
    }


def personal_bests(reader: Reader, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return a figure for each configuration among a player's episodes, the most played first.

    `best` is the explored episode with the fewest moves on a terrain that was new to the player, by their own hand; None
    without one. `people` places their ranked episodes among the volunteers'.
    """
    by_config: dict[str, list[Row]] = {}
    for row in rows:
        by_config.setdefault(row["config"], []).append(row)
    volunteers = reader.totals("human")
    found = [_figure(config, own, volunteers) for config, own in by_config.items()]
    return sorted(found, key=lambda figure: -figure["episodes"])


def _figure(config_json: str, own: Sequence[Row], volunteers: Sequence[Row]) -> dict[str, Any]:
    config = EnvConfig(**json.loads(config_json))
    fresh = [
        row
        for row in own
        if row["driver"] == "human" and not row["seed_chosen"] and not row["terrain_met_before"]
    ]
    explored = [row for row in fresh if row["outcome"] == "explored"]
    best = min(explored, key=lambda row: (row["steps"], row["ended_ms"]), default=None)
    return {
        "level": config.level,
        "rows": config.rows,
        "cols": config.cols,
        "max_steps": config.limit,
        "episodes": len(own),
        "explored": sum(row["outcome"] == "explored" for row in own),
        "best": None if best is None else describe_own(best),
        "people": _standing(config, config_json, own, volunteers),
    }


def _standing(
    config: EnvConfig, config_json: str, own: Sequence[Row], volunteers: Sequence[Row]
) -> dict[str, Any]:
    """Return each volunteer's mean moves to 99 %, sorted and without names, and the player's own: None without ranked ones."""
    steps: dict[str, list[int]] = {}
    for row in volunteers:
        if row["config"] == config_json:
            steps.setdefault(row["owner_id"], []).append(
                steps_to_target(config, row["outcome"], row["steps"])
            )
    ranked = [steps_to_target(config, row["outcome"], row["steps"]) for row in own if row["counts"]]
    return {
        "means": sorted(round(_mean(each), 1) for each in steps.values()),
        "you": round(_mean(ranked), 1) if ranked else None,
        "ranked": len(ranked),
    }


def _mean(values: Sequence[int]) -> float:
    return math.fsum(values) / len(values)


def _kind(row: Row) -> str:
    return "daily" if row["daily"] else "ranked" if row["counts"] else "practice"
