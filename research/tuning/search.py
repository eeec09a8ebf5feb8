"""Tune the parameters of `frontier-priced` by CMA-ES, and compare sets of them.

CMA-ES: Hansen and Ostermeier, Completely derandomized self-adaptation in evolution strategies,
Evolutionary Computation 9 (2), 2001, from the library `cmaes`. A point is a vector of parameters,
in units of SPREAD about those that the run began with. Its value is the mean over levels and sizes
of its moves to 99 % divided by those of the first parameters on the same terrains, so 1 is as good
as before. Each generation has new terrains, the same for all of its points: no point is good by
luck for long.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.table import ratio_interval
from marsexplorer.policies.kernels.prices import PriceParameters
from marsexplorer.policies.priced import TUNED, PricedRule, SizedRule
from research.tuning.priced_episodes import PricedEpisodes

FIRST_SEED = 3_000_000_000
"""Terrains for tuning have this seed and the next ones; those of evaluation begin at
1,000,000,000.
"""
CHECK_SEED = 4_000_000_000
"""The first terrain on which a run's parameters are compared with those before it."""

SPREAD = np.array([1.5, 5.0, 3.0, 1.2, 1.2, 1.0, 5.0, 6.0, 0.04, 0.3, 0.12])
"""One unit of each parameter: the weights, the powers, pocket, pocket_cells, fade, offset,
power.
"""
LOWEST = np.array([0.0, 0.0, 0.0, 0.2, 0.2, 0.2, 0.0, 1.0, 0.0, 0.0, 0.3])
"""The lowest value of each; a point that goes below it has this one."""
ENDS = ("small", "middle", "large")
"""The rules of a `SizedRule`."""
SIDE = 21
"""The side of the grids for which numbers of terrains are given; larger ones get fewer, in
proportion to their cells.
"""

Ratios = dict[str, list[tuple[float, float, float]]]
"""By the rule's name, for each configuration: the ratio of the mean moves, and the 95 %
interval's low and high.
"""


@dataclass(frozen=True)
class TuneConfig:
    """What a run does; the same configuration gives the same parameters.

    configs   levels and sizes
    terrains  of each in a generation, at 21x21, see SIDE; at least one
    ends      which of ENDS move
    seed      of CMA-ES, 0 or more; sigma: its first standard deviation, in units of SPREAD
    """

    configs: tuple[EnvConfig, ...]
    terrains: int = 24
    ends: tuple[str, ...] = ENDS
    seed: int = 0
    start: SizedRule = TUNED
    sigma: float = 0.4


class TuneRun:
    """A run of CMA-ES.

    generations  that are done
    rule         the mean of the search: what the run has found
    """

    def __init__(self, config: TuneConfig) -> None:
        self.config, self.generations = config, 0
        self._optimizer = CMA(
            np.zeros(len(SPREAD) * len(config.ends)), config.sigma, seed=config.seed
        )

    @property
    def points(self) -> int:
        """Points in a generation."""
        return int(self._optimizer.population_size)

    @property
    def rule(self) -> SizedRule:
        """The parameters that the run has found."""
        return self._rule(self._optimizer.mean)

    def run_generation(self, pool: ThreadPoolExecutor, advance: Callable[[int], None]) -> None:
        """Play a generation; `advance` is called with the points that are done."""
        points = [self._optimizer.ask() for _ in range(self.points)]
        most = self.config.terrains
        episodes = make_episodes(self.config.configs, most, FIRST_SEED + most * self.generations, 1)
        before = mean_moves(self.config.start, episodes, pool)
        values = []
        for point in points:
            values.append(float(np.mean(mean_moves(self._rule(point), episodes, pool) / before)))
            advance(len(values))
        self._optimizer.tell(list(zip(points, values, strict=True)))
        self.generations += 1

    def _rule(self, point: NDArray[np.float64]) -> SizedRule:
        by_end = {}
        for end, part in zip(self.config.ends, point.reshape(-1, len(SPREAD)), strict=True):
            first: PricedRule = getattr(self.config.start, end)
            by_end[end] = to_rule(to_vector(first) + SPREAD * part, first.limit)
        return replace(self.config.start, **by_end)


def make_episodes(
    configs: Sequence[EnvConfig], terrains: int, seed: int, least: int = 2
) -> list[PricedEpisodes]:
    """Return the episodes of every configuration on the terrains from a seed on.

    terrains  of each at 21x21 (see SIDE); least: of each at any size
    """
    counts = [max(least, round(terrains * SIDE**2 / config.n)) for config in configs]
    return [
        PricedEpisodes(config, range(seed, seed + count))
        for config, count in zip(configs, counts, strict=True)
    ]


def mean_moves(
    rule: SizedRule, episodes: Sequence[PricedEpisodes], pool: ThreadPoolExecutor
) -> NDArray[np.float64]:
    """The mean moves of a rule in each of some episodes, float64[len(episodes)]."""
    return np.array(list(pool.map(lambda terrains: terrains.play(rule).mean(), episodes)))


def compare_rules(
    reference: SizedRule,
    rules: dict[str, SizedRule],
    episodes: Sequence[PricedEpisodes],
    pool: ThreadPoolExecutor,
    advance: Callable[[int, int], None],
) -> Ratios:
    """The ratio of every rule's moves to a reference's, paired by terrain.

    At least two terrains of each configuration.

    advance  called with the number of rules that are done and their number
    """
    first = list(pool.map(lambda terrains: terrains.play(reference).astype(np.float64), episodes))
    ratios: Ratios = {}
    for name, rule in rules.items():
        moves = pool.map(
            lambda terrains, rule=rule: terrains.play(rule).astype(np.float64), episodes
        )
        ratios[name] = [
            ratio_interval(moves_of_rule, other)
            for moves_of_rule, other in zip(moves, first, strict=True)
        ]
        advance(len(ratios), len(rules))
    return ratios


def ablations(rule: SizedRule) -> dict[str, SizedRule]:
    """The rule with one of its terms taken out or replaced, by a description."""

    def changed(change: Callable[[PricedRule], PricedRule]) -> SizedRule:
        return SizedRule(*(change(getattr(rule, end)) for end in ENDS))

    def priced(**values: Any) -> SizedRule:
        return changed(lambda part: replace(part, prices=replace(part.prices, **values)))

    def without_square(square: int) -> SizedRule:
        def change(part: PricedRule) -> PricedRule:
            weights = list(part.prices.weights)
            weights[square] = 0.0
            a, b, c = weights
            return replace(part, prices=replace(part.prices, weights=(a, b, c)))

        return changed(change)

    return {
        "without the square of half side 2": without_square(0),
        "without the square of half side 6": without_square(1),
        "without the square of half side 12": without_square(2),
        "without pockets": priced(pocket=0.0),
        "without fade": priced(fade=0.0),
        "every unknown cell counts 1": priced(weights=(0.0, 0.0, 0.0), pocket=0.0),
        "offset 0": changed(lambda part: replace(part, offset=0.0)),
        "power of the way 1": changed(lambda part: replace(part, power=1.0)),
        "power of the way 2": changed(lambda part: replace(part, power=2.0)),
        "half the limit": changed(lambda part: replace(part, limit=part.limit / 2)),
        "the parameters for 21x21 on all sizes": SizedRule(rule.small, rule.small, rule.small),
        "the parameters for 84x84 on all sizes": SizedRule(rule.large, rule.large, rule.large),
    }


def to_vector(rule: PricedRule) -> NDArray[np.float64]:
    """The tuned parameters, float64[11], in the order of SPREAD; not the limit."""
    prices, others = rule.prices, (rule.offset, rule.power)
    scales = (prices.pocket, prices.pocket_cells, prices.fade)
    return np.array([*prices.weights, *prices.powers, *scales, *others])


def to_rule(vector: NDArray[np.float64], limit: float) -> PricedRule:
    """The rule of a vector to four decimals, values below LOWEST raised to it."""
    rounded = np.maximum(vector, LOWEST).round(4).tolist()
    (a, b, c, d, e, f), scales, (offset, power) = rounded[:6], rounded[6:9], rounded[9:]
    return PricedRule(PriceParameters((a, b, c), (d, e, f), *scales), limit, offset, power)


def read_rule(document: dict[str, Any]) -> SizedRule:
    """The rule of a dictionary that `dataclasses.asdict` made.

    KeyError, TypeError or ValueError if it is not one.
    """
    ends = {}
    for end in ENDS:
        prices: dict[str, Any] = dict(document[end]["prices"])
        prices |= {name: tuple(prices[name]) for name in ("weights", "powers")}
        ends[end] = PricedRule(**{**document[end], "prices": PriceParameters(**prices)})
    return SizedRule(**ends)
