"""Coverage against steps, visits and trials of people's counted episodes, by replay of what is stored."""

from __future__ import annotations

import json
from typing import Any

from app.statistics.summaries import EpisodeSummary, coverage_curve, summary_of, trial_summaries, visit_counts
from app.storage.reader import Reader, record_of
from marsexplorer.config import EnvConfig
from marsexplorer.episode import replay

MAX_EPISODES = 3000
"""Episodes behind the pictures of a board: the newest so many."""


class HumanSummaries:
    """Curves and visit maps for each configuration, kept until somebody finishes another episode."""

    def __init__(self) -> None:
        self._made: dict[str, tuple[str, dict[str, Any]]] = {}

    def pictures(self, reader: Reader, config: EnvConfig, human: dict[str, Any]) -> dict[str, Any]:
        """Return {"curve", "visits", "trials"} of the people behind a figure of `human_level`; seconds, so in a thread."""
        state = json.dumps(human)
        if self._made.get(config.hash, ("",))[0] != state:
            self._made[config.hash] = (state, _pictures(reader, config))
        return self._made[config.hash][1]


def _pictures(reader: Reader, config: EnvConfig) -> dict[str, Any]:
    rows = [row for row in reader.finished("human") if row["config_hash"] == config.hash]
    people: dict[str, list[EpisodeSummary]] = {}
    for row in rows[-MAX_EPISODES:]:
        try:
            episode = replay(record_of(row, reader.steps(row["id"])))
        except ValueError:  # of another core version: its totals count, its path cannot be drawn
            continue
        people.setdefault(row["owner_id"], []).append(summary_of(episode))
    groups = list(people.values())
    if not groups:
        return {"curve": None, "visits": None, "trials": []}
    return {"curve": coverage_curve(config, groups), "visits": visit_counts(config, groups), "trials": trial_summaries(groups)}
