"""A study's two estimates, who finished and everybody who began, and what operator and leaderboard show of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypedDict

import numpy as np

from humanplay.report.statistics.exclusion_sets import (
    EVERYBODY,
    METRICS,
    Cohort,
    Everybody,
    MetricName,
    everybody_of,
    members,
    people_of,
    practice_verdicts,
    rule_in_words,
    statuses,
)
from humanplay.report.statistics.formatting import counted
from humanplay.report.statistics.intervals import Estimate, Interval, estimate, player_means
from humanplay.study.data import StudyData
from humanplay.study.flow import BEGAN, Status
from humanplay.study.protocol import PER_PROTOCOL, Protocol
from humanplay.task import Configuration, Environment
from marsexplorer.intervals import FEWEST, Floats

PER_PROTOCOL_NAME = "per protocol"
EVERYBODY_RULE = (
    "everybody who began a ranked episode, bots left out; instances that they gave up or did not end, or that a bot, a failure "
    "or a rule ended, count at the lowest score and the limit"
)

NO_HUMAN_FIGURE = "No human has played this study: it has no human figure."


@dataclass(frozen=True)
class StudyFigure:
    """The estimate of some of the players.

    name       "per protocol", "everybody", or another exclusion set of the protocol
    rule       who enters, in words
    score      None where nobody enters, and for everybody where no lowest score is declared
    completed  share of episodes that succeeded, 0..1, the mean over players
    erased     people who are missing because they were erased
    score_range, steps_range  low and high mean had all of them been best or all worst; None for nobody erased, and where a
               bound is not known
    """

    name: str
    rule: str
    players: int = 0
    episodes: int = 0
    score: Estimate | None = None
    steps: Estimate | None = None
    completed: Estimate | None = None
    erased: int = 0
    score_range: Interval | None = None
    steps_range: Interval | None = None


@dataclass(frozen=True)
class StatusRow:
    """The people of one status.

    in_per_protocol, in_everybody  whether they are in these estimates
    as_played  ranked terrains that enter the estimate for everybody as they were played
    lowest     those that enter at the lowest score, by reason (`exclusion_sets.Lowest`)
    """

    status: str
    people: int
    in_per_protocol: bool
    in_everybody: bool
    as_played: int = 0
    lowest: dict[str, int] = field(default_factory=dict)


def study_figures(data: StudyData, cohort: Cohort, everybody: Everybody) -> tuple[StudyFigure, ...]:
    """Return the estimate per protocol, that for everybody, and one for each other exclusion set of the protocol."""
    protocol, arrivals = data.protocol, data.arrivals
    is_human = cohort.kind == "human"
    erased = (arrivals.erased_finishers, arrivals.erased_began) if is_human else (0, 0)
    rule = rule_in_words(protocol.per_protocol)
    ids = members(cohort, protocol.per_protocol)
    began = members(everybody.cohort, {})
    found = [
        _figure(data, cohort, PER_PROTOCOL_NAME, rule, ids, erased[0]),
        _figure(data, everybody.cohort, EVERYBODY, EVERYBODY_RULE, began, erased[1]),
    ]
    for name, rules in protocol.exclusion.items():
        if name != PER_PROTOCOL:
            ids = members(cohort, rules)
            found.append(_figure(data, cohort, name, rule_in_words(rules), ids))
    return tuple(found)


def status_rows(data: StudyData, cohort: Cohort, everybody: Everybody) -> tuple[StatusRow, ...]:
    """Return a row for each status that somebody has, those of whom only counts are kept among them."""
    by_person = statuses(data, cohort)
    counts = Counter(by_person.values())
    if cohort.kind == "human":
        counts[Status.DECLINED] = data.arrivals.declined
        counts[Status.UNDECIDED] = data.arrivals.undecided
        counts[Status.UNFIT_DEVICE] = data.arrivals.unfit
        counts[Status.ERASED] = data.arrivals.erased
    rows = []
    for status in (each for each in Status if counts[each]):
        people = [person for person, own in by_person.items() if own is status]
        reasons = Counter(
            reason for person in people for reason in everybody.reasons.get(person, ())
        )
        as_played = reasons.pop(None, 0)
        rows.append(
            StatusRow(
                status=status.value,
                people=counts[status],
                in_per_protocol=status is Status.FINISHED,
                in_everybody=status in BEGAN,
                as_played=as_played,
                lowest={reason.value: n for reason, n in sorted(reasons.items()) if reason},
            )
        )
    return tuple(rows)


def claim_of(data: StudyData) -> str:
    """Return what a closed study's figure of people may be called, with the level that its episodes reach.

    It is the human level where every episode was supervised, or attested of people who came by a personal invitation or a
    panel's signed link. Anybody may come by an open link, and an unsigned id of a panel may be made up.
    """
    level, came = data.protocol.required_attestation, data.protocol.recruitment
    is_personal = came == "invitation" or (came, data.protocol.panel_links) == ("panel", "signed")
    is_known = level == "supervised" or (level == "attested" and is_personal)
    return f"{'Human level' if is_known else 'Figure of unverified participants'} ({level})"


class MeanInterval(TypedDict):
    """A mean, and its 95 % interval; low and high None without one."""

    mean: float
    low: float | None
    high: float | None


class ShownFigure(TypedDict):
    """An estimate as it is shown; None where nobody has any."""

    players: int
    episodes: int
    score: MeanInterval | None
    steps: MeanInterval | None


class LiveFigure(ShownFigure):
    """The people's estimates as they may be seen: per protocol, or of everybody if nobody has finished.

    set  which of the two
    """

    claim: str
    set: str
    everybody: ShownFigure
    sentence: str


def live_figure(data: StudyData) -> LiveFigure:
    """The people's estimates as they may be seen.

    An open study has nobody in any, and its sentence says how many have finished.
    """
    cohort = people_of(data)
    per_protocol, everybody, *_ = study_figures(data, cohort, everybody_of(data, cohort))
    first = per_protocol if per_protocol.players else everybody
    return {
        "claim": claim_of(data),
        "set": first.name,
        **_shown(first),
        "everybody": _shown(everybody),
        "sentence": headline(data, per_protocol, everybody),
    }


def _shown(figure: StudyFigure) -> ShownFigure:
    return {
        "players": figure.players,
        "episodes": figure.episodes,
        "score": _mean_and_interval(figure.score),
        "steps": _mean_and_interval(figure.steps),
    }


def headline(data: StudyData, per_protocol: StudyFigure, everybody: StudyFigure) -> str:
    """Return the sentence with both estimates; that of an open study says how many have finished."""
    if data.closed_ms is None:
        return data.progress_sentence()
    protocol = data.protocol
    verdicts = practice_verdicts(data, people_of(data).people)
    passed = sum(verdicts.values())
    if not everybody.players:
        if not verdicts:
            return NO_HUMAN_FIGURE
        people = counted(len(verdicts), "person", "people")
        return f"{passed} of {people} passed the practice, and nobody began a ranked episode: there is no figure of people."
    of_both = of_one = ""
    who = f", of people who passed the practice ({passed} of {len(verdicts)})"
    if protocol.practice is not None and protocol.practice.then == "screen_out":
        of_both = who
    elif protocol.per_protocol.get("passed_practice"):
        of_one = who
    finished = "Nobody finished as the protocol asks."
    if per_protocol.players:
        finished = f"Per protocol{of_one}: {figure_sentence(per_protocol, protocol)}"
    began = f"Everybody who began: {figure_sentence(everybody, protocol)}"
    return f"{claim_of(data)}{of_both}. {finished} {began}"


def interval_for(protocol: Protocol) -> str:
    """Whom and what a study's intervals are for, in words."""
    terrains = "and other instances" if protocol.terrains_drawn else "on these instances"
    return f"other players {terrains}"


def figure_sentence(figure: StudyFigure, protocol: Protocol) -> str:
    """Return a figure that has at least one player as a sentence."""
    words = protocol.environment.about.words
    who = f"{counted(figure.players, 'player')}, {counted(figure.episodes, 'ranked episode')}"
    kind = "95 % interval "  # said once
    if not protocol.terrains_drawn:
        kind += f"for {interval_for(protocol)} "
    reasons, said = [], []
    for found, form, unit in (
        (figure.score, ".3f", "mean score {}"),
        (figure.steps, ".1f", f"{{}} {words.steps}"),
    ):
        if found is None:
            continue
        text = unit.format(f"{found.mean:{form}}")
        reasons.append(why_no_interval(found))
        if reasons[-1] is None and found.interval is not None:
            text += f" ({kind}{found.interval[0]:{form}} to {found.interval[1]:{form}})"
            kind = ""
        said.append(text)
    if figure.score is None:
        reasons.append("No lowest score is declared: there is no mean score of everybody.")
    why = dict.fromkeys(reason for reason in reasons if reason)
    return " ".join([f"{who}: {', '.join(said)}.", *why])


def why_no_interval(estimate: Estimate) -> str | None:
    """Return the sentence that says why an estimate has no interval; None where it has one."""
    if estimate.players == 1:
        return "One player gives no interval."
    if estimate.interval is not None:
        return None
    if estimate.players < FEWEST:
        return f"Fewer than {FEWEST} players give no interval."
    return "Players who do not differ give no interval."


def metric_bounds(environment: Environment, config: Configuration, metric: MetricName) -> Interval:
    """Return the lowest and the highest mean that a player can have; steps lie in 1..limit."""
    return (1.0, float(config.limit)) if metric == "steps" else environment.bounds(config)


def worst_value(
    environment: Environment, config: Configuration, metric: MetricName
) -> float | None:
    """Return the worst value of an episode: the limit, the lowest score; None where no lowest score is declared."""
    if metric == "steps":
        return float(config.limit)
    lowest, _ = environment.bounds(config)
    return lowest if np.isfinite(lowest) else None


def _figure(
    data: StudyData, cohort: Cohort, name: str, rule: str, ids: Sequence[str], erased: int = 0
) -> StudyFigure:
    """Return the estimate of some of the cohort.

    erased  people who would be among them, had they not been erased
    """
    if not ids:
        return StudyFigure(name, rule, erased=erased)
    environment, config = data.protocol.environment, data.protocol.env_config
    drawn = data.protocol.terrains_drawn
    estimates: dict[str, Estimate] = {}
    ranges: dict[str, Interval | None] = {}
    for metric in METRICS:
        table, bounds = cohort.table(ids, metric), metric_bounds(environment, config, metric)
        worst = worst_value(environment, config, metric)
        if worst is None and name == EVERYBODY:
            continue
        estimates[metric] = estimate(table, bounds, worst, drawn)
        ranges[metric] = _range(player_means(table), bounds, erased)
    return StudyFigure(
        name,
        rule,
        players=len(ids),
        episodes=sum(len(cohort.ranked[person]) for person in ids),
        score=estimates.get("score"),
        steps=estimates["steps"],
        completed=estimate(cohort.table(ids, "completed"), (0.0, 1.0), 0.0, drawn),
        erased=erased,
        score_range=ranges.get("score"),
        steps_range=ranges["steps"],
    )


def _range(means: Floats, bounds: Interval, erased: int) -> Interval | None:
    """Return the mean had all the erased been at the low bound, and at the high one; None where that is unknown."""
    if not erased or not np.isfinite(bounds).all():
        return None
    people = len(means) + erased
    low, high = ((means.sum() + erased * bound) / people for bound in bounds)
    return float(low), float(high)


def _mean_and_interval(estimate: Estimate | None) -> MeanInterval | None:
    if estimate is None:
        return None
    low, high = estimate.interval or (None, None)
    return {"mean": estimate.mean, "low": low, "high": high}
