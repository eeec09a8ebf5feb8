"""What a study can see before it is frozen: the width of its interval, and the power of each comparison that it plans.

A player's mean over m ranked episodes has the variance player_sd^2 + episode_sd^2 / m, so more episodes cannot make up for few
players. The t interval's half-width is itself random; skewed scores widen the printed interval beyond t
(research/coverage/README.md has its width over that of t).

The power follows from the protocol's assumed standard deviations of steps to 99 % (normal players and episodes). The two
questions are those of the report: is learning flat within the margin (two one-sided t tests at 5 %, on each player's last third
minus first third), and does a policy differ from the people on these terrains (t test over players, at the level of the first
step of Holm's method; the report's test is for other terrains too, which takes a little of the power).
`research.methods.flat_power` compares the first with the report's own test in simulated studies.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from app.report.statistics.exclusion_sets import members, people_of
from app.report.statistics.learning import LEVEL
from app.report.statistics.spread import variance_components
from app.series.data import StudyData
from app.series.policy_episodes import tested_policies
from app.series.protocol import Protocol
from marsexplorer.intervals import CONFIDENCE, Floats, t_quantile

WANTED_POWER = 0.8
"""What a new study's margin and difference are derived for."""

LEAST_POWER = 0.5
"""A study below it is refused: it would more likely miss than see what it is planned to see."""

MAX_PLAYERS = 2000
"""Players beyond which no study is planned here."""
LISTED_PLAYERS = (5, 8, 10, 15, 20, 30, 50, 100)

_QUANTILES: Floats = (np.arange(2000) + 0.5) / 2000
"""Of the sample's standard deviation, over which a power is averaged."""


@dataclass(frozen=True)
class Width:
    """Half-widths of the 95 % t interval with so many players, in the metric's unit.

    expected  its mean for normal player means; assured: not exceeded in the share of studies asked for
    """

    players: int
    expected: float
    assured: float


@dataclass(frozen=True)
class SampleSizePlan:
    """How many players reach a half-width.

    players   fewest whose expected half-width is at most the wanted one; None when MAX_PLAYERS are too few
    assured   fewest who reach it in the share `assurance` of studies; None likewise
    mean_sd   standard deviation of a player's mean over `ranked` episodes
    table     half-widths for some numbers of players, the two above among them
    """

    mean_sd: float
    players: int | None
    assured: int | None
    table: tuple[Width, ...]


def plan_sample_size(
    player_sd: float, episode_sd: float, half_width: float, ranked: int = 30, assurance: float = 0.8
) -> SampleSizePlan:
    """Return how many players give a 95 % interval of the mean whose half-width is at most `half_width`.

    player_sd   standard deviation between players' true means, in the metric's unit (score or steps)
    episode_sd  standard deviation of an episode around its player's mean
    ranked      episodes a player; assurance: share of studies, in (0, 1), in which the width is to be reached

    ValueError for a spread or width that cannot be.
    """
    if player_sd < 0 or episode_sd < 0 or not player_sd + episode_sd > 0:
        given = f"{player_sd} and {episode_sd}"
        raise ValueError(f"the SDs must be at least 0, and one above 0; got {given}")
    if not half_width > 0:
        raise ValueError(f"the half-width must be above 0, got {half_width}")
    if ranked < 1 or not 0 < assurance < 1:
        given = f"{ranked} and {assurance}"
        raise ValueError(f"ranked must be at least 1 and assurance in (0, 1), got {given}")
    spread = float(np.sqrt(player_sd**2 + episode_sd**2 / ranked))
    every = np.arange(2, MAX_PLAYERS + 1)
    columns = every, *half_widths(spread, every, assurance)
    widths = [Width(*row) for row in zip(*(each.tolist() for each in columns), strict=True)]
    players = next((width.players for width in widths if width.expected <= half_width), None)
    assured = next((width.players for width in widths if width.assured <= half_width), None)
    shown = sorted({*LISTED_PLAYERS, *(count for count in (players, assured) if count is not None)})
    return SampleSizePlan(spread, players, assured, tuple(widths[count - 2] for count in shown))


def half_widths(
    mean_sd: float, players: NDArray[np.int64], assurance: float
) -> tuple[Floats, Floats]:
    """Return the half-width of the 95 % t interval on average, and the one that the share `assurance` of studies stays below.

    mean_sd  standard deviation of a player's mean; players: numbers of players, each at least 2
    """
    freedom = players - 1
    unit = scipy.special.stdtrit(freedom, (1 + CONFIDENCE) / 2) * mean_sd / np.sqrt(players)
    log_ratio = scipy.special.gammaln(players / 2) - scipy.special.gammaln(freedom / 2)
    expected = np.sqrt(2 / freedom) * np.exp(log_ratio)  # of the sample SD, for SD 1
    return unit * expected, unit * np.sqrt(chi_squared_quantile(assurance, freedom) / freedom)


def chi_squared_quantile(probability: float | Floats, freedom: int | NDArray[np.int64]) -> Floats:
    """Return what a chi-squared variable with `freedom` degrees of freedom stays below with this probability (0..1)."""
    quantile: Floats = 2 * scipy.special.gammaincinv(freedom / 2, probability)
    return quantile


def spread_of(data: StudyData, metric: Literal["score", "steps"] = "score") -> tuple[float, float]:
    """Return (player SD, episode SD) of the people of a study; ValueError when they are too few to estimate them.

    The episode SD leaves out what a terrain adds to everybody's episodes, since it adds nothing between players.
    """
    why = "shows no figure until it is closed"
    found = None
    if data.closed_ms is not None:
        why = "has too few players with a spread to plan from"
        cohort = people_of(data)
        ids = members(cohort, {})
        found = variance_components(cohort.table(ids, metric)) if ids else None
    if found is None:
        raise ValueError(f"the study {data.protocol.name!r} {why}: give the SDs instead")
    return found.between_sd, found.rest_sd


@dataclass(frozen=True)
class PlannedComparison:
    """A comparison that a study plans.

    what     in words, with its number
    power    share of studies that see it
    least    the smallest margin or difference (steps to 99 %) that this many players see with 80 % power; None for none
    players  fewest players who see the planned one with 80 % power; None where more than MAX_PLAYERS are needed
    field    of the protocol that holds the margin or difference
    """

    what: str
    power: float
    least: float | None
    players: int | None
    field: str


@dataclass(frozen=True)
class StudyPlan:
    """What a protocol can see.

    player_sd, episode_sd  assumed, in steps to 99 %
    is_default             whether the protocol does not name them, so that those of a new study stand in
    half_width             of the 95 % interval of mean steps to 99 %: on average, and in 80 % of studies; None for one player
    comparisons            in the order of the report; learning is missing below three ranked episodes
    """

    player_sd: float
    episode_sd: float
    is_default: bool
    half_width: tuple[float, float] | None
    comparisons: tuple[PlannedComparison, ...]

    @property
    def underpowered(self) -> tuple[PlannedComparison, ...]:
        """The comparisons whose power is below LEAST_POWER."""
        return tuple(each for each in self.comparisons if each.power < LEAST_POWER)


def plan_study(protocol: Protocol) -> StudyPlan:
    """Return what a protocol can see with the players it plans."""
    player_sd, episode_sd = planned_sds(protocol)
    half_width = None
    if protocol.players > 1:
        spread, players = _mean_sd(protocol, player_sd, episode_sd), np.array([protocol.players])
        expected, assured = half_widths(spread, players, WANTED_POWER)
        half_width = float(expected[0]), float(assured[0])
    found = []
    if protocol.ranked >= 3 and protocol.equivalence_margin is not None:
        found.append(_learning(protocol, episode_sd, protocol.equivalence_margin))
    if tested_policies(protocol):
        found.append(_policies(protocol, player_sd, episode_sd))
    is_default = protocol.assumed_player_sd is None or protocol.assumed_episode_sd is None
    return StudyPlan(player_sd, episode_sd, is_default, half_width, tuple(found))


def planned_sds(protocol: Protocol) -> tuple[float, float]:
    """Return the assumed standard deviations (players, episodes), those of a new study where the protocol names none."""
    known = protocol.rules.study(protocol.env_config)
    players, episodes = known["assumed_player_sd"], known["assumed_episode_sd"]
    return protocol.assumed_player_sd or players, protocol.assumed_episode_sd or episodes


def derived_difference(protocol: Protocol) -> float | None:
    """Return the smallest whole difference from a policy (steps) seen with 80 % power; None where none can be seen."""
    if protocol.players < 2:
        return None
    spread = _mean_sd(protocol, *planned_sds(protocol))
    count = _policy_count(protocol)
    least = _least(lambda other: difference_power(spread, protocol.players, other, count))
    return _whole(least, protocol)


def flat_power(change_sd: float, players: int, margin: float) -> float:
    """Return the share of truly flat studies whose 90 % interval of the change lies within +-margin.

    change_sd  standard deviation, between players, of last third minus first third
    """
    if players < 2:
        return 0.0
    freedom, error = players - 1, change_sd / math.sqrt(players)
    sampled = np.sqrt(chi_squared_quantile(_QUANTILES, freedom) / freedom)
    room = margin / error - t_quantile(freedom, 1 - 2 * LEVEL) * sampled
    return float(np.maximum(0.0, 2 * scipy.special.ndtr(room) - 1).mean())


def difference_power(mean_sd: float, players: int, difference: float, policies: int) -> float:
    """Return the share of studies that see a policy's difference from the people at 5 % / policies, two-sided.

    mean_sd  standard deviation of players' means over the ranked terrains
    """
    if players < 2:
        return 0.0
    freedom, shift = players - 1, difference * math.sqrt(players) / mean_sd
    sampled = np.sqrt(chi_squared_quantile(_QUANTILES, freedom) / freedom)
    limit = t_quantile(freedom, 1 - (1 - CONFIDENCE) / policies) * sampled
    return float((scipy.special.ndtr(shift - limit) + scipy.special.ndtr(-limit - shift)).mean())


def _learning(protocol: Protocol, episode_sd: float, margin: float) -> PlannedComparison:
    spread = _change_sd(protocol, episode_sd)
    least = None
    if protocol.players > 1:
        least = _least(lambda other: flat_power(spread, protocol.players, other))
    return PlannedComparison(
        what=f"learning flat within ±{margin:g} steps, if it is flat",
        power=flat_power(spread, protocol.players, margin),
        least=least,
        players=_fewest(lambda players: flat_power(spread, players, margin)),
        field="equivalence_margin",
    )


def _policies(protocol: Protocol, player_sd: float, episode_sd: float) -> PlannedComparison:
    spread, count = _mean_sd(protocol, player_sd, episode_sd), _policy_count(protocol)
    least = None
    if protocol.players > 1:
        least = _least(lambda other: difference_power(spread, protocol.players, other, count))
    wanted = protocol.policy_difference or (1.0 if least is None else _whole(least, protocol))
    return PlannedComparison(
        what=f"each of {count} policies, if it differs by {wanted:g} steps from the people on these terrains",
        power=difference_power(spread, protocol.players, wanted, count),
        least=least,
        players=_fewest(lambda players: difference_power(spread, players, wanted, count)),
        field="policy_difference",
    )


def _change_sd(protocol: Protocol, episode_sd: float) -> float:
    return episode_sd * math.sqrt(2 / (protocol.ranked // 3))


def _mean_sd(protocol: Protocol, player_sd: float, episode_sd: float) -> float:
    return math.sqrt(player_sd**2 + episode_sd**2 / protocol.ranked)


def _policy_count(protocol: Protocol) -> int:
    return max(1, len(tested_policies(protocol)))


def _least(power: Callable[[float], float]) -> float:
    """Return the smallest effect that is seen with 80 % power."""
    high = 1.0
    while power(high) < WANTED_POWER:
        high *= 2
    return float(scipy.optimize.brentq(lambda effect: power(effect) - WANTED_POWER, 1e-9, high))


def _fewest(power: Callable[[int], float]) -> int | None:
    """Return the fewest players, 2..MAX_PLAYERS, with 80 % power; None where all are too few. Power rises with players."""
    low, high = 1, MAX_PLAYERS
    if power(high) < WANTED_POWER:
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if power(middle) >= WANTED_POWER else (middle, high)
    return high


def _whole(effect: float, protocol: Protocol) -> float:
    """Return the effect in whole steps, at most as many as an episode has."""
    return float(min(math.ceil(effect), protocol.env_config.limit))
