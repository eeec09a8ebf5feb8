"""A study's human figure under each exclusion set, and the score so far that the operator and the leaderboard show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from app.report.statistics.intervals import Estimate, Interval, estimate_of_means, is_a_few_players
from app.series.data import StudyData
from app.task import Configuration, Rules, Words

ITT, AS_PLAYED = "intention to treat", "as played"
"""Rows beside those of the exclusion sets."""
RULES_IN_WORDS = {
    ITT: "everybody who began a ranked episode; a terrain that was not finished counts as given up before the first move",
    AS_PLAYED: "the primary set, spoilt episodes as they were played",
}
PRIMARY = "protocol"
"""The exclusion set of the headline; "all" where a protocol names none of that name."""

NO_HUMAN_FIGURE = "No human has played this study: it has no human figure."


@dataclass(frozen=True)
class StudyFigure:
    """The figure under one exclusion set.

    name       "all", a set of the protocol's ("protocol", "strict"), "intention to treat" or "as played"
    rule       who enters, in words
    completed  share of episodes that reached 99 %, 0..1, the mean over players, with the headline's interval, the guaranteed
               one also where players do not differ
    """

    name: str
    rule: str
    players: int = 0
    episodes: int = 0
    score: Estimate | None = None
    steps: Estimate | None = None
    completed: Estimate | None = None


def study_figures(data: StudyData, cohort: Cohort) -> tuple[StudyFigure, ...]:
    """Return the cohort's figure under "all" and under each exclusion set of the protocol, in this order.

    For people two further rows follow: by intention to treat, and where an episode was spoilt the primary set as it was played.
    """
    sets: dict[str, Mapping[Any, Any]] = {ALL: {}, **data.protocol.exclusion}
    found = [_figure(data, cohort, name, members(cohort, rules)) for name, rules in sets.items()]
    if cohort.kind == "human":
        begun = intention_to_treat(data, cohort)
        found.append(_figure(data, begun, ITT, members(begun, {})))
        if any(trial.attestation == "spoilt" for own in cohort.ranked.values() for trial in own):
            played, primary = people_of(data, as_played=True), primary_set(data)
            found.append(_figure(data, played, AS_PLAYED, members(cohort, sets[primary])))
    return tuple(found)


def intention_to_treat(data: StudyData, cohort: Cohort) -> Cohort:
    """Return everybody who began a ranked episode, each terrain that they did not finish counted as given up before a move."""
    is_shown = data.closed_ms is not None
    begun = {each.participant: each for each in data.trials if is_shown and each.phase == "ranked"}
    ranked = {person: own for person, own in cohort.ranked.items() if person in begun}
    low, _ = data.protocol.rules.bounds(data.protocol.env_config)
    for person, own in ranked.items():
        missing = set(range(cohort.terrains)) - {each.terrain_index for each in own}
        left = [
            replace(
                begun[person], outcome="timed_out", steps=0, total=0.0, score=max(0.0, low), labels=(),
                terrain_index=terrain, trial=cohort.terrains + at,
            ).forfeited()
            for at, terrain in enumerate(sorted(missing))
        ]  # fmt: skip
        ranked[person] = (*own, *left)
    return replace(cohort, ranked={**dict.fromkeys(cohort.ranked, ()), **ranked})


def claim_of(data: StudyData) -> str:
    """Return what a closed study's figure of people may be called, with the level that its episodes reach.

    It is the human level where every episode was supervised, or attested of people who came by a personal invitation or a
    panel's signed link. Anybody may come by an open link, and an unsigned id of a panel may be made up.
    """
    level, came = data.protocol.required_attestation, data.protocol.recruitment
    is_personal = came == "invitation" or (came, data.protocol.panel_links) == ("panel", "signed")
    is_known = level == "supervised" or (level == "attested" and is_personal)
    return f"{'Human level' if is_known else 'Figure of unverified participants'} ({level})"


def primary_set(data: StudyData) -> str:
    """Return the name of the exclusion set whose figure is the headline."""
    return PRIMARY if PRIMARY in data.protocol.exclusion else ALL


def live_figure(data: StudyData) -> dict[str, Any]:
    """Return the people's figure as it may be seen: claim, set, players, episodes, score, steps, sentence.

    score and steps are {"mean", "low", "high"} by the report's rule (low and high None below two players), None for nobody. The
    set is the primary one where anybody is in it, else "all". An open study has nobody in any, and its sentence says how many
    have finished.
    """
    figures = study_figures(data, people_of(data))
    primary = next(figure for figure in figures if figure.name == primary_set(data))
    chosen = primary if primary.players else figures[0]
    return {
        "claim": claim_of(data),
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
    if not figure.players:
        return NO_HUMAN_FIGURE
    return f"{claim_of(data)}: {figure_sentence(figure, words)}"


def figure_sentence(figure: StudyFigure, words: Words) -> str:
    """Return a figure that has at least one player as a sentence."""
    assert figure.score is not None
    assert figure.steps is not None
    who = f"{counted(figure.players, 'player')}, {counted(figure.episodes, 'ranked episode')}"
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


def why_no_p(figure: StudyFigure) -> str | None:
    """Return the sentence that says why the tail rule forbids p values; None where it does not."""
    if figure.score is not None and figure.score.headline == "guaranteed":
        return (
            "No p value is given: failures are a few players' here, and where they were in simulation, a policy as good as "
            "people had a p below 0.05 in up to 45.6 % of studies."
        )
    return None


def metric_bounds(rules: Rules, config: Configuration, metric: MetricName) -> Interval:
    """Return the lowest and the highest mean that a player can have; steps lie in 1..limit."""
    return (1.0, float(config.limit)) if metric == "steps" else rules.bounds(config)


def worst_value(rules: Rules, config: Configuration, metric: MetricName) -> float | None:
    """The worst value that an episode can have in a metric; None where no lowest score is declared."""
    if metric == "steps":
        return float(config.limit)
    lowest = rules.bounds(config)[0]
    return lowest if np.isfinite(lowest) else None


def _figure(data: StudyData, cohort: Cohort, name: str, ids: Sequence[str]) -> StudyFigure:
    """Return the figure of some of the cohort, under the name of a row."""
    rule = RULES_IN_WORDS.get(name) or rule_in_words(data.protocol.exclusion.get(name))
    if not ids:
        return StudyFigure(name, rule)
    episodes = np.array([len(cohort.ranked[person]) for person in ids], np.float64)
    counts = [sum(not trial.succeeded for trial in cohort.ranked[person]) for person in ids]
    failed = np.array(counts, np.float64)
    is_guaranteed = len(ids) > 1 and bool(is_a_few_players(failed, episodes))
    shares = 1 - failed / episodes
    rules, config = data.protocol.rules, data.protocol.env_config
    means = [player_means(cohort.table(ids, each)) for each in METRICS]
    bounds = [metric_bounds(rules, config, each) for each in METRICS]
    of_both = zip(means, bounds, strict=True)
    score, steps = (estimate_of_means(*each, is_guaranteed) for each in of_both)
    return StudyFigure(
        name,
        rule,
        players=len(ids),
        episodes=int(episodes.sum()),
        score=score,
        steps=steps,
        completed=estimate_of_means(shares, (0.0, 1.0), is_guaranteed or np.ptp(shares) == 0),
    )


def _mean_and_interval(found: Estimate | None) -> dict[str, float | None] | None:
    if found is None:
        return None
    low, high = found.interval or (None, None)
    return {"mean": found.mean, "low": low, "high": high}
