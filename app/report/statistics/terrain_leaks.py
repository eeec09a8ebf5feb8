"""Whether ranked terrains leaked from one participant to the next: a trend over how many others had finished them before.

Everybody meets the same ranked terrains. Somebody who has heard about a terrain from others plays it better the more people had
finished it before. Knowing a map beforehand is worth about a third of the steps, so talk among many would show.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from app.db.trial import Trial
from app.report.statistics.intervals import Interval
from app.task import Words
from marsexplorer.intervals import t_quantile

FEWEST_PLAYERS = 5
"""Below so many players no trend is tested, as their spread is too poorly known."""


@dataclass(frozen=True)
class LeakTrend:
    """The change in steps to 99 % for each further person who had finished the same terrain before.

    players   whose ranked episodes enter
    most      the largest number of earlier finishers that an episode had
    slope     steps for each earlier finisher; None when nothing can be tested, and so for the next two
    interval  95 % interval of the slope
    p_value   two-sided, of no trend; None also where the report gives no p
    """

    players: int
    most: int
    slope: float | None = None
    interval: Interval | None = None
    p_value: float | None = None

    def sentence(self, words: Words) -> str:
        """What was found, in words."""
        if self.slope is None or self.interval is None:
            return "Whether ranked terrains leaked between participants was not tested: too few people, or nobody came later."
        low, high = self.interval
        p = "" if self.p_value is None else f", p = {self.p_value:.3f}"
        verdict = "No sign that ranked terrains leaked between participants"
        if self.p_value is None:
            verdict = "Whether ranked terrains leaked is not tested: failures are a few players'"
        elif high < 0:
            verdict = "People did better on terrains that others had finished before, as they would if terrains had leaked"
        return (
            f"{verdict}: {self.slope:+.2f} {words.steps} for each earlier finisher of a terrain (95 % interval {low:+.2f} to "
            f"{high:+.2f}{p}, {self.players} players, up to {self.most} earlier finishers)."
        )


def leak_trend(ranked: Mapping[str, Sequence[Trial]], is_tested: bool = True) -> LeakTrend:
    """Return the trend over people's finished ranked episodes, given by participant; without its p where it is not tested.

    Least squares over players: the mean of the player's steps to 99 %, each minus the mean of its terrain, on the mean number
    of other people who had finished the terrain when the episode began; t with players - 2 degrees of freedom. The player is
    the unit, so the trend takes for granted that skill does not follow the order of coming.
    """
    everything = [each for own in ranked.values() for each in own]
    episodes = [each for each in everything if None not in (each.steps_to_target, each.ended_ms)]
    on_terrain: dict[int, list[int]] = defaultdict(list)
    for each in episodes:
        on_terrain[each.terrain_index].append(each.steps_to_target or 0)
    difficulty = {terrain: np.mean(steps) for terrain, steps in on_terrain.items()}
    before: dict[str, list[int]] = defaultdict(list)
    steps: dict[str, list[float]] = defaultdict(list)
    for each in episodes:
        before[each.participant].append(_finishers_before(each, episodes))
        more = (each.steps_to_target or 0) - difficulty[each.terrain_index]
        steps[each.participant].append(float(more))
    most = max((max(counts) for counts in before.values()), default=0)
    x, y = ([float(np.mean(own)) for own in found.values()] for found in (before, steps))
    if len(x) < FEWEST_PLAYERS or np.ptp(x) == 0:
        return LeakTrend(len(x), most)
    found = scipy.stats.linregress(x, y)
    half = float(t_quantile(len(x) - 2) * found.stderr)
    slope = float(found.slope)
    p = float(found.pvalue) if is_tested else None
    return LeakTrend(len(x), most, slope, (slope - half, slope + half), p)


def _finishers_before(episode: Trial, episodes: Sequence[Trial]) -> int:
    """Return how many others' episodes on the same terrain had ended when this one began."""
    return sum(
        other.terrain_index == episode.terrain_index
        and other.participant != episode.participant
        and other.ended_ms is not None
        and other.ended_ms <= episode.started_ms
        for other in episodes
    )
