"""The figure of the playground's volunteers: for each configuration, the mean of the players' means with its interval.

Volunteers chose to play, and how often: they are no sample of anybody, and their figure is not called the human level, which is
a closed study's alone. Every player weighs the same, however much they played, because one player's episodes resemble each
other. The interval is the one that reports print (`app.report.statistics.intervals`). Only counted episodes enter
(`app.db.reader.HUMAN_SCORE_CONDITION`); one that was abandoned is among them.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from app.db.reader import Reader
from app.db.trial import parse_config
from app.db.volunteers import Sums, played_configs, players_of
from app.report.statistics.exclusion_sets import MetricName
from app.report.statistics.formatting import counted
from app.report.statistics.intervals import Interval, estimate_of_means, is_a_few_players
from app.report.statistics.study_figures import metric_bounds
from app.task import rules_of
from marsexplorer.intervals import t_interval

NOBODY_PLAYED = "Volunteers on this playground: nobody has played a ranked episode yet."


class VolunteerFigures:
    """The volunteers' figures, each kept until a sum that it is made from is another (`app.db.volunteers`).

    Nobody's id is kept, and figures that nothing counts for any longer are dropped.
    """

    def __init__(self) -> None:
        self._made: dict[str, tuple[str, dict[str, Any]]] = {}
        self._making = threading.Lock()

    def human_level(self, store: Reader) -> dict[str, Any]:
        """Return what the function `human_level` returns; the figures are shared, so do not change them."""
        with self._making:
            self._made = {
                config_hash: self._made_from(store, config_hash, task, config, state)
                for config_hash, task, config, state in played_configs(store)
            }
            figures = [figure for _, figure in self._made.values()]
        figures.sort(key=lambda figure: (-figure["episodes"], figure["config_hash"]))
        return {"figures": figures, "sentence": " ".join(map(_sentence, figures)) or NOBODY_PLAYED}

    def _made_from(
        self, store: Reader, config_hash: str, task: str, config: str, state: str
    ) -> tuple[str, dict[str, Any]]:
        """Return the state of a configuration's sums with the figure that they give."""
        made = self._made.get(config_hash)
        if made is not None and made[0] == state:
            return made
        return state, _figure(task, config, players_of(store, config_hash))


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


def _figure(task: str, config_json: str, players: Sequence[Sums]) -> dict[str, Any]:
    rules, config = rules_of(task), parse_config(task, config_json)
    values = config.to_dict()
    failed = np.array([each.failed for each in players], np.float64)
    counts = np.array([each.episodes for each in players], np.float64)
    is_guaranteed = len(players) > 1 and bool(is_a_few_players(failed, counts))
    spoilt = sum(each.spoilt for each in players)
    as_played = {
        "score": _mean([each.played_score / each.episodes for each in players]),
        "steps": _mean([each.played_steps / each.episodes for each in players]),
    }
    scores = [each.score / each.episodes for each in players]
    steps = [each.steps / each.episodes for each in players]
    return {
        "task": task,
        "level": config.level,
        "where": rules.where(config),
        **{side: values[side] for side in ("rows", "cols") if side in values},
        "config_hash": config.hash,
        "config": values,
        "population": "volunteers",
        "headline": "guaranteed" if is_guaranteed else "printed",
        "players": len(players),
        "episodes": sum(each.episodes for each in players),
        "abandoned": sum(each.abandoned for each in players),
        "spoilt": spoilt,
        "as_played": as_played if spoilt else None,
        "score": _interval_of(scores, metric_bounds(rules, config, "score"), is_guaranteed),
        "steps": _interval_of(steps, metric_bounds(rules, config, "steps"), is_guaranteed),
        "completed": _mean([1 - each.failed / each.episodes for each in players]),
    }


def _interval_of(
    means: Sequence[float], bounds: Interval, is_guaranteed: bool
) -> dict[str, float | None]:
    """Return mean, low and high over players as a report prints them; low and high None for one player."""
    found = estimate_of_means(np.array(means, np.float64), bounds, is_guaranteed)
    low, high = found.interval or (None, None)
    return {"mean": found.mean, "low": low, "high": high}


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def _sentence(figure: dict[str, Any]) -> str:
    """Return a figure in plain words."""
    who = f"{counted(figure['players'], 'player')}, {counted(figure['episodes'], 'episode')}"
    abandoned = f", {figure['abandoned']} of them abandoned" if figure["abandoned"] else ""
    if found := figure["as_played"]:
        abandoned += f", of these {figure['spoilt']} spoilt, as played {found['steps']:.1f} steps"
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
