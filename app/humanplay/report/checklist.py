"""The human-baseline reporting checklist of Wei et al. 2025, for one study.

Items and numbers are those of the checklist in appendix B of "Recommendations and Reporting
Checklist for Rigorous & Transparent Human Baselines in Model Evaluations" (arXiv 2506.13776);
`checklist.txt` has their answers. What only the authors know is said to be missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from statistics import geometric_mean
from typing import get_args

from humanplay.report.model import GroupReport, Item
from humanplay.report.statistics.exclusion_sets import ended_ranked, people_of
from humanplay.report.statistics.formatting import counted, utc
from humanplay.report.statistics.planning import (
    assumptions_in_words,
    metric_in_words,
    power_in_words,
)
from humanplay.report.statistics.study_figures import (
    figure_sentence,
    interval_for,
    why_no_interval,
)
from humanplay.study.data import StudyData
from humanplay.study.flow import Status
from humanplay.study.policy_episodes import tested_policies
from humanplay.study.practice import criterion
from humanplay.study.protocol import Protocol
from humanplay.study.questions import Item as AskedItem
from humanplay.task import Environment

CITATION = "Wei et al. 2025, arXiv 2506.13776, appendix B"
RECRUITMENT = {
    "invitation": "By single-use invitations that the operator gave out.",
    "panel": "Through a panel whose link names each participant.",
    "open": "By a link that anybody could open.",
}
"""How participants came, by the protocol's `recruitment`."""
UNSAID = "What people and agents see is not said in the environment's description."
TEST = "Test of the paired differences for {whom}, the inverse of the interval, adjusted by Holm's method."
TEST_OF_ARMS = (
    "Test of the differences between arms for {whom}, the inverse of the interval (Welch, Satterthwaite), adjusted by "
    "Holm's method over all pairs of arms."
)


def checklist(data: StudyData, people: GroupReport, policies: Sequence[str]) -> tuple[Item, ...]:
    """Every item of the checklist, in order.

    Args:
        people: The report of the study's people.
        policies: That they are compared with.
    """
    texts = _texts(data, people, policies)
    text = Path(__file__).with_name("checklist.txt").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    items = (_item(line, texts) for line in lines)
    if not data.protocol.declarations.unanswered():
        return tuple(items)
    detail = "The protocol leaves declarations empty; the authors must state it."
    undeclared = {"answer": "Missing", "detail": detail, "source": "missing"}
    return tuple(
        replace(item, **undeclared) if item.answer == "Declared" else item  # type: ignore[arg-type]
        for item in items
    )


def _item(line: str, texts: dict[str, object]) -> Item:
    number, source, *rest = (part.strip().format_map(texts) for part in line.split("|"))
    return Item(number, *rest, source)  # type: ignore[arg-type, call-arg]


def exposure(data: StudyData) -> str:
    """Who met which ranked terrains when, and so may have told others."""
    ranked = [trial for trial in data.trials if (trial.phase, trial.kind) == ("ranked", "human")]
    if not ranked:
        return "Nobody has begun a ranked episode."
    terrains = data.protocol.ranked
    met = "the same ranked instance"
    if terrains > 1:
        met = f"the same {counted(terrains, 'ranked instance')}, in orders that follow from the study's secret"
    dates = f"the first began {utc(min(trial.started_ms for trial in ranked))}"
    if ended := [trial.ended_ms for trial in ranked if trial.ended_ms is not None]:
        dates += f", the last ended {utc(max(ended))}"
    return f"Everybody met {met}; {dates}. Whether anybody told others of an instance is not known."


def _texts(data: StudyData, people: GroupReport, policies: Sequence[str]) -> dict[str, object]:
    """What `checklist.txt` has in braces."""
    protocol, words, players = data.protocol, people.words, people.figure.players
    ranked = ended_ranked(data, [person for person in data.people if person.kind == "human"])
    labelled = sum(bool(trial.labels) for trial in ranked)
    played = [figure for figure in people.figures if figure.players]
    sets = [f"{figure.name}: {figure_sentence(figure, protocol)}" for figure in played]
    erased, finishers = data.arrivals.erased, data.arrivals.erased_finishers
    lost = f" {counted(erased, 'more was', 'more were')} erased, {finishers} of whom had ended all ranked episodes."
    is_compared = bool(policies and players)
    nobody = "Nobody has played." if data.shows_people else "It is shown once the study is closed."
    no_policy = "No policy is compared with people."
    seconds = _human_time(data)
    estimates = [
        estimate
        for figure in (people.figure, people.everybody)
        for estimate in (figure.score, figure.steps)
    ]
    shown = [estimate for estimate in estimates if estimate]
    has_interval = any(estimate.interval for estimate in shown)
    of_means = [f"Of the means, for {interval_for(protocol)}."] if has_interval else []
    reasons = dict.fromkeys(filter(None, map(why_no_interval, shown)))
    return {
        "protocol": protocol,
        "people": people,
        "title": protocol.environment.about.title,
        "where": protocol.environment.texts(protocol.env_config).setting,
        "seen": protocol.environment.texts(protocol.env_config).observations or UNSAID,
        "played": counted(len(ranked), "episode"),
        "instances": counted(protocol.ranked, "instance"),
        "limit": counted(protocol.env_config.limit, "move"),
        "break_every": counted(protocol.break_every, "ranked episode"),
        "finished": counted(len(ranked), "finished ranked episode"),
        "samples": len(ranked) / protocol.ranked,
        **_power(data),
        "frozen_at": utc(data.frozen_ms),
        "hash": data.protocol_hash[:16],
        "recruitment": RECRUITMENT[protocol.recruitment],
        "questions": counted(protocol.question_count, "question"),
        **_language_texts(protocol, people),
        **_screening(protocol),
        "exposure": people.exposure,
        **_turned_away(data, people),
        **_answers(data, people),
        "length": protocol.warm_up + protocol.ranked,
        "excluded": people.started - players,
        "erased": lost if erased else "",
        "dry_runs": f" {data.arrivals.dry_runs_in_words()}".rstrip(),
        "labelled": counted(labelled, "carries a label", "carry a label"),
        "compared": "Yes" if is_compared else "No",
        "policies": ", ".join(policies) or "none played",
        "test": _test(protocol, is_compared, people),
        "equal": "Yes" if is_compared else "N/A",
        "metrics": f"{words.score[0].upper()}{words.score[1:]} and {words.steps} for both."
        if is_compared
        else no_policy,
        "scoring": "The same environment steps and scores both." if is_compared else no_policy,
        "grading": "By the environment; nobody grades." if is_compared else no_policy,
        "sets": "; ".join(sets) or nobody,
        "time": time_in_words(protocol.environment),
        "timed": "No" if seconds is None else "Yes",
        "seconds": seconds or ("No ranked episode succeeded." if ranked else nobody),
        "has_interval": "Yes" if has_interval else "No",
        "intervals": " ".join([*of_means, *reasons]) or nobody,
        "trained": "Yes" if protocol.warm_up else "Tutorial alone",
        "training": "Tutorial and practice" if protocol.warm_up else "Tutorial",
        "with_feedback": f" and {counted(protocol.warm_up, 'warm-up episode')} with feedback"
        if protocol.warm_up
        else "",
        "randomized": "Yes" if protocol.ranked > 1 else "N/A",
        "orders": "Orders are rows of a Latin square permuted by the study's secret."
        if protocol.ranked > 1
        else "There is one ranked instance.",
        "unfinished": people.joined - people.finished,
        "secret": "revealed when the study closes" if data.closed_ms is None else "revealed",
        "software": version("humanplay"),
    }


def _language_texts(protocol: Protocol, people: GroupReport) -> dict[str, str]:
    """In which languages people read the study, and who translated it."""
    sentences = []
    if len(protocol.languages) > 1 and people.languages:
        readers = [f"{count} read it in {name}" for name, count in people.languages.items()]
        sentences.append(f"Of the people who agreed to the study, {', '.join(readers)}.")
    if protocol.translated_by:
        sentences.append(f"Translated by: {protocol.translated_by}.")
        sentences.append(f"Checked by: {protocol.checked_by}.")
    return {
        "languages": ", ".join(protocol.languages),
        "languages_detail": " ".join(sentences) or "Everybody reads the study in this language.",
    }


def _screening(protocol: Protocol) -> dict[str, str]:
    """By what the study itself admits people to the ranked episodes."""
    tries, limit = protocol.question_tries, protocol.attention_limit
    sentences = [f"Participants read: “{text}”"] if (text := criterion(protocol)) else []
    if limit is not None:
        checks = counted(limit, "attention check")
        sentences.append(
            f"Whoever misses more than {checks} before the ranked episodes is screened out."
        )
    return {
        "attempts": "" if tries is None else f", in at most {counted(tries, 'attempt')}",
        "screening": "".join(f" {sentence}" for sentence in sentences),
    }


def _turned_away(data: StudyData, people: GroupReport) -> dict[str, object]:
    """Whom the study itself turned away before a ranked episode."""
    assert people.flow is not None
    came = people.flow.joined
    reasons = [
        (Status.UNFIT_DEVICE, "came with a device that does not fit"),
        (Status.OVER_QUOTA, "came when every place was taken"),
        (Status.DECLINED, "did not agree to the consent text"),
        (Status.FAILED_QUESTIONS, "failed the questions on the instructions"),
    ]
    practice = data.protocol.practice
    if practice is not None and practice.if_failed == "screen_out":
        reasons.append((Status.FAILED_PRACTICE, "failed the practice"))
    if data.protocol.attention_limit is not None:
        reasons.append((Status.FAILED_ATTENTION, "missed too many attention checks"))
    counts = [(people.flow.count(status), words) for status, words in reasons]
    listed = ", ".join(f"{count} {words}" for count, words in counts)
    return {
        "turned_away": sum(count for count, _ in counts),
        "people_came": came,
        "turned_away_detail": f"Of {counted(came, 'person', 'people')} who opened the study {listed}. "
        "Whom recruitment turned away before that is for the authors to state (2.3.1).",
    }


def _answers(data: StudyData, people: GroupReport) -> dict[str, str]:
    """What people answered, for the items that questions can fill."""
    counts = {item: _counts_for(data, people, item) for item in get_args(AskedItem)}
    is_sentence = data.protocol.declarations.demographics.rstrip().endswith((".", "!", "?"))
    end = "" if is_sentence else "."
    return {
        "demographics_answers": f"{end} {counts['demographics']}" if counts["demographics"] else "",
        "exposure_asked": "Asked" if counts["exposure"] else "Unknown",
        "exposure_answers": f" {counts['exposure']}".rstrip(),
        "tools_asked": "Asked" if counts["tools"] else "Unknown/Unreported",
        "tools_source": "database" if counts["tools"] else "software",
        "tools_answers": counts["tools"] or "What people used beside the page is not known.",
        "explanations_asked": "Yes" if counts["explanations"] else "No",
        "explanations_source": "database" if counts["explanations"] else "software",
        "explanations_answers": counts["explanations"] or "None are collected.",
    }


def _counts_for(data: StudyData, people: GroupReport, item: AskedItem) -> str:
    """The counts of the questions that fill an item; empty where none asks for it."""
    questions = [question for block in data.protocol.blocks for question in block.questions]
    names = {question.name for question in questions if question.tells == item}
    if names and not data.shows_people:
        return "How many gave which answer is shown once the study is closed."
    counts = [answers for answers in people.answers if answers.question in names]
    if names and not counts:
        return "Nobody has answered."
    return " ".join(f"“{answers.asked}” {answers.sentence()}." for answers in counts)


def time_in_words(environment: Environment) -> str:
    """Whether an episode waits for a move."""
    if environment.clock:
        return f"time runs at {environment.clock:g} frames a second"
    return "there is no clock"


def _human_time(data: StudyData) -> str | None:
    """How long a ranked episode took, in words; None without a success.

    As METR rates tasks: by its successes, in geometric mean.
    """
    ranked = [trial for trials in people_of(data).ranked.values() for trial in trials]
    times_s = [max(trial.active_ms, 1.0) / 1000 for trial in ranked if trial.succeeded]
    if not times_s:
        return None
    mean_s = geometric_mean(times_s)
    shown = f"{mean_s:.1f} seconds" if mean_s < 120 else f"{mean_s / 60:.1f} minutes"
    return (
        f"Geometric mean {shown} of the {len(times_s)} of {counted(len(ranked), 'ranked episode')} that succeeded, without "
        "pauses and time out of sight; arXiv 2503.14499 (C.1.4) rates tasks so. Failures are left out, so it is short where "
        "many failed."
    )


def _power(data: StudyData) -> dict[str, str]:
    """Whether the number of players was planned, as the protocol says."""
    protocol, planned = data.protocol, data.protocol.power
    if planned is None:
        missing = "The protocol holds no power: it was not computed when the study was frozen."
        return {
            "power": "Missing",
            "power_source": "missing",
            "power_details": missing,
            "effect": "None",
            "effect_details": "Nothing was planned to be seen.",
        }
    return {
        "power": "Yes",
        "power_source": "protocol",
        "power_details": f"{counted(protocol.players, 'player')}. {power_in_words(protocol)} {assumptions_in_words(protocol)}",
        "effect": "None" if planned.deciding_power is None else "Named",
        "effect_details": _effect(protocol),
    }


def _effect(protocol: Protocol) -> str:
    """The difference that the study was planned to see."""
    if protocol.primary_family == "arms":
        return f"{protocol.arm_difference:g} {metric_in_words(protocol)} between two arms, named before the study."
    if protocol.policy_difference is None:
        return "No policy is tested."
    return f"{protocol.policy_difference:g} {metric_in_words(protocol)}, named before the study."


def _test(protocol: Protocol, is_compared: bool, people: GroupReport) -> str:
    """How the family of tests was tested, if it was."""
    if any(row.p_value is not None for row in people.arm_comparisons):
        return TEST_OF_ARMS.format(whom=interval_for(protocol))
    if is_compared and tested_policies(protocol):
        return TEST.format(whom=interval_for(protocol))
    return "None."
