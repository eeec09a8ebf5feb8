"""The command `python -m research.lookahead`: moves of `lookahead` and of `ppo`.

A row is added to a file for each terrain as soon as both have played it, so a run that was stopped
goes on where it was.
"""

from __future__ import annotations

import csv
import json
import time
from math import nan
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from humanplay.command.console import print_table, progress
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import steps_to_target
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.evaluation.table import ratio_interval
from marsexplorer.policies.lookahead import Lookahead

FIRST_SEED = 7_000_000_000
"""Of the terrains of the measurement, on which nothing was chosen; `stages` plays the first of
them again.
"""
TERRAINS = {21: 300, 42: 100, 84: 20}
FOLDER = Path(__file__).parent / "measured"
BOARDS = Path(__file__).parents[2] / "data" / "leaderboard"
COLUMNS = ("side", "seed", "ppo", "lookahead", "decisions", "seconds")
"""Sides in cells, moves to 99 % of each policy, decisions that looked ahead and the processor
seconds they took.
"""


class TimedLookahead:
    """`lookahead`, with the processor time of the decisions that looked ahead."""

    name = Lookahead.name

    def __init__(self) -> None:
        self._policy = policies.load(self.name)
        self.decisions, self.seconds = 0, 0.0

    def set_level(self, level: str) -> None:
        """Hand the level on."""
        assert isinstance(self._policy, Lookahead)
        self._policy.set_level(level)

    def reset(self, seed: int) -> None:
        """Begin an episode, and the counts with it."""
        self._policy.reset(seed)
        self.decisions, self.seconds = 0, 0.0

    def act(self, observation: NDArray[np.uint8]) -> int:
        """Return the action."""
        assert isinstance(self._policy, Lookahead)
        began = time.process_time()
        action = self._policy.act(observation)
        if self._policy.compared:
            self.decisions += 1
            self.seconds += time.process_time() - began
        return action


def measure(path: Path, side: int, seeds: range) -> None:
    """Add the rows of the terrains that a file does not have yet."""
    done = {row[1] for row in read(path) if row[0] == side}
    config, alone, ahead = EnvConfig.of("random", side), policies.load("ppo"), TimedLookahead()
    play_episode(ahead, config, 0)  # compiles the kernels
    with progress(f"{side}x{side}") as advance, path.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if file.tell() == 0:
            writer.writerow(COLUMNS)
        for count, seed in enumerate(seeds, 1):
            if seed not in done:
                moves = []
                for policy in (alone, ahead):
                    played = play_episode(policy, config, seed)
                    moves.append(steps_to_target(config, played.outcome, played.steps))
                writer.writerow((side, seed, *moves, ahead.decisions, f"{ahead.seconds:.3f}"))
                file.flush()
            advance(count, len(seeds))


def read(path: Path) -> list[tuple[float, ...]]:
    """The rows of a file, in the order of COLUMNS; none if there is no file."""
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return [tuple(map(float, row)) for row in list(csv.reader(file))[1:]]


def on_the_leaderboard(side: int) -> list[tuple[float, ...]]:
    """The rows of the leaderboard's terrains, from the package's data, without times."""
    document = json.loads((BOARDS / f"random-{side}x{side}.json").read_text())
    steps = {policy["policy"]: policy["steps"] for policy in document["policies"]}
    both = zip(steps["ppo"], steps[Lookahead.name], strict=True)
    return [(side, nan, alone, ahead, 0, 0.0) for alone, ahead in both]


def summary(terrains: str, rows: list[tuple[float, ...]]) -> tuple[str, ...]:
    """A row of the table: both means of moves, their ratio, milliseconds a decision."""
    _, _, alone, ahead, decisions, seconds = np.array(rows).T
    ratio, low, high = ratio_interval(ahead, alone)
    side = f"{rows[0][0]:.0f}"
    return (
        terrains,
        f"{side}x{side}",
        f"{len(rows)}",
        f"{alone.mean():.2f}",
        f"{ahead.mean():.2f}",
        f"{ratio:.4f} ({low:.4f} to {high:.4f})",
        f"{1000 * seconds.sum() / decisions.sum():.1f}" if decisions.sum() else "",
    )


@click.command()
@click.option(
    "--size",
    "sizes",
    type=click.Choice(list(map(str, TERRAINS))),
    multiple=True,
    help="The side of the grid; repeatable.  [default: 21]",
)
@click.option(
    "--terrains",
    type=click.IntRange(min=2),
    help="How many.  [default: 300 at 21, 100 at 42, 20 at 84]",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=FIRST_SEED,
    show_default=True,
    help="The first terrain's.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=FOLDER,
    help="The folder of the rows, which a run adds to.  [default: beside this command]",
)
@click.option(
    "--table",
    "is_table",
    is_flag=True,
    help="Play nothing, print what the folder and the leaderboard have.",
)
def main(
    sizes: tuple[str, ...], terrains: int | None, seed: int, out: Path, is_table: bool
) -> None:
    """Play `ppo` and `lookahead` on the same terrains; print the ratio of moves.

    The terrains are of level `random`, and the moves are those to 99 %.

    \b
    Examples:
      python -m research.lookahead --table
      nice -n 19 python -m research.lookahead --size 21 --size 42 --out runs/mine

    The interval is of 95 %, paired by terrain. Moves depend on nothing but the terrain;
    milliseconds are of the processor, and depend on the machine and on what else it does.
    """
    out.mkdir(parents=True, exist_ok=True)
    rows = []
    for side in map(int, sizes or (TERRAINS if is_table else ("21",))):
        path = out / f"{side}.csv"
        if not is_table:
            measure(path, side, range(seed, seed + (terrains or TERRAINS[side])))
        measured = read(path)
        rows += [summary("of their own", measured)] if len(measured) > 1 else []
    if is_table:
        rows += [summary("the leaderboard's", on_the_leaderboard(side)) for side in TERRAINS]
    heads = ("terrains", "size", "how many", "ppo", "lookahead", "ratio", "ms a decision")
    print_table("moves to 99 %, level random", heads, rows)


if __name__ == "__main__":
    main()
