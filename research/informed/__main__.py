"""The command `python -m research.informed`: policies beside an informed search."""

from __future__ import annotations

from functools import partial

import click
import numpy as np

from humanplay.command.console import print_table, progress
from humanplay.jobs import Jobs
from humanplay.tasks.mars.cli.options import levels_option, sizes_option
from humanplay.tasks.mars.cli.train import configs_of
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import RULES, evaluate
from marsexplorer.evaluation.table import ratio_interval
from marsexplorer.intervals import Floats, t_interval
from marsexplorer.policies import PolicyFileError, PolicyNotFoundError
from research.informed.informed import INFORMED, check_size, search


def compare(
    policies: tuple[str, ...], configs: list[EnvConfig], episodes: int, seed: int
) -> list[tuple[str, ...]]:
    """A row for each configuration and policy, the search and the rules included.

    A row has the policy, level, size, mean steps to 99 %, and their paired ratio to the search's.
    """
    for config in configs:
        check_size(config)
    names = list(dict.fromkeys((*policies, *RULES)))
    rows = []
    with Jobs() as jobs, progress("searching") as advance:
        table = evaluate(names, configs, episodes, seed, executor=jobs)
        for done, config in enumerate(configs):
            advance(done, len(configs))
            lengths = list(jobs.map(partial(search, config), table.seeds))
            steps = {INFORMED: np.array(lengths, np.float64)}
            results = [result for result in table.results if result.config_hash == config.hash]
            for name in names:
                moves = [result.steps_to_99 for result in results if result.policy == name]
                steps[name] = np.array(moves, np.float64)
            rows += [_row(config, name, steps) for name in steps]
    return rows


def _row(config: EnvConfig, name: str, steps: dict[str, Floats]) -> tuple[str, ...]:
    low, high = t_interval(steps[name])
    ratio, _, most = ratio_interval(steps[name], steps[INFORMED])
    mean = f"{steps[name].mean():.1f} ± {(high - low) / 2:.1f}"
    share = "1" if name == INFORMED else f"{ratio:.3f} ± {most - ratio:.3f}"
    return name, config.level, f"{config.rows}x{config.cols}", mean, share


@click.command()
@click.option("--policy", "policies", multiple=True, help="A policy's name or file; repeatable.")
@levels_option("random")
@sizes_option("21")
@click.option("--episodes", type=click.IntRange(min=2), default=100, show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
def main(
    policies: tuple[str, ...],
    levels: tuple[str, ...],
    sizes: tuple[int | tuple[int, int], ...],
    episodes: int,
    seed: int,
) -> None:
    """Play policies and both frontier rules beside the search on the same terrains.

    `to informed` is the ratio of the mean steps to 99 % to those of the search, which is shown the
    true map: an upper bound of the fewest possible, and no policy. ± is half of the 95 % interval.
    """
    configs = configs_of(levels, sizes)
    try:
        rows = compare(policies, configs, episodes, seed)
    except (PolicyNotFoundError, PolicyFileError, ValueError) as error:
        raise click.UsageError(str(error)) from error
    title = f"{episodes} terrains each, seeds {seed} to {seed + episodes - 1}, the same for all"
    print_table(title, ("policy", "level", "size", "steps to 99 %", "to informed"), rows)


if __name__ == "__main__":
    main()
