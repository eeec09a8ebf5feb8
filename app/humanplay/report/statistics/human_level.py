"""The estimate over the playground's volunteers, for each configuration.

Volunteers chose to play, and how often: they are no sample of anybody, and their mean is not called
the human level, which is a closed study's alone. A mean is over the players with at least
LEAST_EPISODES ranked episodes, and needs LEAST_PLAYERS of them. Every player weighs the same,
however much they played, because one player's episodes resemble each other. The interval is a
report's for fixed terrains (`humanplay.report.statistics.intervals`), since no two players have the
same ones. Only counted episodes enter (`humanplay.db.reader.HUMAN_SCORE_CONDITION`); one that was
abandoned is among them.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Literal, NotRequired, TypedDict

import numpy as np

from humanplay.db.reader import Reader
from humanplay.db.trial import parse_config
from humanplay.db.volunteers import Sums, played_configs, players_of
from humanplay.report.statistics.exclusion_sets import MetricName
from humanplay.report.statistics.formatting import counted
from humanplay.report.statistics.intervals import estimate
from humanplay.report.statistics.study_figures import MeanInterval, metric_bounds, worst_value
from humanplay.task import Configuration, Environment
from humanplay.task.registration import environment_of
from marsexplorer.intervals import Floats, t_interval

LEAST_PLAYERS, LEAST_EPISODES = 5, 5
"""A mean needs so many players with so many ranked episodes each; who has fewer episodes is not in
it."""


class Counts(TypedDict):
    """How many players, and of their episodes how many in all, abandoned and spoilt."""

    players: int
    episodes: int
    abandoned: int
    spoilt: int


class Shortfall(TypedDict):
    """Players that lack, of how many with so many episodes each."""

    players: int
    of: int
    episodes: int


class MeansAsPlayed(TypedDict):
    """The means as if no episode was spoilt."""

    score: float
    steps: float


class Means(TypedDict):
    """The means over players; None while players are missing.

    Attributes:
        as_played: As if no episode was spoilt; None if none is.
    """

    as_played: MeansAsPlayed | None
    score: MeanInterval | None
    steps: MeanInterval | None
    completed: float | None


class VolunteerFigure(Counts, Means):
    """The volunteers' estimate on a configuration.

    It has the counts of all, and the counts and means of those who enter.
    """

    task: str
    level: str
    where: str
    rows: NotRequired[int]
    cols: NotRequired[int]
    config_hash: str
    config: dict[str, object]
    population: Literal["volunteers"]
    entering: Counts
    missing: Shortfall | None


class HumanLevel(TypedDict):
    """A figure for each configuration, and the same in words."""

    figures: list[VolunteerFigure]
    sentence: str


NOBODY_PLAYED = "Volunteers on this playground: nobody has played a ranked episode yet."


class VolunteerFigures:
    """The volunteers' estimates, each cached until one of its sums changes.

    `humanplay.db.volunteers` holds the sums. Nobody's id is cached, and an estimate without
    episodes is dropped.
    """

    def __init__(self) -> None:
        self._cached: dict[str, tuple[str, VolunteerFigure]] = {}
        self._making = threading.Lock()

    def human_level(self, store: Reader) -> HumanLevel:
        """As the function `human_level`.

        The estimates are shared, so do not change them.
        """
        with self._making:
            self._cached = {
                config_hash: self._figure_with_state(store, config_hash, task, config, state)
                for config_hash, task, config, state in played_configs(store)
            }
            figures = [figure for _, figure in self._cached.values()]
        figures.sort(key=lambda figure: (-figure["episodes"], figure["config_hash"]))
        return {"figures": figures, "sentence": " ".join(map(_sentence, figures)) or NOBODY_PLAYED}

    def _figure_with_state(
        self, store: Reader, config_hash: str, task: str, config: str, state: str
    ) -> tuple[str, VolunteerFigure]:
        """A configuration's estimate, with the state of the sums that it is made from."""
        cached = self._cached.get(config_hash)
        if cached is not None and cached[0] == state:
            return cached
        return state, _figure(task, config, players_of(store, config_hash))


def human_level(store: Reader) -> HumanLevel:
    """The volunteers' estimates; none for nobody."""
    return VolunteerFigures().human_level(store)


def mean_interval(values: Sequence[float]) -> MeanInterval:
    """A mean with its t interval, which fewer than two values do not have."""
    mean = _mean(values)
    if len(values) < 2:
        return {"mean": mean, "low": None, "high": None}
    low, high = t_interval(np.array(values, np.float64))
    return {"mean": mean, "low": float(low), "high": float(high)}


def _figure(task: str, config_json: str, players: Sequence[Sums]) -> VolunteerFigure:
    environment, config = environment_of(task), parse_config(task, config_json)
    values = config.to_dict()
    entering = [sums for sums in players if sums.episodes >= LEAST_EPISODES]
    missing = max(0, LEAST_PLAYERS - len(entering))
    means: Means = {"as_played": None, "score": None, "steps": None, "completed": None}
    if not missing:
        means = _means(environment, config, entering)
    figure: VolunteerFigure = {
        "task": task,
        "level": config.level,
        "where": environment.texts(config).setting,
        "config_hash": config.hash,
        "config": values,
        "population": "volunteers",
        "players": len(players),
        "episodes": sum(sums.episodes for sums in players),
        "abandoned": sum(sums.abandoned for sums in players),
        "spoilt": sum(sums.spoilt for sums in players),
        "entering": _counts(entering),
        "missing": {"players": missing, "of": LEAST_PLAYERS, "episodes": LEAST_EPISODES}
        if missing
        else None,
        "as_played": means["as_played"],
        "score": means["score"],
        "steps": means["steps"],
        "completed": means["completed"],
    }
    rows, cols = values.get("rows"), values.get("cols")
    if isinstance(rows, int) and isinstance(cols, int):
        figure["rows"], figure["cols"] = rows, cols
    return figure


def _counts(players: Sequence[Sums]) -> Counts:
    return {
        "players": len(players),
        "episodes": sum(sums.episodes for sums in players),
        "abandoned": sum(sums.abandoned for sums in players),
        "spoilt": sum(sums.spoilt for sums in players),
    }


def _means(environment: Environment, config: Configuration, players: Sequence[Sums]) -> Means:
    as_played: MeansAsPlayed = {
        "score": _mean([sums.played_score / sums.episodes for sums in players]),
        "steps": _mean([sums.played_steps / sums.episodes for sums in players]),
    }
    scores = np.array([sums.score / sums.episodes for sums in players])
    steps = np.array([sums.steps / sums.episodes for sums in players])
    return {
        "as_played": as_played if any(sums.spoilt for sums in players) else None,
        "score": _interval_of(environment, config, "score", scores),
        "steps": _interval_of(environment, config, "steps", steps),
        "completed": _mean([1 - sums.failed / sums.episodes for sums in players]),
    }


def _interval_of(
    environment: Environment, config: Configuration, metric: MetricName, means: Floats
) -> MeanInterval:
    """Mean, low and high over players.

    Each has terrains of their own, so terrains are no term of it.
    """
    bounds, worst = (
        metric_bounds(environment, config, metric),
        worst_value(environment, config, metric),
    )
    figure = estimate(means[:, np.newaxis], bounds, worst, terrains_drawn=False)
    low, high = figure.interval or (None, None)
    return {"mean": figure.mean, "low": low, "high": high}


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def _sentence(figure: VolunteerFigure) -> str:
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
    steps = f"{_with_interval(figure['steps'], '.1f', environment_of(figure['task']).about.words.steps)}"
    means = f"{score}, {steps}, {figure['completed']:.0%} completed"
    if played := figure["as_played"]:
        means += f"; with spoilt episodes as they were played {played['steps']:.1f} steps"
    entering = (
        f"the {counted(figure['entering']['players'], 'player')} with "
        f"at least {LEAST_EPISODES} episodes"
    )
    return f"{place}: {means}. Each of {entering} weighs the same; {who} in all{left}."


def _with_interval(estimate: MeanInterval | None, form: str, unit: str = "") -> str:
    if estimate is None:
        return "none"
    ends = "no interval"
    if estimate["low"] is not None:
        ends = f"95 % interval {estimate['low']:{form}} to {estimate['high']:{form}}"
    return f"{estimate['mean']:{form}}{unit and f' {unit}'} ({ends})"
