"""What a study can see before it is frozen: the power of simulated studies.

The studies go through the report's own functions. The figures follow from the protocol's
assumptions, in its primary metric. A participant's episode has the value mean + participant + rest
(normal, with the assumed standard deviations), cut off at the metric's bounds. An episode fails
with the assumed share, and then has the worst value. People begin until the planned number has
finished; each leaves with the assumed share, after a number of ranked episodes of which each is as
likely, and the others have the worst value. A policy's value on a terrain is the policy's mean plus
a normal deviation (the assumed standard deviation of terrains), cut off likewise. One policy
differs by the planned difference from the mean of those who finish, the others of the family do
not. Whether the difference is seen is asked of `policy_differs`, and within a family of `policy_p` and
`holm`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from humanplay.jobs import Progress
from humanplay.report.statistics.arm_comparisons import arm_p
from humanplay.report.statistics.comparisons import holm, policy_differs, policy_p
from humanplay.report.statistics.exclusion_sets import members, people_of, statuses
from humanplay.report.statistics.intervals import Interval, interval
from humanplay.report.statistics.spread import variance_components
from humanplay.report.statistics.study_figures import metric_bounds, worst_value
from humanplay.study.data import StudyData
from humanplay.study.flow import Status
from humanplay.study.policy_episodes import tested_policies
from humanplay.study.protocol import Protocol
from humanplay.study.protocol_parts import Power
from humanplay.task import counted
from marsexplorer.intervals import CONFIDENCE, FEWEST, Floats

WANTED_POWER = 0.8
"""What a new study's difference is derived for."""
POSSIBLE_POWER = 0.6
"""That instead, where people who leave keep every difference from being seen so often."""
LEAST_POWER = 0.5
"""A study below it is refused: it would more likely miss than see what it is planned to see."""
WHILE_TYPING, AT_FREEZING, IN_A_SEARCH = 2_000, 10_000, 500
"""Simulated studies behind a power that is printed, behind one that is frozen, and at each step of
a search."""
MOST_PARTICIPANTS = 200
"""Up to which the fewest participants are sought."""
SEED = 20_211
"""Of the simulated studies: the same protocol has the same power on every machine."""
CELLS_AT_ONCE = 1_000_000
"""Episodes simulated at a time."""


@dataclass(frozen=True)
class StudyDesign:
    """What a study's power follows from, in the primary metric.

    mean          of people's episodes that do not fail
    player_sd     between people
    terrain_sd    of terrains, of policy minus people
    episode_sd    of the rest
    failed_share  of episodes that fail, 0..1
    leaver_share  of people who begin and leave, 0..1
    bounds        of an episode's value
    worst         the value of a failed episode; None where no lowest is declared: none fails,
                  nobody leaves
    policies      in the family that is tested
    """

    participants: int
    terrains: int
    mean: float
    player_sd: float
    terrain_sd: float
    episode_sd: float
    failed_share: float
    leaver_share: float
    bounds: Interval
    worst: float | None
    policies: int
    higher_is_better: bool = False
    terrains_drawn: bool = True

    @property
    def is_tested(self) -> bool:
        """Whether people and terrains are enough for an interval and a p."""
        has_terrains = self.terrains >= FEWEST or not self.terrains_drawn
        return self.participants >= FEWEST and has_terrains

    @property
    def finishers_mean(self) -> float:
        """The expected mean of those who finish, with what fails and what is cut off."""
        spread = float(np.hypot(self.player_sd, self.episode_sd))
        mean = _mean_within(self.mean, spread, self.bounds)
        if self.worst is None:
            return mean
        return self.failed_share * self.worst + (1 - self.failed_share) * mean


def design_of(protocol: Protocol) -> StudyDesign:
    """The design of a protocol that names each assumption."""
    environment, config, metric = protocol.environment, protocol.env_config, protocol.primary_metric
    mean, player_sd = protocol.assumed_mean, protocol.assumed_player_sd
    terrain_sd, episode_sd = protocol.assumed_terrain_sd, protocol.assumed_episode_sd
    if mean is None or player_sd is None or terrain_sd is None or episode_sd is None:
        names = "assumed_mean, assumed_player_sd, assumed_terrain_sd and assumed_episode_sd"
        raise ValueError(f"power is computed from {names}: write each into protocol.toml")
    return StudyDesign(
        participants=protocol.players,
        terrains=protocol.ranked,
        mean=mean,
        player_sd=player_sd,
        terrain_sd=terrain_sd,
        episode_sd=episode_sd,
        failed_share=protocol.assumed_failed_share,
        leaver_share=protocol.assumed_leaver_share,
        bounds=metric_bounds(environment, config, metric),
        worst=worst_value(environment, config, metric),
        policies=len(tested_policies(protocol)),
        higher_is_better=metric == "score",
        terrains_drawn=protocol.terrains_drawn,
    )


@dataclass(frozen=True)
class _Studies:
    """Simulated studies in which as many people left.

    Attributes:
        finished: float64[studies, participants, terrains].
        everybody: The same with those who left; None without a lowest value.
        terrains: Deviations of the policies, float64[studies, policies, terrains].
    """

    finished: Floats
    everybody: Floats | None
    terrains: Floats

    def chosen(self, studies: NDArray[np.bool_]) -> _Studies:
        """Some of the studies."""
        everybody = None if self.everybody is None else self.everybody[studies]
        return _Studies(self.finished[studies], everybody, self.terrains[studies])


def _simulated(design: StudyDesign, studies: int, seed: int) -> Iterator[_Studies]:
    """Yield simulated studies, some at a time."""
    size = max(1, CELLS_AT_ONCE // (design.participants * design.terrains))
    for first in range(0, studies, size):
        rng = np.random.default_rng([seed, first])
        count = min(size, studies - first)
        finished = _played(design, count, design.participants, rng)
        shape = count, max(1, design.policies), design.terrains
        terrains = design.terrain_sd * rng.standard_normal(shape)
        if design.worst is None:
            yield _Studies(finished, None, terrains)
            continue
        # recruitment ends with the last one who finishes
        leavers = rng.negative_binomial(design.participants, 1 - design.leaver_share, count)
        for number in np.unique(leavers):
            those = leavers == number
            left = _left(design, design.worst, (int(those.sum()), int(number)), rng)
            everybody = np.concatenate([finished[those], left], axis=1)
            yield _Studies(finished[those], everybody, terrains[those])


def _played(
    design: StudyDesign, studies: int, participants: int, rng: np.random.Generator
) -> Floats:
    """Draw episodes played to their end: float64[studies, participants, terrains]."""
    shape = studies, participants, design.terrains
    people = design.player_sd * rng.standard_normal((*shape[:2], 1))
    values = design.mean + people + design.episode_sd * rng.standard_normal(shape)
    values = np.clip(values, *design.bounds)
    if design.worst is None:
        return values
    return np.where(rng.random(shape) < design.failed_share, design.worst, values)


def _left(
    design: StudyDesign, worst: float, shape: tuple[int, int], rng: np.random.Generator
) -> Floats:
    """Draw people who leave, each on terrains in an order of their own.

    Args:
        shape: (studies, participants).
    """
    studies, participants = shape
    values = _played(design, studies, participants, rng)
    order = rng.permuted(np.broadcast_to(np.arange(design.terrains), values.shape), axis=-1)
    ended = rng.integers(0, design.terrains, (studies, participants, 1))
    return np.where(order < ended, values, worst)


def simulate_power(
    design: StudyDesign,
    difference: float,
    studies: int = WHILE_TYPING,
    seed: int = SEED,
    advance: Progress | None = None,
) -> tuple[float, float]:
    """The power of a study to see a policy that differs by `difference`.

    Returns:
        The shares of studies that see it if it is better, and if it is worse.
    """
    if not design.is_tested:
        return 0.0, 0.0
    better = difference if design.higher_is_better else -difference
    seen, done = np.zeros(2), 0
    for some in _simulated(design, studies, seed):
        seen += [_seen(design, some, effect) for effect in (better, -better)]
        done += len(some.finished)
        if advance:
            advance(done, studies)
    return float(seen[0] / studies), float(seen[1] / studies)


def _seen(design: StudyDesign, some: _Studies, effect: float) -> int:
    """Count the studies that see the first policy's effect, on the side where it is."""
    values = _policy_values(design, some, 0, effect)
    differs = policy_differs(
        some.finished, some.everybody, values, design.worst, design.terrains_drawn
    )
    p_values = np.ones((len(some.finished), design.policies))
    p_values[differs, 0] = 0.0
    # only Holm's answer within a family rests on the p itself
    if design.policies > 1 and differs.any():
        p_values[differs, 0] = _p_of(design, some.chosen(differs), 0, effect)
        # and on the others only in between
        is_open = differs & (design.policies * p_values[:, 0] >= 1 - CONFIDENCE)
        if is_open.any():
            those = some.chosen(is_open)
            for policy in range(1, design.policies):
                p_values[is_open, policy] = _p_of(design, those, policy, 0.0)
    ahead = values.mean(-1) - some.finished.mean((-2, -1))
    is_seen = (holm(p_values)[:, 0] < 1 - CONFIDENCE) & (np.sign(ahead) == np.sign(effect))
    return int(is_seen.sum())


def _policy_values(design: StudyDesign, some: _Studies, policy: int, effect: float) -> Floats:
    mean = design.finishers_mean + effect
    return np.clip(mean + some.terrains[:, policy], *design.bounds)


def _p_of(design: StudyDesign, some: _Studies, policy: int, effect: float) -> Floats:
    values = _policy_values(design, some, policy, effect)
    return policy_p(some.finished, some.everybody, values, design.worst, design.terrains_drawn)


def simulate_half_width(design: StudyDesign, studies: int = IN_A_SEARCH) -> float | None:
    """The mean half-width of the 95 % interval of those who finish.

    Terrains lie as far apart for people as `terrain_sd` says. None if there is no interval.
    """
    if not design.is_tested:
        return None
    widths = []
    for some in _simulated(replace(design, leaver_share=0.0), studies, SEED):
        table = some.finished + some.terrains[:, :1]
        low, high = interval(table, design.worst, design.terrains_drawn)
        widths.append((high - low) / 2)
    return float(np.concatenate(widths).mean())


def simulate_arm_power(
    design: StudyDesign, arms: int, difference: float, studies: int = WHILE_TYPING
) -> float:
    """The share of studies that tell two arms apart which differ by `difference`.

    The one that is ahead has the assumed mean, and no terrain favours an arm. In each arm its share
    of the people finishes, and people leave as in any study.
    """
    people = design.participants // arms
    if not _of_one_arm(design, arms).is_tested:
        return 0.0
    behind = design.mean + (-difference if design.higher_is_better else difference)
    designs = design, replace(design, mean=behind)
    share = 0.0 if design.worst is None else design.leaver_share
    size = max(1, CELLS_AT_ONCE // (2 * people * design.terrains))
    seen = 0
    for first in range(0, studies, size):
        rng = np.random.default_rng([SEED, first])
        drawn = rng.negative_binomial(people, 1 - share, (min(size, studies - first), 2))
        for leavers, count in zip(*np.unique(drawn, axis=0, return_counts=True), strict=True):
            one, other = (_played(arm, int(count), people, rng) for arm in designs)
            everybody = None
            if design.worst is not None:
                left, left_there = (
                    _left(arm, design.worst, (int(count), int(number)), rng)
                    for arm, number in zip(designs, leavers, strict=True)
                )
                everybody = np.concatenate([one, left], 1), np.concatenate([other, left_there], 1)
            p_values = arm_p((one, other), everybody, design.terrains_drawn)
            ahead = one.mean((-2, -1)) - other.mean((-2, -1))
            # the smallest p of a family is multiplied by the number of its tests
            is_seen = p_values * (arms * (arms - 1) // 2) < 1 - CONFIDENCE
            seen += int((is_seen & (np.sign(ahead) == np.sign(design.mean - behind))).sum())
    return seen / studies


def _of_one_arm(design: StudyDesign, arms: int) -> StudyDesign:
    return replace(design, participants=design.participants // arms)


def arms_are_tested(protocol: Protocol) -> bool:
    """Whether people of an arm, and terrains, are enough for an interval and a p."""
    return _of_one_arm(design_of(protocol), len(protocol.arms)).is_tested


def power_of(
    protocol: Protocol, studies: int = WHILE_TYPING, advance: Progress | None = None
) -> Power:
    """What a protocol can see.

    It must name each assumption and, if it tests policies, the difference.
    """
    design = design_of(protocol)
    half_width = simulate_half_width(design)
    if protocol.primary_family == "arms" and protocol.arm_difference is not None:
        arms = len(protocol.arms)
        share = simulate_arm_power(design, arms, protocol.arm_difference, studies)
        return Power(arms_differ=share, half_width=half_width, studies=studies)
    if not design.policies or protocol.policy_difference is None:
        return Power(half_width=half_width, studies=studies)
    better, worse = simulate_power(design, protocol.policy_difference, studies, advance=advance)
    return Power(policy_better=better, people_better=worse, half_width=half_width, studies=studies)


def fewest_participants(design: StudyDesign, difference: float) -> int | None:
    """About the fewest participants who see the difference in 80 % of studies.

    None if more than 200 are needed.
    """

    def is_enough(participants: int) -> bool:
        power = simulate_power(replace(design, participants=participants), difference, IN_A_SEARCH)
        return min(power) >= WANTED_POWER

    return _smallest(is_enough, FEWEST, MOST_PARTICIPANTS)


def least_difference(design: StudyDesign, power: float = WANTED_POWER) -> float | None:
    """About the smallest difference that is seen with this power; None where none is.

    In whole steps, or in a tenth of the leading digit of the participants' standard deviation.
    """
    if not design.is_tested:
        return None
    unit = 10.0 ** np.floor(np.log10(design.player_sd) - 1) if design.higher_is_better else 1.0
    lowest, highest = design.bounds
    widest = 100 * (design.player_sd + design.episode_sd + design.terrain_sd)
    most = min(widest, highest - design.finishers_mean, design.finishers_mean - lowest)

    def is_enough(units: int) -> bool:
        return min(simulate_power(design, unit * units, IN_A_SEARCH)) >= power

    units = _smallest(is_enough, 1, int(most / unit))
    return None if units is None else float(round(unit * units, 9))


def metric_in_words(protocol: Protocol) -> str:
    """The primary metric, as the task calls it."""
    words = protocol.environment.about.words
    return words.score if protocol.primary_metric == "score" else words.steps


def _or_instances(protocol: Protocol) -> str:
    return "" if protocol.fixed_terrains else " or five instances"


def power_in_words(protocol: Protocol) -> str:
    """What the protocol's power says, whole sentences."""
    power, metric = protocol.power, metric_in_words(protocol)
    assert power is not None
    sentences = []
    if power.arms_differ is not None and not arms_are_tested(protocol):
        sentences.append(
            f"No interval and no p is given below five people in an arm{_or_instances(protocol)}, so no difference is seen."
        )
    elif power.arms_differ is not None:
        people = counted(protocol.players // len(protocol.arms), "person", "people")
        sentences.append(
            f"Two arms of {people} each that differ by {protocol.arm_difference:g} in {metric} are told apart in "
            f"{100 * power.arms_differ:.0f} % of studies: that is the power."
        )
    elif not design_of(protocol).is_tested:
        sentences.append(
            f"No interval and no p is given below five people{_or_instances(protocol)}, so no difference is seen."
        )
    elif power.policy_better is not None and power.people_better is not None:
        difference = f"{protocol.policy_difference:g} in {metric}"
        sentences.append(
            f"A policy that is better than people by {difference} is seen in {100 * power.policy_better:.0f} % of studies, "
            f"one that is worse by as much in {100 * power.people_better:.0f} %: the lower share is the power."
        )
    elif not tested_policies(protocol):
        sentences.append("No policy is tested against people, so no difference is looked for.")
    else:
        sentences.append(
            f"No difference, however large, is seen in {100 * POSSIBLE_POWER:.0f} % of studies of this size."
        )
    if power.half_width is not None:
        sentences.append(
            f"The 95 % interval of the mean of those who finish is ±{power.half_width:.3g} wide on average."
        )
    simulated = counted(power.studies, "simulated study", "simulated studies")
    sentences.append(f"By {simulated}, analysed by the report's own functions.")
    return " ".join(sentences)


def assumptions_in_words(protocol: Protocol) -> str:
    """What the power rests on, a sentence."""
    failed, left = protocol.assumed_failed_share, protocol.assumed_leaver_share
    instances, alike = "of policy minus people", ""
    if protocol.primary_family == "arms":
        instances, alike = "for the interval of the mean alone", " No instance favours an arm."
    return (
        f"Assumed in {metric_in_words(protocol)}: mean {protocol.assumed_mean:g}; standard deviation "
        f"{protocol.assumed_player_sd:g} between people, {protocol.assumed_terrain_sd:g} between instances "
        f"({instances}), {protocol.assumed_episode_sd:g} of the rest; {100 * failed:.3g} % of episodes fail, "
        f"{100 * left:.3g} % of the people who begin leave.{alike}"
    )


def reachable_difference(design: StudyDesign) -> tuple[float | None, float]:
    """The least difference that the study can see, and with what power.

    With 80 % power, or with 60 % if none has 80.
    """
    for power in (WANTED_POWER, POSSIBLE_POWER):
        if (least := least_difference(design, power)) is not None:
            return least, power
    return None, POSSIBLE_POWER


def _smallest(is_enough: Callable[[int], bool], low: int, high: int) -> int | None:
    """The smallest number of low..high that is enough; None if none is.

    If a number is enough, so are all larger ones.
    """
    if high < low or not is_enough(high):
        return None
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if is_enough(middle) else (middle + 1, high)
    return high


def _mean_within(mean: float, sd: float, bounds: Interval) -> float:
    """The mean of a normal variable that is cut off at the bounds."""
    below, above = ((bound - mean) / sd for bound in bounds)
    outside = [
        bound * float(scipy.special.ndtr(side))
        for bound, side in zip(bounds, (below, -above), strict=True)
        if np.isfinite(bound)
    ]
    inside = scipy.special.ndtr(above) - scipy.special.ndtr(below)
    density = np.exp(-0.5 * np.square([below, above])) / np.sqrt(2 * np.pi)
    return float(sum(outside) + mean * inside - sd * (density[1] - density[0]))


def assumptions_from(data: StudyData, protocol: Protocol) -> dict[str, float]:
    """What a study shows of a protocol's assumptions, by field, in its primary metric.

    A dry run shows it at once: whoever still plays there has not left.

    Raises:
        ValueError: If its people are too few.
    """
    name = data.protocol.name
    if not data.shows_people:
        raise ValueError(f"the study {name!r} shows no figure until it is closed")
    cohort = people_of(data)
    by_person = statuses(data, cohort)
    ranked = {
        person: trials
        for person, trials in cohort.ranked.items()
        if trials and by_person.get(person) is not Status.PLAYING
    }
    succeeded = {
        person: tuple(trial for trial in trials if trial.succeeded)
        for person, trials in ranked.items()
    }
    reached = replace(cohort, ranked=succeeded)
    ids = members(reached, {})
    table = reached.table(ids, protocol.primary_metric)
    spread = variance_components(table) if ids else None
    if spread is None or not spread.between_sd or not spread.rest_sd:
        raise ValueError(f"the study {name!r} has too few players with a spread to plan from")
    episodes = sum(map(len, ranked.values()))
    left = sum(person.completed_ms is None for person in cohort.people if person.id in ranked)
    return {
        "assumed_mean": float(np.nanmean(table, axis=1).mean()),
        "assumed_player_sd": spread.between_sd,
        "assumed_episode_sd": spread.rest_sd,
        "assumed_failed_share": 1 - int((~np.isnan(table)).sum()) / episodes,
        "assumed_leaver_share": left / len(ranked),
    }
