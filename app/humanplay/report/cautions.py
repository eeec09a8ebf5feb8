"""Cautions that a reader needs, and deviations of a study from its protocol.

Each is a sentence.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from humanplay.db.trial import Trial
from humanplay.report.statistics.exclusion_sets import (
    METRICS,
    Cohort,
    ended_ranked,
    everybody_of,
    is_flagged_throughout,
    members,
    people_of,
)
from humanplay.report.statistics.formatting import counted
from humanplay.report.statistics.study_figures import StudyFigure
from humanplay.study.data import StudyData
from humanplay.study.files import iso
from humanplay.study.flow import EARLY, STATUS_IN_WORDS, Status
from humanplay.study.policy_episodes import closed_seeds
from humanplay.study.protocol import protocol_hash
from humanplay.study.seeds import commitment
from humanplay.task import Words
from marsexplorer.intervals import FEWEST

if TYPE_CHECKING:
    from humanplay.report.model import GroupReport

LEAST_PLAYERS = 10
MOST_IN_NEITHER = 1 / 5
"""Largest share of those who agreed that may be in neither estimate without a caution."""


def cautions(data: StudyData, group: GroupReport) -> tuple[str, ...]:
    """The cautions that this study earned about a group's estimates."""
    figure = group.figure
    if not group.everybody.players:
        return ()
    sentences = []
    are = "is" if figure.players == 1 else "are"
    if figure.players < data.protocol.players:
        planned = counted(data.protocol.players, "player")
        sentences.append(
            f"{figure.players} of the {planned} planned {are} in the per-protocol estimate."
        )
    if 0 < figure.players < LEAST_PLAYERS:
        sentences.append(
            f"{counted(figure.players, 'player')} {are} few: their spread, and with it every interval, is poorly known."
        )
    sentences += _about_bounds(data)
    sentences += _about_shared_terrains(data, group)
    sentences += _about_who_is_missing(group)
    if group.kind == "human":
        sentences += _about_erased(data, group)
        sentences += _about_neither(group)
        sentences += _about_flagged(data, group)
        sentences += _about_freezings(data)
        sentences += _about_other_studies(data)
        sentences += _about_exports(data)
    return tuple(sentences)


def _players(group: GroupReport, number: int) -> str:
    """Count the members of a group: people, or simulated players."""
    return counted(number, *(("person", "people") if group.kind == "human" else ("player",)))


def _about_shared_terrains(data: StudyData, group: GroupReport) -> Iterable[str]:
    """Yield why policies are not tested if too few terrains were shared."""
    shared = min((row.terrains for row in group.comparisons), default=FEWEST)
    if data.protocol.terrains_drawn and shared < FEWEST:
        players = "people" if group.kind == "human" else "simulated players"
        yield (
            f"{counted(shared, 'instance')} {'was' if shared == 1 else 'were'} played by {players} and by every policy; a "
            f"claim about other instances needs {FEWEST}: no difference has an interval or a p."
        )


def _about_who_is_missing(group: GroupReport) -> Iterable[str]:
    """Yield who began and is in the estimate for everybody alone, with both means."""
    finished, everybody = group.figure, group.everybody
    if not (missing := everybody.players - finished.players):
        return
    reasons = ", ".join(
        f"{STATUS_IN_WORDS[Status(row.status)]}: {row.people}"
        for row in group.statuses
        if row.in_everybody and not row.in_per_protocol
    )
    are = "is" if missing == 1 else "are"
    yield (
        f"{missing} of {_players(group, everybody.players)} who began a ranked episode {are} not in the "
        f"per-protocol estimate ({reasons}): {_means(finished, group.words)} per protocol, {_means(everybody, group.words)} of "
        "everybody."
    )


def _means(figure: StudyFigure, words: Words) -> str:
    """The means of an estimate in words."""
    means = []
    if figure.score is not None:
        means.append(f"mean score {figure.score.mean:.3f}")
    if figure.steps is not None:
        means.append(f"{figure.steps.mean:.1f} {words.steps}")
    return ", ".join(means) or "nobody"


def _about_erased(data: StudyData, group: GroupReport) -> Iterable[str]:
    """Yield who was erased, and what the means could be with them."""
    arrivals = data.arrivals
    if not arrivals.erased_began:
        return
    were = "was" if arrivals.erased_began == 1 else "were"
    people = counted(arrivals.erased_began, "person", "people")
    asked = ", ".join(f"{who} {count}" for who, count in arrivals.erased_asked_by.items())
    yield (
        f"{people} who had begun a ranked episode {were} erased; {arrivals.erased_finishers} of them had ended all. Of all "
        f"erased, {arrivals.erased_after_closing} went after closing, when the estimates were known; asked for by: "
        f"{asked or 'not said'}. {_ranges(group)}"
    )


def _ranges(group: GroupReport) -> str:
    """The means without the erased, and as if all had been best or worst."""
    ranges = []
    for figure in (group.figure, group.everybody):
        for mean, ends, form, name in (
            (figure.score, figure.score_range, ".3f", "mean score"),
            (figure.steps, figure.steps_range, ".1f", f"mean {group.words.steps}"),
        ):
            if mean is not None and ends is not None:
                low, high = (f"{end:{form}}" for end in ends)
                ranges.append(
                    f"{figure.name}, {name}: {mean.mean:{form}} without them, {low} to {high} had all been best or all worst"
                )
    return f"{'; '.join(ranges)}." if ranges else "What the means would be with them is not known."


def _about_neither(group: GroupReport) -> Iterable[str]:
    """Yield that many of those who agreed are in neither estimate."""
    if group.flow is None:
        return
    agreed, neither = group.flow.agreed, group.flow.count(Status.BOT, *EARLY)
    if neither > MOST_IN_NEITHER * agreed:
        are = "is" if neither == 1 else "are"
        early = {STATUS_IN_WORDS[status]: group.flow.count(status) for status in EARLY}
        reasons = ", ".join(f"{words}: {count}" for words, count in early.items() if count)
        yield (
            f"{neither} of {counted(agreed, 'person', 'people')} who agreed {are} in neither estimate: "
            f"{group.flow.count(*EARLY)} began no ranked episode{f' ({reasons})' if reasons else ''}, "
            f"{group.flow.count(Status.BOT)} played as bots throughout."
        )


def _about_flagged(data: StudyData, group: GroupReport) -> Iterable[str]:
    """Yield how much people whose every episode is flagged move an estimate.

    Only if they move the estimate for everybody by more than half its interval.
    """
    people = people_of(data)
    everybody = everybody_of(data, people).cohort
    began = members(everybody, {})
    flagged = [person for person in began if is_flagged_throughout(people, person)]
    rest = [person for person in began if person not in flagged]
    means = []
    for name, metric, form, estimate in (
        ("mean score", METRICS[0], ".3f", group.everybody.score),
        (f"mean {group.words.steps}", METRICS[1], ".1f", group.everybody.steps),
    ):
        if not (flagged and rest and estimate is not None and estimate.interval is not None):
            continue
        without = float(everybody.table(rest, metric).mean())
        low, high = estimate.interval
        if abs(estimate.mean - without) > (high - low) / 2:
            means.append(f"{name} {estimate.mean:{form}} with them, {without:{form}} without")
    if means:
        have, are = ("has", "is") if len(flagged) == 1 else ("have", "are")
        yield (
            f"{counted(len(flagged), 'person', 'people')} {have} a data-quality flag on every ranked episode and {are} "
            f"in the estimate for everybody alone, which they move by more than half its interval: {'; '.join(means)}."
        )


def _about_bounds(data: StudyData) -> Iterable[str]:
    """Yield that scores lie outside the bounds that their environment declares."""
    low, high = data.protocol.environment.bounds(data.protocol.env_config)
    scores = [trial.score for trial in ended_ranked(data, data.people) if trial.score is not None]
    if outside := sum(not low <= score <= high for score in scores):
        yield (
            f"{counted(outside, 'ranked episode')} of {len(scores)} ended with a score outside the bounds that were declared, "
            f"{low:g} to {high:g}: what counts at the lowest score may be too good."
        )


def _about_freezings(data: StudyData) -> Iterable[str]:
    """Yield that a study of this name was frozen before.

    Its terrains may have been chosen, then.
    """
    if data.freezings > 1:
        yield (
            f"A study of this name was frozen {data.freezings} times, says the chain of its database: whoever froze it may "
            "have chosen among as many secrets and protocols."
        )


def _about_other_studies(data: StudyData) -> Iterable[str]:
    """Yield which other studies could have been reported in this one's place."""
    others = data.same_configuration
    if others and data.protocol.dry_run_of is None:
        named = ", ".join(f"{name} on {iso(frozen_ms)[:10]}" for name, frozen_ms in others)
        which = counted(len(others), "other study", "other studies")
        were = "was" if len(others) == 1 else "were"
        yield (
            f"{which} of this configuration {were} frozen, says the chain of its database: {named}. Which one is reported may "
            "have been chosen by its result. Studies of other databases cannot be seen."
        )


def _about_exports(data: StudyData) -> Iterable[str]:
    """Yield that somebody could see people's results before the study was closed."""
    if data.exports_ms:
        days = sorted({iso(at_ms)[:10] for at_ms in data.exports_ms})
        yield (
            f"Its episodes were exported while it was open, on {', '.join(days)}: whoever read them knew figures of people "
            "when it was decided how long to go on."
        )
    if listed := data.amounts_listed:
        people = sorted({listing.people for listing in listed})
        persons = "person" if people == [1] else "people"
        yield (
            f"The operator was shown amounts that follow from scores {counted(len(listed), 'time')} while it was open, after "
            f"{', '.join(map(str, people))} {persons} had finished: amounts that are paid at once tell how people did."
        )


SCRIPTED = "had a move made by a script: begun by a person, such an episode counts per protocol as abandoned"
SPOILT = (
    "was spoilt by a move that fits no press, after one that did; per protocol it counts as abandoned",
    "were spoilt by a move that fits no press, after one that did; per protocol each counts as abandoned",
)


def deviations(data: StudyData, cohort: Cohort) -> tuple[str, ...]:
    """How a cohort's episodes deviated from the protocol, a sentence each."""
    ranked = ended_ranked(data, cohort.people)
    config, version = data.protocol.env_config.hash, data.protocol.core_version
    seeds = closed_seeds(data)
    kinds: dict[str | tuple[str, str], Callable[[Trial], bool]] = {
        SCRIPTED: lambda trial: cohort.kind == "human" and trial.driver != "human",
        "ran on another configuration than the protocol's": lambda trial: (
            trial.config_hash != config
        ),
        f"ran on another core version than {version}": lambda trial: trial.core_version != version,
        (
            "was given up; it counts with its penalty and as max_steps",
            "were given up; each counts with its penalty and as max_steps",
        ): lambda trial: trial.outcome == "abandoned",
        SPOILT: lambda trial: trial.attestation == "spoilt",
        (
            "carries a label of implausible input",
            "carry a label of implausible input",
        ): lambda trial: bool(trial.labels),
        (
            "was not on the instance that the secret gives",
            "were not on the instance that the secret gives",
        ): lambda trial: data.secret is not None and trial.seed != seeds.get(trial.terrain_index),
    }
    sentences = []
    for ending, is_one in kinds.items():
        trials = [trial for trial in ranked if is_one(trial)]
        if trials:
            one, many = (ending, ending) if isinstance(ending, str) else ending
            people = counted(len({trial.participant for trial in trials}), "participant")
            words = f"ranked episode of {people} {one}", f"ranked episodes of {people} {many}"
            sentences.append(f"{counted(len(trials), *words)}.")
    events = [event for person in cohort.people for event in person.events]
    noted = Counter(str(event.detail["sentence"]) for event in events if event.kind == "deviation")
    for sentence, count in noted.items():
        sentences.append(sentence if count == 1 else f"{sentence} (noted {count} times)")
    return tuple(sentences)


def study_deviations(data: StudyData) -> tuple[str, ...]:
    """How the study as a whole deviated from what was frozen, a sentence each."""
    sentences = []
    if protocol_hash(data.protocol) != data.protocol_hash:
        sentences.append("The protocol in the database is not the one whose hash was frozen.")
    if data.secret and commitment(bytes.fromhex(data.secret)) != data.commitment:
        sentences.append("The revealed secret is not the one that was committed to.")
    version = data.protocol.environment.version
    if data.protocol.core_version != version:
        sentences.append(
            f"The protocol is for core version {data.protocol.core_version}; this report was made by version {version}."
        )
    early = [person for person in data.people if person.joined_ms < data.frozen_ms]
    if early:
        sentences.append(
            f"{counted(len(early), 'participant')} joined before the protocol was frozen."
        )
    by_operator = sum(person.arm_assigned_by == "operator" for person in data.people)
    if by_operator:
        were = counted(by_operator, "person was", "people were")
        sentences.append(
            f"{were} assigned to an arm by the operator, with the invitation, and not by chance."
        )
    finished = sum(
        person.kind == "human" and person.completed_ms is not None for person in data.people
    )
    if data.closed_ms is not None and finished != data.protocol.players:
        sentences.append(
            f"{counted(finished, 'person', 'people')} finished, {counted(data.protocol.players, 'was', 'were')} planned."
        )
    return tuple(sentences)
