"""Cautions that a reader needs before using a figure, and deviations of a study from its protocol: a sentence each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from app.db.trial import Trial
from app.report import measured_coverage
from app.report.statistics.exclusion_sets import Cohort, ended_ranked
from app.report.statistics.formatting import counted, percent
from app.report.statistics.intervals import Estimate
from app.report.statistics.likelihood import TAIL
from app.series.data import StudyData
from app.series.files import iso
from app.series.policy_episodes import closed_seeds
from app.series.protocol import protocol_hash
from app.series.seeds import commitment
from app.task import Words

if TYPE_CHECKING:
    from app.report.model import GroupReport

LEAST_PLAYERS = 10
STRONG_SKEW = 1.0


def cautions(data: StudyData, group: GroupReport) -> tuple[str, ...]:
    """Return the cautions about a group's primary figure."""
    figure = group.figure
    if figure.score is None or figure.steps is None:
        return ()
    found = []
    if erased := data.arrivals.erased_after_closing:
        people = counted(erased, "person was", "people were")
        found.append(
            f"{people} erased after closing, when the figures were known, {data.arrivals.erased_finishers} of whom had ended "
            "all ranked episodes: "
            "no figure here holds them, so that it may not be the one that the study was closed with."
        )
    if figure.players < data.protocol.players:
        planned = counted(data.protocol.players, "player planned is", "players planned are")
        found.append(f"{figure.players} of the {planned} in the primary figure.")
    if figure.players < LEAST_PLAYERS:
        why = "their spread, and with it every interval, is poorly known"
        found.append(f"{counted(figure.players, 'player is', 'players are')} few: {why}.")
    found += _about_bounds(data)
    if group.kind == "human":
        found += _about_who_left(data, group)
        found += _about_secret(data)
        found += _about_exports(data)
    found += _about_skewness(figure.score, figure.steps, group.words)
    if figure.score.headline == "guaranteed":
        found.append(
            "Failures are a few players' here, so the guaranteed interval is the headline. Every comparison with policies, "
            "and its interval, rests on how many of these players the sample happens to hold; "
            f"so does learning. {group.no_p}"
        )
    found.append(_about_failures(group))
    known = [each.variance for each in group.metrics if each.variance]
    effect = max((each.design_effect for each in known), default=0)
    if effect > 1.5:
        resemblance = f"pooled as if independent, the variance would come out up to {effect:.1f} times too small"
        found.append(f"A player's episodes resemble each other: {resemblance}.")
    return tuple(found)


def _about_bounds(data: StudyData) -> Iterable[str]:
    """Yield that scores lie outside the bounds that their environment was said to have."""
    low, high = data.protocol.rules.bounds(data.protocol.env_config)
    scores = [each.score for each in ended_ranked(data, data.people) if each.score is not None]
    if outside := sum(not low <= each <= high for each in scores):
        yield (
            f"{counted(outside, 'ranked episode')} of {len(scores)} ended with a score outside the bounds that were declared, "
            f"{low:g} to {high:g}: intervals by bounds reach no further than what was seen."
        )


def _about_who_left(data: StudyData, group: GroupReport) -> Iterable[str]:
    """Yield who is not in the primary figure because they did not go on."""
    flow = group.flow
    if flow is None or not data.protocol.exclusion.get(group.primary, {}).get("completed"):
        return
    if left := flow.withdrew + flow.unfinished + flow.interrupted:
        did = "did not end all of them and"
        who = counted(left, f"{did} is not", f"{did} are not")
        yield (
            f"Of {counted(flow.ranked, 'person', 'people')} who began a ranked episode {who} in the "
            "primary figure: they may have left because it went badly. The row by intention to treat counts them."
        )


def _about_secret(data: StudyData) -> Iterable[str]:
    """Yield what may have been chosen with the secret, and so with the terrains."""
    beacon = data.beacon
    if beacon is None:
        yield (
            "No public beacon was named when the study was frozen: whoever froze it may have drawn one secret after another "
            "and kept the one whose terrains suited best."
        )
    elif not beacon.is_public:
        yield (
            "The beacon that was named when the study was frozen is not one that this software knows: whoever signs its rounds "
            "may have chosen the terrains."
        )
    if data.freezings > 1:
        yield (
            f"A study of this name was frozen {data.freezings} times, says the chain of its database: whoever froze it may "
            "have chosen among as many secrets and protocols."
        )


def _about_exports(data: StudyData) -> Iterable[str]:
    """Yield that somebody could see figures of people before the study was closed."""
    if data.exports_ms:
        days = sorted({iso(at_ms)[:10] for at_ms in data.exports_ms})
        yield (
            f"Its episodes were exported while it was open, on {', '.join(days)}: whoever read them knew figures of people "
            "when it was decided how long to go on."
        )


def _about_skewness(score: Estimate, steps: Estimate, words: Words) -> Iterable[str]:
    for name, estimate in (("score", score), (words.steps, steps)):
        if estimate.players > 1 and estimate.sd == 0:
            yield f"All players have the same mean {name}: the sample has no spread, so its interval says nothing."
        elif abs(estimate.skewness or 0.0) > STRONG_SKEW and estimate.widened:
            side = f"the {estimate.widened} end, which the t interval alone would put too near, was moved out"
            yield f"The players' means of {name} are skewed ({estimate.skewness:+.1f}): {side}."


def _about_failures(group: GroupReport) -> str:
    """Return what the sample does not show of failures that happened to few players or to none."""
    inside = [player for player in group.players if player.in_primary]
    bad = sum(player.failed > 0 for player in inside)
    unseen = 1 - TAIL ** (1 / len(inside))
    seen = f"{bad or 'none'} of {counted(len(inside), 'player')} had episodes that ended {group.words.short}"
    cells = measured_coverage.nearest(len(inside))
    worst = min(cells, key=lambda cell: cell.steps)
    held = [cell.steps for cell in cells if cell.population in measured_coverage.ONE_SHAPE]
    return (
        f"In this sample {seen}. A kind of player that nobody here belongs to may still be up to {percent(unseen)} of the "
        "population, and no interval made from these players' spread can know of it. In simulation with "
        f"{counted(worst.players, 'player')} the interval of steps covered the truth in {min(held):.0f} to "
        f"{max(held):.0f} % of studies in which everybody's scores had one shape, but in only "
        f"{worst.steps:.0f} % where {_described(worst)}."
    )


def _described(cell: measured_coverage.Cell) -> str:
    rates = {each.name: each.collisions for each in measured_coverage.SCORE_POPULATIONS}
    rate = rates[cell.population]
    return f"{percent(rate)} of episodes collide and nearly all collisions are a few players' (ICC {cell.icc:g})"


SCRIPTED = "had a move made by a script: begun by a person, such an episode counts as abandoned, else in no figure"
SPOILT = (
    "was spoilt by a move that fits no press, after one that did; it counts as abandoned",
    "were spoilt by a move that fits no press, after one that did; each counts as abandoned",
)


def deviations(data: StudyData, cohort: Cohort) -> tuple[str, ...]:
    """Return how a cohort's episodes deviated from the protocol."""
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
            "was not on the terrain that the secret gives",
            "were not on the terrain that the secret gives",
        ): lambda trial: data.secret is not None and trial.seed != seeds.get(trial.terrain_index),
    }
    found = []
    for ending, is_one in kinds.items():
        trials = [trial for trial in ranked if is_one(trial)]
        if trials:
            one, many = (ending, ending) if isinstance(ending, str) else ending
            people = counted(len({trial.participant for trial in trials}), "participant")
            words = f"ranked episode of {people} {one}", f"ranked episodes of {people} {many}"
            found.append(f"{counted(len(trials), *words)}.")
    events = [event for person in cohort.people for event in person.events]
    noted = Counter(detail["sentence"] for _, kind, detail in events if kind == "deviation")
    for sentence, count in noted.items():
        found.append(sentence if count == 1 else f"{sentence} (noted {count} times)")
    return tuple(found)


def study_deviations(data: StudyData) -> tuple[str, ...]:
    """Return how the study as a whole deviated from what was frozen."""
    found = []
    if protocol_hash(data.protocol) != data.protocol_hash:
        found.append("The protocol in the database is not the one whose hash was frozen.")
    if data.secret and commitment(bytes.fromhex(data.secret)) != data.commitment:
        found.append("The revealed secret is not the one that was committed to.")
    signature = data.beacon_signature
    if data.beacon and not (signature and data.beacon.has_signed(signature)):
        which = "of the round that was named when the study was frozen"
        found.append(f"The beacon's signature is not {which}.")
    version = data.protocol.rules.version
    if data.protocol.core_version != version:
        found.append(
            f"The protocol is for core version {data.protocol.core_version}; this report was made by version {version}."
        )
    early = [person for person in data.people if person.joined_ms < data.frozen_ms]
    if early:
        found.append(f"{counted(len(early), 'participant')} joined before the protocol was frozen.")
    finished = sum(each.kind == "human" and each.completed_ms is not None for each in data.people)
    if data.closed_ms is not None and finished != data.protocol.players:
        found.append(
            f"{counted(finished, 'person', 'people')} finished, {counted(data.protocol.players, 'was', 'were')} planned."
        )
    return tuple(found)
