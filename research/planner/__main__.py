"""The command `python -m research.planner`: the planner beside the better rule."""

from __future__ import annotations

import click
import numpy as np
from numpy.typing import NDArray

from humanplay.command.console import print_table, progress
from humanplay.tasks.mars.cli.options import levels_option, sizes_option
from humanplay.tasks.mars.cli.train import configs_of
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import steps_to_target
from marsexplorer.evaluation import RULES
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.evaluation.table import ratio_interval
from marsexplorer.policies import Policy
from research.planner.planner import Planner


@click.command(context_settings={"show_default": True})
@levels_option("random")
@sizes_option("21")
@click.option("--terrains", type=click.IntRange(min=2), default=100, help="Of a level and size.")
@click.option(
    "--seed", type=click.IntRange(min=0), default=1_000_000_000, help="The first terrain's."
)
def main(
    levels: tuple[str, ...], sizes: tuple[int | tuple[int, int], ...], terrains: int, seed: int
) -> None:
    """Play the planner and both rules, and print the ratio of its moves to 99 %.

    \b
    Examples:
      python -m research.planner
      python -m research.planner --level 1-1-1 --size 42 --terrains 40
    """
    rows = []
    for config in configs_of(levels, sizes):
        board = f"{config.level} {config.rows}x{config.cols}"
        players = [Planner(config.sensor_radius), *map(policies.load, RULES)]
        with progress(board) as advance:
            moves = []
            for count, policy in enumerate(players, 1):
                moves.append(moves_of(policy, config, range(seed, seed + terrains)))
                advance(count, len(players))
        planner, *rules = moves
        rule = min(rules, key=lambda steps: float(steps.mean()))
        ratio, low, high = ratio_interval(planner, rule)
        means = f"{planner.mean():.1f}", f"{rule.mean():.1f}"
        rows.append((board, *means, f"{ratio:.3f} ({low:.3f} to {high:.3f})"))
    print_table(f"{terrains} terrains each", ("", "planner", "better rule", "ratio"), rows)


def moves_of(policy: Policy, config: EnvConfig, seeds: range) -> NDArray[np.float64]:
    """The moves to 99 % of a policy on each terrain."""
    played = (play_episode(policy, config, seed) for seed in seeds)
    return np.array(
        [steps_to_target(config, episode.outcome, episode.steps) for episode in played], float
    )


if __name__ == "__main__":
    main(prog_name="python -m research.planner")
