"""`python -m research.lookahead.stages`: how much does looking ahead find?

At every decision of `lookahead` in its own episodes each candidate is walked on the true terrain
too, and the priced rule plays on from there. Moves of the candidate that `ppo` would have made,
less

    found   those of the candidate that looking ahead chose
    known   those of the best candidate: what the choice would be worth to someone who has seen the
            map

Before it begins to act, at 60 % known, it is asked from 30 % on, and `ppo` moves.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from humanplay.command.console import print_table, progress
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies.base import Memory
from marsexplorer.policies.kernels.rollouts import compare, fill_truths
from marsexplorer.policies.lookahead import Lookahead, LookaheadArrays
from marsexplorer.terrain import generate
from research.lookahead.__main__ import FIRST_SEED
from research.paper.tables import Estimate, low_to_high, per_cent

EARLIEST = 0.3
"""Share of the cells that is known when it is first asked."""
STAGES = (EARLIEST, 0.6, 0.8, 0.9, 0.95, 1.0)


class JudgedLookahead(Lookahead):
    """`lookahead` on one terrain, with the worth of each of its decisions there.

    decisions  (share of the cells known, found, known, number of the episode's terrain) of each
    """

    def __init__(self) -> None:
        super().__init__(policies.load("ppo"))
        self.decisions: list[tuple[float, float, float, int]] = []
        self._truth: NDArray[np.bool_] = np.zeros((0, 0), np.bool_)
        self._seed = 0

    def watch(self, truth: NDArray[np.bool_], seed: int) -> None:
        """Take the terrain of the next episode: bool[rows, cols], True where blocked."""
        self._truth, self._seed = truth, seed

    def _look_ahead(self, memory: Memory, action: int) -> int | None:
        rows, cols = shape = memory.codes.shape
        if self._arrays is None or self._arrays.shape != shape:
            self._arrays = LookaheadArrays((rows, cols), self._radius)
            self._begins = self._arrays.settings.begins
            self._arrays.settings = replace(self._arrays.settings, begins=EARLIEST)
        better = super()._look_ahead(memory, action)
        if not self.compared:
            return better
        arrays, (count, best) = self._arrays, self._compared_ways
        stride, radius = arrays.board.board[2][4:]
        rectangles, _, _, scratch = arrays.chains
        covers = self._truth.reshape(1, -1).astype(np.int16)
        truths = np.zeros_like(arrays.truths[:1])
        chain: tuple[Any, ...] = (rectangles[:1], covers, np.ones(1, np.uint8), scratch)
        fill_truths(chain, rows, cols, stride, radius, truths)
        real, costs = (arrays.board.board, arrays.done, arrays.rover), np.zeros_like(arrays.costs)
        target = EnvConfig(rows=rows, cols=cols).target
        compare(
            real,
            arrays.trial,
            truths,
            1,
            0.0,
            arrays.rule,
            target,
            count,
            arrays.ways,
            arrays.lengths,
            costs,
            arrays.alive,
        )
        moves, share = costs[:count, 0], float(arrays.rover[1]) / (rows * cols)
        gains = float(moves[0] - moves[best]), float(moves[0] - moves.min())
        self.decisions.append((share, *gains, self._seed))
        if share < self._begins:
            self.compared = 0
            return None
        return better


def per_decision(decisions: list[tuple[float, float, float, int]], column: int) -> Estimate:
    """The mean of a column over decisions, with the interval of the terrains' means.

    Decisions on one terrain are alike.
    """
    values = np.array([decision[column] for decision in decisions])
    seeds = np.array([decision[3] for decision in decisions])
    return Estimate.of([float(values[seeds == seed].mean()) for seed in np.unique(seeds)])


@click.command()
@click.option("--size", type=click.Choice(["21", "42", "84"]), default="21", show_default=True)
@click.option(
    "--terrains", type=click.IntRange(min=2), default=40, show_default=True, help="How many."
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=FIRST_SEED,
    show_default=True,
    help="The first terrain's.",
)
def main(size: str, terrains: int, seed: int) -> None:
    """Print the moves that a decision saves at each stage of an episode.

    Those that `lookahead` found, and those that knowing the map would give.

    \b
    Examples:
      python -m research.lookahead.stages
      python -m research.lookahead.stages --size 42 --terrains 10
    """
    config, watched = EnvConfig.of("random", int(size)), JudgedLookahead()
    with progress("terrains") as advance:
        for count, terrain_seed in enumerate(range(seed, seed + terrains), 1):
            watched.watch(generate(config, terrain_seed), terrain_seed)
            play_episode(watched, config, terrain_seed)
            advance(count, terrains)
    rows = []
    for low, high in pairwise(STAGES):
        decisions = [decision for decision in watched.decisions if low <= decision[0] < high]
        if decisions:
            by_looking, by_knowing = (per_decision(decisions, column).text(2) for column in (1, 2))
            stage = low_to_high((low, high), per_cent)
            rows.append((stage, str(len(decisions)), by_looking, by_knowing))
    title = f"moves saved by a decision, {size}x{size}, {terrains} terrains"
    print_table(title, ("cells known", "decisions", "found", "known"), rows)


if __name__ == "__main__":
    main(prog_name="python -m research.lookahead.stages")
