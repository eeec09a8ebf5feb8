"""The figure of the playground's volunteers: for each configuration, the mean of the players' means with its interval.

Volunteers chose to play, and how often: they are no sample of anybody, and their figure is not called the human level, which is
a closed study's alone. Every player weighs the same, however much they played, because one player's episodes resemble each
other. The interval is the one that reports print (`app.report.statistics.intervals`). Only counted episodes enter
(`app.db.reader.HUMAN_SCORE_CONDITION`); one that was abandoned is among them.
"""

from __future__ import annotations

import hashlib
import json
import math
import threading
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from app.db.reader import Reader
from app.report.statistics.exclusion_sets import MetricName
from app.report.statistics.formatting import counted
from app.report.statistics.headline import is_a_few_players
from app.report.statistics.intervals import Interval, estimate
from app.report.statistics.study_figures import metric_bounds
from app.task import Configuration, Rules, rules_of
from marsexplorer.evaluation.intervals import t_interval

NOBODY_PLAYED = "Volunteers on this playground: nobody has played a ranked episode yet."


_Played = tuple[str, str]
"""A task and one of its configurations, as JSON."""


class VolunteerFigures:
    """The volunteers' figures, each kept while the counted episodes of its configuration stay the same.

    Every reading reads the counted episodes, and makes a figure anew unless the hash of all that it is made from is the one
    before. So an episode that comes, goes or no longer counts is seen at once. Nobody's id is kept, and figures that nothing
    counts for any longer are dropped.
    """

    def __init__(self) -> None:
        self._made: dict[_Played, tuple[bytes, dict[str, Any]]] = {}
        self._making = threading.Lock()

    def human_level(self, store: Reader) -> dict[str, Any]:
        """Return what the function `human_level` returns; the figures are shared, so do not change them."""
        by_config: dict[_Played, list[dict[str, Any]]] = {}
        for row in store.totals("human"):
            by_config.setdefault((row["task"], row["config"]), []).append(row)
        with self._making:
            self._made = {
                config: self._made_from(config, rows) for config, rows in by_config.items()
            }
            figures = [figure for _, figure in self._made.values()]
        figures.sort(key=lambda figure: -figure["episodes"])
        return {"figures": figures, "sentence": " ".join(map(_sentence, figures)) or NOBODY_PLAYED}

    def _made_from(
        self, config: _Played, played: list[dict[str, Any]]
    ) -> tuple[bytes, dict[str, Any]]:
        """Return the hash of a configuration's counted episodes with their figure."""
        state = hashlib.sha256(repr([tuple(row.values()) for row in played]).encode()).digest()
        made = self._made.get(config)
        return made if made is not None and made[0] == state else (state, _figure(*config, played))


def human_level(store: Reader) -> dict[str, Any]:
    """Return the volunteers' `{"figures": [one per configuration], "sentence": the same in words}`; none for nobody."""
    return VolunteerFigures().human_level(store)


def mean_interval(values: Sequence[float]) -> dict[str, float | None]:
    """Return mean, low and high of the 95 % t interval for the mean; low and high None with fewer than two values."""
    mean = _mean(values)
    if len(values) < 2:
        return {"mean": mean, "low": None, "high": None}
    low, high = t_interval(np.array(values, np.float64))
    return {"mean": mean, "low": float(low), "high": float(high)}


def _figure(task: str, config_json: str, played: list[dict[str, Any]]) -> dict[str, Any]:
    rules = rules_of(task)
    config = rules.configuration(json.loads(config_json))
    values = config.to_dict()
    scores, steps, explored = (defaultdict[str, list[float]](list) for _ in range(3))
    for row in played:
        player, has_succeeded = row["owner_id"], row["outcome"] in rules.successes
        scores[player].append(row["score"])
        steps[player].append(row["steps"] if has_succeeded else config.limit)
        explored[player].append(has_succeeded)
    failed = np.array([own.count(False) for own in explored.values()], np.float64)
    counts = np.array([len(own) for own in explored.values()], np.float64)
    is_guaranteed = len(scores) > 1 and bool(is_a_few_players(failed, counts))
    return {
        "task": task,
        "level": config.level,
        "where": rules.where(config),
        **{side: values[side] for side in ("rows", "cols") if side in values},
        "config_hash": config.hash,
        "config": values,
        "population": "volunteers",
        "headline": "guaranteed" if is_guaranteed else "printed",
        "players": len(scores),
        "episodes": len(played),
        "abandoned": sum(row["outcome"] == "abandoned" for row in played),
        "spoilt": sum(row["attestation"] == "spoilt" for row in played),
        "as_played": _as_played(rules, config, played),
        "score": _interval_of(scores, metric_bounds(rules, config, "score"), is_guaranteed),
        "steps": _interval_of(steps, metric_bounds(rules, config, "steps"), is_guaranteed),
        "completed": _mean([_mean(own) for own in explored.values()]),
    }


def _as_played(
    rules: Rules, config: Configuration, played: list[dict[str, Any]]
) -> dict[str, float] | None:
    """Return the means with spoilt episodes as they were played; None where there are none."""
    if not any(row["attestation"] == "spoilt" for row in played):
        return None
    by_owner: dict[str, list[dict[str, Any]]] = {}
    for row in played:
        by_owner.setdefault(row["owner_id"], []).append(row)
    means = [
        (
            _mean([row["played_score"] for row in own]),
            _mean(
                [
                    row["steps"] if row["played_outcome"] in rules.successes else config.limit
                    for row in own
                ]
            ),
        )
        for own in by_owner.values()
    ]
    return {
        "score": _mean([each[0] for each in means]),
        "steps": _mean([each[1] for each in means]),
    }


def _interval_of(
    values: Mapping[str, list[float]], bounds: Interval, is_guaranteed: bool
) -> dict[str, float | None]:
    """Return mean, low and high over players as a report prints them; low and high None for one player."""
    means = np.array([_mean(own) for own in values.values()], np.float64)
    found = estimate(means, bounds, is_guaranteed)
    low, high = found.interval or (None, None)
    return {"mean": found.mean, "low": low, "high": high}


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def _sentence(figure: dict[str, Any]) -> str:
    """Return a figure in plain words."""
    who = f"{counted(figure['players'], 'player')}, {counted(figure['episodes'], 'episode')}"
    abandoned = f", {figure['abandoned']} of them abandoned" if figure["abandoned"] else ""
    if found := figure["as_played"]:
        abandoned += (
            f", among these {figure['spoilt']} spoilt, as played {found['steps']:.1f} steps"
        )
    where = figure["where"]
    score = f"mean score {figure['score']['mean']:.3f}{_interval(figure, 'score', '.3f')}"
    steps = f"{figure['steps']['mean']:.1f} {rules_of(figure['task']).words.steps}{_interval(figure, 'steps', '.1f')}"
    figures = f"{score}, {steps}, {figure['completed']:.0%} completed."
    text = f"Volunteers on this playground, self-selected: {where} ({who}{abandoned}): {figures}"
    return text if figure["players"] > 1 else f"{text} One player gives no interval."


def _interval(figure: dict[str, Any], metric: MetricName, form: str) -> str:
    low, high = figure[metric]["low"], figure[metric]["high"]
    if low is None or high is None:
        return ""
    kind = "guaranteed 95 % interval" if figure["headline"] == "guaranteed" else "95 % interval"
    return f" ({kind} {low:{form}} to {high:{form}})"
