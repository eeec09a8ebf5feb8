"""A study's two estimates: of those who finished, and of everybody who began.

Operator and leaderboard show them too.
"""

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
    entry_condition,
    everybody_of,
    join_rule_texts,
    members,
    people_of,
    practice_verdicts,
    statuses,
)
from humanplay.report.statistics.formatting import counted
from humanplay.report.statistics.intervals import Estimate, Interval, estimate, player_means
from humanplay.study.data import StudyData
from humanplay.study.exclusion_rules import PER_PROTOCOL
from humanplay.study.flow import BEGAN, IN_EVERYBODY, Status
from humanplay.study.protocol import Protocol
from humanplay.task import Configuration, Environment
from marsexplorer.intervals import FEWEST, Floats

PER_PROTOCOL_NAME = "per protocol"
EVERYBODY_RULE = (
    "everybody who began a ranked episode, bots left out; instances that they gave up or did not end, or that a bot, a failure "
    "or a rule ended, count at the lowest score and the limit"
)

NO_HUMAN_SCORE = "No human has played this study: it has no human score."


@dataclass(frozen=True)
class StudyFigure:
    """The estimate of some of the players.

    Attributes:
        name: "per protocol", "everybody", or another exclusion set of the protocol.
        rule: Who enters, in words.
        score: None where nobody enters, and for everybody where no lowest score is declared.
        completed: Share of episodes that succeeded, 0..1, the mean over players.
        erased: People who are missing because they were erased.
        score_range, steps_range: Low and high mean had all of them been best or all worst; None
            for nobody erased, and where a bound is not known.
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

    Attributes:
        in_per_protocol, in_everybody: Whether they are in these estimates.
        as_played: Ranked terrains that enter the estimate for everybody as they were played.
        lowest: Those that enter at the lowest score, by reason (`exclusion_sets.LowestReason`).
    """

    status: str
    people: int
    in_per_protocol: bool
    in_everybody: bool
    as_played: int = 0
    lowest: dict[str, int] = field(default_factory=dict)


def study_figures(data: StudyData, cohort: Cohort, everybody: Everybody) -> tuple[StudyFigure, ...]:
    """The estimates: per protocol, of everybody, and of each other exclusion set."""
    protocol, arrivals = data.protocol, data.arrivals
    is_human = cohort.kind == "human"
    erased = (arrivals.erased_finishers, arrivals.erased_began) if is_human else (0, 0)
    rule = entry_condition(protocol.per_protocol)
    ids = members(cohort, protocol.per_protocol)
    began = members(everybody.cohort, {})
    figures = [
        _figure(data, cohort, PER_PROTOCOL_NAME, rule, ids, erased[0]),
        _figure(data, everybody.cohort, EVERYBODY, EVERYBODY_RULE, began, erased[1]),
    ]
    for name, rules in protocol.exclusion.items():
        if name != PER_PROTOCOL:
            ids = members(cohort, rules)
            figures.append(_figure(data, cohort, name, entry_condition(rules), ids))
    return tuple(figures)


def estimates_of(
    data: StudyData,
    cohort: Cohort,
    everybody: Everybody,
    finished: Sequence[str],
    began: Sequence[str],
) -> tuple[StudyFigure, StudyFigure]:
    """Both estimates of some people alone: of who finished, and of who began."""
    rule = entry_condition(data.protocol.per_protocol)
    return (
        _figure(data, cohort, PER_PROTOCOL_NAME, rule, finished),
        _figure(data, everybody.cohort, EVERYBODY, EVERYBODY_RULE, began),
    )


def status_rows(data: StudyData, cohort: Cohort, everybody: Everybody) -> tuple[StatusRow, ...]:
    """A row for each status that somebody has.

    People of whom only a count is stored are among them.
    """
    by_person = statuses(data, cohort)
    counts = Counter(by_person.values())
    if cohort.kind == "human":
        counts[Status.DECLINED] = data.arrivals.declined
        counts[Status.UNDECIDED] = data.arrivals.undecided
        counts[Status.UNFIT_DEVICE] = data.arrivals.unfit
        counts[Status.OVER_QUOTA] = data.arrivals.over_quota
        counts[Status.ERASED] = data.arrivals.erased
    rows = []
    for status in (status for status in Status if counts[status]):
        people = [person for person, theirs in by_person.items() if theirs is status]
        reasons = Counter(
            reason for person in people for reason in everybody.reasons.get(person, ())
        )
        as_played = reasons.pop(None, 0)
        rows.append(
            StatusRow(
                status=status.value,
                people=counts[status],
                in_per_protocol=status is Status.FINISHED,
                in_everybody=status in IN_EVERYBODY,
                as_played=as_played,
                lowest={reason.value: n for reason, n in sorted(reasons.items()) if reason},
            )
        )
    return tuple(rows)


def claim_of(data: StudyData) -> str:
    """What a closed study's estimate may be called, with its attestation level.

    It is the human level if every episode was supervised, or attested of people who came by a
    personal invitation or a recruitment platform's signed link. Anybody may come by an open link,
    and an unsigned participant ID may be made up.
    """
    level, recruitment = data.protocol.required_attestation, data.protocol.recruitment
    is_personal = recruitment == "invitation" or (recruitment, data.protocol.panel_links) == (
        "panel",
        "signed",
    )
    is_verified = level == "supervised" or (level == "attested" and is_personal)
    return f"{'Human level' if is_verified else 'Figure of unverified participants'} ({level})"


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
    """The people's estimates as they may be seen.

    They are per protocol, or of everybody if nobody has finished.

    Attributes:
        set: Which of the two.
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
    """The sentence with both estimates; of an open study, how many have finished."""
    if (study := data.protocol.dry_run_of) is not None:
        of_whom = _headline(data, per_protocol, everybody)
        return f"This is a dry run of {study}: nothing here is a figure of that study. {of_whom}"
    if not data.shows_people:
        return data.progress_sentence()
    return _headline(data, per_protocol, everybody)


def _headline(data: StudyData, per_protocol: StudyFigure, everybody: StudyFigure) -> str:
    protocol = data.protocol
    verdicts = practice_verdicts(data, people_of(data).people)
    passed = sum(verdicts.values())
    if not everybody.players:
        if not verdicts:
            return NO_HUMAN_SCORE
        people = counted(len(verdicts), "person", "people")
        return f"{passed} of {people} passed the practice, and nobody began a ranked episode: there is no human score."
    screens, of_one = [], ""
    who = f"passed the practice ({passed} of {len(verdicts)})"
    if protocol.practice is not None and protocol.practice.if_failed == "screen_out":
        screens.append(who)
    elif protocol.per_protocol.get("passed_practice"):
        of_one = f", of people who {who}"
    if protocol.attention_limit is not None:
        screens.append(_attentive(data, protocol.attention_limit))
    of_both = f", of people who {' and '.join(screens)}" if screens else ""
    finished = "Nobody finished as the protocol asks."
    if per_protocol.players:
        finished = f"Per protocol{of_one}: {figure_sentence(per_protocol, protocol)}"
    began = f"Everybody who began: {figure_sentence(everybody, protocol)}"
    return f"{claim_of(data)}{of_both}. {finished} {began}"


def _attentive(data: StudyData, limit: int) -> str:
    """What holds of whoever was not screened out by attention checks, and of how many."""
    counts = Counter(statuses(data, people_of(data)).values())
    began, screened = sum(counts[status] for status in BEGAN), counts[Status.FAILED_ATTENTION]
    rule = join_rule_texts({"max_missed_checks": limit})
    return f"{rule} before the ranked episodes ({began:,} began, {screened:,} screened out)"


def interval_for(protocol: Protocol) -> str:
    """Whom and what a study's intervals are for, in words."""
    terrains = "and other instances" if protocol.terrains_drawn else "on these instances"
    return f"other players {terrains}"


def figure_sentence(figure: StudyFigure, protocol: Protocol) -> str:
    """An estimate of at least one player as a sentence."""
    words = protocol.environment.about.words
    who = f"{counted(figure.players, 'player')}, {counted(figure.episodes, 'ranked episode')}"
    kind = "95 % interval "  # named at the first interval alone
    if not protocol.terrains_drawn:
        kind += f"for {interval_for(protocol)} "
    reasons, means = [], []
    for shown, form, unit in (
        (figure.score, ".3f", "mean score {}"),
        (figure.steps, ".1f", f"{{}} {words.steps}"),
    ):
        if shown is None:
            continue
        text = unit.format(f"{shown.mean:{form}}")
        reasons.append(why_no_interval(shown))
        if reasons[-1] is None and shown.interval is not None:
            text += f" ({kind}{shown.interval[0]:{form}} to {shown.interval[1]:{form}})"
            kind = ""
        means.append(text)
    if figure.score is None:
        reasons.append("No lowest score is declared: there is no mean score of everybody.")
    causes = dict.fromkeys(reason for reason in reasons if reason)
    return " ".join([f"{who}: {', '.join(means)}.", *causes])


def why_no_interval(estimate: Estimate) -> str | None:
    """The sentence that says why an estimate has no interval; None if it has one."""
    if estimate.players == 1:
        return "One player gives no interval."
    if estimate.interval is not None:
        return None
    if estimate.players < FEWEST:
        return f"Fewer than {FEWEST} players give no interval."
    return "Players who do not differ give no interval."


def metric_bounds(environment: Environment, config: Configuration, metric: MetricName) -> Interval:
    """The lowest and the highest mean that a player can have; steps lie in 1..limit."""
    return (1.0, float(config.limit)) if metric == "steps" else environment.bounds(config)


def worst_value(
    environment: Environment, config: Configuration, metric: MetricName
) -> float | None:
    """The worst value of an episode: the limit, or the lowest score.

    None if no lowest score is declared.
    """
    if metric == "steps":
        return float(config.limit)
    lowest, _ = environment.bounds(config)
    return lowest if np.isfinite(lowest) else None


def _figure(
    data: StudyData, cohort: Cohort, name: str, rule: str, ids: Sequence[str], erased: int = 0
) -> StudyFigure:
    """The estimate of some of the cohort.

    Args:
        erased: People who would be among them, had they not been erased.
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
    """The mean had all the erased been at the low bound, and at the high one.

    None if that is unknown.
    """
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
