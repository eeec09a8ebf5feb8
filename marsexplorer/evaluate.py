"""Policies on the same terrains: score, completion and steps to 99 % with their intervals, as a table.

Every policy plays the terrains of seeds seed .. seed + episodes - 1 and is itself reset with the terrain's seed, so an
episode is a function of (policy, config, seed) and the table does not depend on how many processes made it.
"""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import asdict, dataclass

import numpy as np
from scipy import stats

from marsexplorer import policies as policy_files
from marsexplorer.config import CORE_VERSION, EnvConfig, check_seed
from marsexplorer.episode import Episode
from marsexplorer.score import steps_to_target

CONFIDENCE = 0.95
CHUNK = 5
"""Episodes a process plays before it reports."""

INLINE = 20
"""Up to so many episodes in all are played in this process: starting others costs seconds."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Result:
    """One episode of one policy.

    seed       of the terrain, and of the policy's own draws
    steps      moves made; steps_to_99 is `max_steps` for any outcome but `explored`
    coverage   discovered cells over all cells at the end, 0..1
    """

    policy: str
    seed: int
    outcome: str
    score: float
    total: float
    steps: int
    steps_to_99: int
    coverage: float


@dataclass(frozen=True)
class Row:
    """One policy over all terrains; intervals are 95 % t intervals of the mean over episodes.

    completion  share of episodes explored, 0..1
    steps_*     moves to 99 %, an unfinished episode counting `max_steps`
    collisions  episodes that ended in an obstacle or off the grid
    """

    policy: str
    episodes: int
    score_mean: float
    score_low: float
    score_high: float
    completion: float
    steps_mean: float
    steps_low: float
    steps_high: float
    collisions: int
    coverage_mean: float


@dataclass(frozen=True)
class Table:
    """What `evaluate` found: a row per policy in the order given, and every episode behind it."""

    config: EnvConfig
    seeds: tuple[int, int]
    rows: tuple[Row, ...]
    results: tuple[Result, ...]

    def to_json(self) -> str:
        """Return everything as JSON: core_version, config, seeds (first and last), rows, results."""
        document = {
            "core_version": CORE_VERSION,
            "config": self.config.to_dict(),
            "config_hash": self.config.hash,
            "seeds": {"first": self.seeds[0], "last": self.seeds[1]},
            "rows": [asdict(row) for row in self.rows],
            "results": [asdict(result) for result in self.results],
        }
        return json.dumps(document, indent=1)


def evaluate(
    policies: Sequence[str],
    config: EnvConfig,
    episodes: int,
    seed: int,
    progress: Progress | None = None,
    workers: int | None = None,
) -> Table:
    """Return the table of policies (names or paths) over `episodes` terrains from `seed` on.

    progress  called with (episodes played, episodes in all)
    workers   processes; None takes one per core. The table is the same for any number.
    """
    if not policies:
        raise ValueError("there must be at least one policy to evaluate, got none")
    if episodes < 2:
        raise ValueError(f"episodes must be at least 2 (an interval needs two), got {episodes}")
    if workers is not None and workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    last = check_seed(seed) + episodes - 1
    check_seed(last)
    chosen = list(dict.fromkeys(str(policy) for policy in policies))
    for name in chosen:
        policy_files.load(name, config.sensor_radius)  # an unknown one is refused before anything is played
    found: list[Result] = []
    for part in _played(chosen, config, range(seed, last + 1), workers):
        found += part
        if progress:
            progress(len(found), len(chosen) * episodes)
    results = sorted(found, key=lambda result: (chosen.index(result.policy), result.seed))
    rows = tuple(summarize([result for result in results if result.policy == name]) for name in chosen)
    return Table(config, (seed, last), rows, tuple(results))


def _played(names: list[str], config: EnvConfig, seeds: range, workers: int | None) -> Iterator[list[Result]]:
    """Yield the results chunk by chunk, in any order; processes are spawned, so no lock or thread is inherited."""
    chunks = [(name, config, seeds[at : at + CHUNK]) for at in range(0, len(seeds), CHUNK) for name in names]
    processes = workers or len(os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1))
    if processes == 1 or (workers is None and len(names) * len(seeds) <= INLINE):
        for chunk in chunks:
            yield play(*chunk)
        return
    with ExitStack() as stack:
        spawn = multiprocessing.get_context("spawn")
        pool = stack.enter_context(ProcessPoolExecutor(min(processes, len(chunks)), spawn, _one_thread))
        stack.callback(pool.shutdown, cancel_futures=True)
        futures: list[Future[list[Result]]] = [pool.submit(play, *chunk) for chunk in chunks]
        for future in as_completed(futures):
            yield future.result()


def _one_thread() -> None:
    """Keep libraries that a process will load from starting threads of their own: the processes share the cores already."""
    os.environ["OMP_NUM_THREADS"] = "1"


def play(name: str, config: EnvConfig, seeds: Sequence[int]) -> list[Result]:
    """Return a policy's episodes on the terrains of some seeds."""
    policy = policy_files.load(name, config.sensor_radius)
    results = []
    for seed in seeds:
        episode = Episode.begin(config, seed=seed)
        policy.reset(seed)
        while not episode.ended:
            episode.step(policy.act(episode.codes))
        steps = steps_to_target(config, episode.outcome, episode.steps)
        ending = (episode.outcome, episode.score, episode.total, episode.steps, steps, episode.coverage)
        results.append(Result(name, seed, *ending))
    return results


def summarize(results: Sequence[Result]) -> Row:
    """Return the row of one policy's episodes (at least two)."""
    scores = np.array([result.score for result in results])
    steps = np.array([result.steps_to_99 for result in results], np.float64)
    outcomes = [result.outcome for result in results]
    return Row(
        results[0].policy,
        len(results),
        float(scores.mean()),
        *interval(scores),
        outcomes.count("explored") / len(results),
        float(steps.mean()),
        *interval(steps),
        outcomes.count("collided") + outcomes.count("out_of_bounds"),
        float(np.mean([result.coverage for result in results])),
    )


def interval(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, float]:
    """Return the 95 % t interval of the mean of at least two values, low and high."""
    half = stats.t.ppf((1 + CONFIDENCE) / 2, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return float(values.mean() - half), float(values.mean() + half)
