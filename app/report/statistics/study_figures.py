"""A study's human figure under each exclusion set, and the score so far that the operator and the leaderboard show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.report.statistics.comparisons import player_means
from app.report.statistics.exclusion_sets import (
    ALL,
    METRICS,
    Cohort,
    MetricName,
    members,
    people_of,
    rule_in_words,
)
from app.report.statistics.formatting import counted
from app.report.statistics.headline import is_a_few_players
from app.report.statistics.intervals import Estimate, Interval, estimate
from app.series.data import StudyData
from app.task import Configuration, Rules, Words

PRIMARY = "protocol"
"""The exclusion set of the headline; "all" where a protocol names none of that name."""

NO_HUMAN_FIGURE = "No human has played this study: it has no human figure."


@dataclass(frozen=True)
class StudyFigure:
    """The figure under one exclusion set.

    name       "all", or a set of the protocol's ("protocol", "strict")
    rule       who enters, in words
    completed  share of episodes that reached 99 %, 0..1, the mean over players
    """

    name: str
    rule: str
    players: int = 0
    episodes: int = 0
    score: Estimate | None = None
    steps: Estimate | None = None
    completed: float | None = None


def study_figures(data: StudyData, cohort: Cohort) -> tuple[StudyFigure, ...]:
    """Return the cohort's figure under "all" and under each exclusion set of the protocol, in this order."""
    sets = {ALL: None, **data.protocol.exclusion}
    return tuple(_figure(data, cohort, name, rules) for name, rules in sets.items())


def primary_set(data: StudyData) -> str:
    """Return the name of the exclusion set whose figure is the headline."""
    return PRIMARY if PRIMARY in data.protocol.exclusion else ALL


def live_figure(data: StudyData) -> dict[str, Any]:
    """Return the people's figure as it may be seen: set, players, episodes, score, steps, sentence.

    score and steps are {"mean", "low", "high"} by the report's rule (low and high None below two players), None for nobody. The
    set is the primary one where anybody is in it, else "all". An open study has nobody in any, and its sentence says how many
    have finished.
    """
    figures = study_figures(data, people_of(data))
    primary = next(figure for figure in figures if figure.name == primary_set(data))
    chosen = primary if primary.players else figures[0]
    return {
        "set": chosen.name,
        "players": chosen.players,
        "episodes": chosen.episodes,
        "score": _mean_and_interval(chosen.score),
        "steps": _mean_and_interval(chosen.steps),
        "sentence": _said(data, chosen),
    }


def _said(data: StudyData, figure: StudyFigure) -> str:
    if data.closed_ms is None:
        return data.progress_sentence()
    words = data.protocol.rules.words
    return figure_sentence(figure, words) if figure.players else NO_HUMAN_FIGURE


def figure_sentence(figure: StudyFigure, words: Words) -> str:
    """Return a figure that has at least one player as a sentence."""
    assert figure.score is not None
    assert figure.steps is not None
    who = f"{counted(figure.players, 'player')}, {figure.episodes} ranked episodes"
    kind = "guaranteed " if figure.score.headline == "guaranteed" else ""
    kind += "95 % interval "  # said once
    reasons, said = [], []
    for found, text, form in (
        (figure.score, f"mean score {figure.score.mean:.3f}", ".3f"),
        (figure.steps, f"{figure.steps.mean:.1f} {words.steps}", ".1f"),
    ):
        reasons.append(why_no_interval(found))
        if reasons[-1] is None and found.interval is not None:
            text += f" ({kind}{found.interval[0]:{form}} to {found.interval[1]:{form}})"
            kind = ""
        said.append(text)
    why = dict.fromkeys(reason for reason in reasons if reason)
    return " ".join([f"{who}: {', '.join(said)}.", *why])


def why_no_interval(estimate: Estimate) -> str | None:
    """Return the sentence that says why an estimate has no headline interval; None where it has one."""
    if estimate.interval is None:
        return "One player gives no interval."
    if estimate.headline == "guaranteed":
        return None
    return "Players who do not differ give no interval." if estimate.sd == 0 else None


def metric_bounds(rules: Rules, config: Configuration, metric: MetricName) -> Interval:
    """Return the lowest and the highest mean that a player can have; steps lie in 1..limit."""
    return (1.0, float(config.limit)) if metric == "steps" else rules.bounds(config)


def _figure(
    data: StudyData, cohort: Cohort, name: str, rules: Mapping[Any, Any] | None
) -> StudyFigure:
    """Return the figure of the cohort's members under one set's rules; None are the rules of "all"."""
    ids = members(cohort, rules or {})
    if not ids:
        return StudyFigure(name, rule_in_words(rules))
    episodes = np.array([len(cohort.ranked[person]) for person in ids], np.float64)
    failed = np.array(
        [sum(not trial.succeeded for trial in cohort.ranked[person]) for person in ids], np.float64
    )
    is_guaranteed = len(ids) > 1 and bool(is_a_few_players(failed, episodes))
    score, steps = (
        estimate(
            player_means(cohort.table(ids, metric)),
            metric_bounds(data.protocol.rules, data.protocol.env_config, metric),
            is_guaranteed,
        )
        for metric in METRICS
    )
    return StudyFigure(
        name,
        rule_in_words(rules),
        players=len(ids),
        episodes=int(episodes.sum()),
        score=score,
        steps=steps,
        completed=float(np.mean(1 - failed / episodes)),
    )


def _mean_and_interval(found: Estimate | None) -> dict[str, float | None] | None:
    if found is None:
        return None
    low, high = found.interval or (None, None)
    return {"mean": found.mean, "low": low, "high": high}
