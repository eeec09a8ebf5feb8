"""The function `evaluate`: any policies on any configurations and the same seeds, as a table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor

from marsexplorer import policies as policy_files
from marsexplorer.config import EnvConfig, check_seed
from marsexplorer.evaluation.episodes import Result, make_chunks, play_chunks
from marsexplorer.evaluation.table import EvaluationTable, tabulate

Progress = Callable[[int, int], None]


def evaluate(
    policies: Sequence[str],
    configs: EnvConfig | Sequence[EnvConfig],
    episodes: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    seeds: Sequence[int] | None = None,
    traces: bool = False,
    executor: Executor | None = None,
) -> EvaluationTable:
    """Play policies on `episodes` terrains from `seed` on, or on the terrains of `seeds`, and return the table of figures.

    policies  names or paths
    configs   one configuration or several; every policy plays the terrains of the same seeds in each
    seeds     in place of episodes and seed: at least two different ones
    progress  called with (episodes played, episodes in all)
    traces    keep each episode's path and coverage after every move in `Result.trace`
    executor  of `concurrent.futures`, such as ProcessPoolExecutor(), that plays; None plays in this process. The table is
              the same

    ValueError for arguments out of range, PolicyNotFoundError and PolicyFileError for policies that cannot be loaded.
    """
    if not policies:
        raise ValueError("there must be at least one policy to evaluate, got none")
    chosen_seeds = _seeds(episodes, seed, seeds)
    configs = (configs,) if isinstance(configs, EnvConfig) else tuple(dict.fromkeys(configs))
    if not configs:
        raise ValueError("there must be at least one configuration to evaluate on, got none")
    names = list(dict.fromkeys(str(policy) for policy in policies))
    for config in configs:  # refuse what cannot be played before anything is played
        for name in names:
            policy_files.load(name, config.sensor_radius)
    chunks, total = (
        make_chunks(names, configs, chosen_seeds, traces),
        len(names) * len(configs) * len(chosen_seeds),
    )
    results: list[Result] = []
    for part in play_chunks(chunks, executor):
        results += part
        if progress:
            progress(len(results), total)
    return tabulate(configs, names, chosen_seeds, results)


def _seeds(episodes: int | None, seed: int, seeds: Sequence[int] | None) -> list[int]:
    """Return the seeds to play; raise ValueError when there are fewer than two or one comes twice."""
    if (episodes is None) == (seeds is None):
        raise ValueError("give either episodes (and seed) or seeds")
    if seeds is None:
        assert episodes is not None
        if episodes < 2:
            raise ValueError(f"episodes must be at least 2 (an interval needs two), got {episodes}")
        check_seed(check_seed(seed) + episodes - 1)
        return list(range(seed, seed + episodes))
    chosen = [check_seed(int(each)) for each in seeds]
    if len(chosen) < 2:
        raise ValueError(f"seeds must be at least 2 (an interval needs two), got {len(chosen)}")
    if len(set(chosen)) != len(chosen):
        raise ValueError("seeds must differ: an interval counts terrains, and one came twice")
    return chosen
