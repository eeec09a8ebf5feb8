"""Episodes played for measurement: in this process, in as many as there are cores, or on a Ray cluster.

An episode is a function of (policy, config, seed): the terrain is the seed's and the policy is reset with the seed. So what
is found does not depend on where or in how many pieces it was played.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice

import numpy as np

from marsexplorer import policies as policy_files
from marsexplorer.config import OBSTACLE, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.informed import informed_walk
from marsexplorer.policies import Policy
from marsexplorer.score import steps_to_target

INFORMED = "informed"
"""The name under which the informed planner stands in results. It is shown the true map and is never a policy."""

CHUNK = 5
"""Episodes a process plays before it reports."""

AHEAD = 4
"""Chunks handed out for each process: a long evaluation does not lie in the queue whole."""

INLINE = 20
"""Up to so many episodes in all are played in this process: starting others costs seconds."""


@dataclass(frozen=True)
class Trace:
    """How an episode went, cells flat as row * cols + col.

    discovered  cells known after 0, 1, 2, ... moves
    path        cells stood on after 0, 1, 2, ... moves (a move off the grid stands still)
    obstacles   obstacle cells known at the end
    """

    discovered: tuple[int, ...]
    path: tuple[int, ...]
    obstacles: tuple[int, ...]


@dataclass(frozen=True)
class Result:
    """One episode of one policy; docs/evaluation.md defines every figure.

    seed         of the terrain, and of the policy's own draws
    score        normalized (section 3.2); total is the return
    steps        moves made; steps_to_99 is `max_steps` for any outcome but `explored`
    coverage     discovered cells over all cells at the end, 0..1
    auc          mean coverage after 1, 2, ... `horizon(config)` moves, 0..1
    trace        the way there, when it was asked for
    """

    policy: str
    level: str
    rows: int
    cols: int
    config_hash: str
    seed: int
    outcome: str
    score: float
    total: float
    steps: int
    steps_to_99: int
    coverage: float
    auc: float
    trace: Trace | None = None


@dataclass(frozen=True)
class Chunk:
    """Some episodes to play: a policy's name or path, or INFORMED, on the terrains of some seeds."""

    policy: str
    config: EnvConfig
    seeds: tuple[int, ...]
    traces: bool = False


def horizon(config: EnvConfig) -> int:
    """Return the moves over which the area under the coverage curve is taken: a quarter of the cells."""
    return max(1, config.n // 4)


def area_under_coverage(config: EnvConfig, discovered: Sequence[int]) -> float:
    """Return the mean coverage after 1..horizon moves, 0..1; after the last move coverage stays as it is.

    discovered  cells known after 0, 1, 2, ... moves
    """
    moves = horizon(config)
    within = discovered[1 : moves + 1]
    return (sum(within) + discovered[-1] * (moves - len(within))) / (moves * config.n)


def play(chunk: Chunk) -> list[Result]:
    """Return the episodes of a chunk."""
    results = []
    policy = None if chunk.policy == INFORMED else policy_files.load(chunk.policy, chunk.config.sensor_radius)
    for seed in chunk.seeds:
        if policy is None:
            episode = Episode.begin(chunk.config, seed=seed)
            for action in informed_walk(chunk.config, episode.terrain, seed):
                episode.step(action)
        else:
            episode = drive(policy, chunk.config, seed)
        results.append(result_of(chunk.policy, episode, seed, chunk.traces))
    return results


def drive(policy: Policy, config: EnvConfig, seed: int) -> Episode:
    """Return a policy's episode on the terrain of a seed, played to its end; the policy draws from the same seed."""
    episode = Episode.begin(config, seed=seed)
    policy.reset(seed)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    return episode


def result_of(policy: str, episode: Episode, seed: int, traces: bool = False) -> Result:
    """Return the figures of an episode that has ended (a `running` one counts as not explored)."""
    config = episode.config
    return Result(
        policy=policy,
        level=config.level,
        rows=config.rows,
        cols=config.cols,
        config_hash=config.hash,
        seed=seed,
        outcome=episode.outcome,
        score=episode.score,
        total=episode.total,
        steps=episode.steps,
        steps_to_99=steps_to_target(config, episode.outcome, episode.steps),
        coverage=episode.coverage,
        auc=area_under_coverage(config, episode.discoveries),
        trace=_trace(episode) if traces else None,
    )


def _trace(episode: Episode) -> Trace:
    path = (row * episode.config.cols + col for row, col in episode.path)
    return Trace(tuple(episode.discoveries), tuple(path), tuple(np.flatnonzero(episode.codes == OBSTACLE).tolist()))


def chunks_of(policies: Sequence[str], configs: Sequence[EnvConfig], seeds: Sequence[int], traces: bool) -> list[Chunk]:
    """Return everything to play in pieces, the slow ones (the informed planner's) singly."""
    chunks = []
    for config in configs:
        for name in policies:
            size = 1 if name == INFORMED else CHUNK
            chunks += [Chunk(name, config, tuple(seeds[at : at + size]), traces) for at in range(0, len(seeds), size)]
    return chunks


def cores() -> int:
    """Return how many processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def played(chunks: Sequence[Chunk], workers: int | None) -> Iterator[list[Result]]:
    """Yield the results chunk by chunk, in any order; processes are spawned, so no lock or thread is inherited.

    workers  processes; None takes one per core, and this process alone for little
    """
    processes = min(workers or cores(), len(chunks))
    if processes == 1 or (workers is None and sum(len(chunk.seeds) for chunk in chunks) <= INLINE):
        yield from map(play, chunks)
        return
    with ExitStack() as stack:
        spawn = multiprocessing.get_context("spawn")
        pool = stack.enter_context(ProcessPoolExecutor(processes, spawn, one_thread))
        stack.callback(pool.shutdown, cancel_futures=True)
        left = iter(chunks)
        waiting = {pool.submit(play, chunk) for chunk in islice(left, AHEAD * processes)}
        while waiting:
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            waiting |= {pool.submit(play, chunk) for chunk in islice(left, len(done))}
            for future in done:
                yield future.result()


def one_thread() -> None:
    """Keep libraries that a process will load from starting threads of their own: the processes share the cores already."""
    os.environ["OMP_NUM_THREADS"] = "1"
