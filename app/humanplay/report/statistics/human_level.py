"""The figure of the playground's volunteers: for each configuration, the mean of the players' means with its interval.

Volunteers chose to play, and how often: they are no sample of anybody, and their figure is not called the human level, which is
a closed study's alone. A mean is over the players with at least LEAST_EPISODES ranked episodes, and needs LEAST_PLAYERS of
them. Every player weighs the same, however much they played, because one player's episodes resemble each other. The interval
is a report's for fixed terrains (`humanplay.report.statistics.intervals`), since no two players have the same ones. Only
counted episodes enter (`humanplay.db.reader.HUMAN_SCORE_CONDITION`); one that was abandoned is among them.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from humanplay.db.reader import Reader
from humanplay.db.trial import parse_config
from humanplay.db.volunteers import Sums, played_configs, players_of
from humanplay.report.statistics.exclusion_sets import MetricName
from humanplay.report.statistics.formatting import counted
from humanplay.report.statistics.intervals import estimate
from humanplay.report.statistics.study_figures import MeanInterval, metric_bounds, worst_value
from humanplay.task import Configuration, Rules
from humanplay.task.registration import rules_of
from marsexplorer.intervals import Floats, t_interval

LEAST_PLAYERS, LEAST_EPISODES = 5, 5
"""A mean needs so many players with so many ranked episodes each; who has fewer episodes is not in it."""

MEANS = ("as_played", "score", "steps", "completed")
"""What a figure has only once it has enough players."""

NOBODY_PLAYED = "Volunteers on this playground: nobody has played a ranked episode yet."


class VolunteerFigures:
    """The volunteers' figures, each kept until a sum that it is made from is another (`humanplay.db.volunteers`).

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


def mean_interval(values: Sequence[float]) -> MeanInterval:
    """A mean with its t interval, which fewer than two values do not have."""
    mean = _mean(values)
    if len(values) < 2:
        return {"mean": mean, "low": None, "high": None}
    low, high = t_interval(np.array(values, np.float64))
    return {"mean": mean, "low": float(low), "high": float(high)}


def _figure(task: str, config_json: str, players: Sequence[Sums]) -> dict[str, Any]:
    rules, config = rules_of(task), parse_config(task, config_json)
    values = config.to_dict()
    entering = [each for each in players if each.episodes >= LEAST_EPISODES]
    missing = max(0, LEAST_PLAYERS - len(entering))
    return {
        "task": task,
        "level": config.level,
        "where": rules.texts(config).setting,
        **{side: values[side] for side in ("rows", "cols") if side in values},
        "config_hash": config.hash,
        "config": values,
        "population": "volunteers",
        **_counts(players),
        "entering": _counts(entering),
        "missing": {"players": missing, "of": LEAST_PLAYERS, "episodes": LEAST_EPISODES}
        if missing
        else None,
        **(dict.fromkeys(MEANS) if missing else _means(rules, config, entering)),
    }


def _counts(players: Sequence[Sums]) -> dict[str, int]:
    """How many players, and of their episodes how many in all, abandoned and spoilt."""
    names = ("episodes", "abandoned", "spoilt")
    sums = {name: sum(getattr(each, name) for each in players) for name in names}
    return {"players": len(players), **sums}


def _means(rules: Rules, config: Configuration, players: Sequence[Sums]) -> dict[str, Any]:
    """The means over players, by the names in MEANS."""
    as_played = {
        "score": _mean([each.played_score / each.episodes for each in players]),
        "steps": _mean([each.played_steps / each.episodes for each in players]),
    }
    scores = np.array([each.score / each.episodes for each in players])
    steps = np.array([each.steps / each.episodes for each in players])
    return {
        "as_played": as_played if any(each.spoilt for each in players) else None,
        "score": _interval_of(rules, config, "score", scores),
        "steps": _interval_of(rules, config, "steps", steps),
        "completed": _mean([1 - each.failed / each.episodes for each in players]),
    }


def _interval_of(
    rules: Rules, config: Configuration, metric: MetricName, means: Floats
) -> MeanInterval:
    """Mean, low and high over players; each has terrains of their own, so these are no term of it."""
    bounds, worst = metric_bounds(rules, config, metric), worst_value(rules, config, metric)
    figure = estimate(means[:, np.newaxis], bounds, worst, terrains_drawn=False)
    low, high = figure.interval or (None, None)
    return {"mean": figure.mean, "low": low, "high": high}


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def _sentence(figure: dict[str, Any]) -> str:
    """A figure in plain words."""
    who = f"{counted(figure['players'], 'player')} and {counted(figure['episodes'], 'episode')}"
    left = f", {figure['abandoned']} of them abandoned" if figure["abandoned"] else ""
    left += f" ({figure['spoilt']} spoilt)" if figure["spoilt"] else ""
    place = f"Volunteers on this playground, self-selected: {figure['where']}"
    if missing := figure["missing"]:
        lacks = f"{missing['players']} {'is' if missing['players'] == 1 else 'are'} missing"
        least = f"{counted(missing['of'], 'player')} with {counted(missing['episodes'], 'ranked episode')} each"
        return f"{place}: {who} so far{left}, and no mean yet. It needs {least}: {lacks}."
    score = f"mean score {_with_interval(figure['score'], '.3f')}"
    steps = f"{_with_interval(figure['steps'], '.1f', rules_of(figure['task']).about.words.steps)}"
    means = f"{score}, {steps}, {figure['completed']:.0%} completed"
    if played := figure["as_played"]:
        means += f"; with spoilt episodes as they were played {played['steps']:.1f} steps"
    entering = (
        f"the {counted(figure['entering']['players'], 'player')} with "
        f"at least {LEAST_EPISODES} episodes"
    )
    return f"{place}: {means}. Each of {entering} weighs the same; {who} in all{left}."


def _with_interval(value: dict[str, float | None], form: str, unit: str = "") -> str:
    ends = "no interval"
    if value["low"] is not None:
        ends = f"95 % interval {value['low']:{form}} to {value['high']:{form}}"
    return f"{value['mean']:{form}}{unit and f' {unit}'} ({ends})"
