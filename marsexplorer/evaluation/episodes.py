"""Play episodes of policies for measurement, in this process or by an executor.

An episode is a function of (policy, config, seed): the seed fixes the terrain, and the policy is
reset with it. So the results do not depend on where, or in how many chunks, the episodes were
played.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from marsexplorer import policies as policy_files
from marsexplorer.config import OBSTACLE, EnvConfig
from marsexplorer.episode import Episode, Record, moves_of, steps_to_target
from marsexplorer.policies import Policy, begin

EPISODES_PER_CHUNK = 5
"""Episodes that a process plays before it reports."""

FEW_CHUNKS = 4
"""Chunks that this process plays sooner than others start."""


@dataclass(frozen=True)
class EpisodeTrace:
    """The course of an episode, cells flat as row * cols + col.

    discovered  cells known after 0, 1, 2, ... moves
    path        the rover's cell after 0, 1, 2, ... moves (it stays where it was after a move off
                the grid)
    obstacles   obstacle cells known at the end
    actions     the moves, codes 0..3; with the seed they are the episode's cause
    """

    discovered: tuple[int, ...]
    path: tuple[int, ...]
    obstacles: tuple[int, ...]
    actions: tuple[int, ...]
    trajectory_hash: str


@dataclass(frozen=True)
class Result:
    """The measures of one episode of one policy; docs/evaluation.md defines each.

    seed         of the terrain, and of the policy's own draws
    score        normalized (section 3.2); total is the return
    steps        moves made; steps_to_99 is `max_steps` for any outcome but `explored`
    cells        that count on the terrain: all, or those that can be discovered
                 (`EnvConfig.discoverable_only`)
    coverage     discovered cells over `cells` at the end, 0..1
    auc          mean coverage after 1, 2, ... `horizon(config)` moves, 0..1
    trace        the course of the episode, None unless it was asked for
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
    cells: int
    trace: EpisodeTrace | None = None

    def figures(self) -> dict[str, object]:
        """All measures by name, without the trace."""
        return {name: measure for name, measure in vars(self).items() if name != "trace"}


@dataclass(frozen=True)
class EpisodeChunk:
    """Episodes to play in one go: of a policy (name or path), on terrains of seeds."""

    policy: str
    config: EnvConfig
    seeds: tuple[int, ...]
    traces: bool = False


def horizon(config: EnvConfig) -> int:
    """The moves over which the area under the coverage curve is taken.

    A quarter of the cells.
    """
    return max(1, config.n // 4)


def area_under_coverage(config: EnvConfig, discovered: Sequence[int], cells: int) -> float:
    """The mean coverage after 1..horizon moves, 0..1; it stays as it is after the end.

    Args:
        config: The configuration of the episode.
        discovered: Cells known after 0, 1, 2, ... moves.
        cells: Cells that count, at least one (`Episode.cells`).
    """
    moves = horizon(config)
    within = discovered[1 : moves + 1]
    return (sum(within) + discovered[-1] * (moves - len(within))) / (moves * cells)


def play_chunk(chunk: EpisodeChunk) -> list[Result]:
    """Play the episodes of a chunk; the results are in the order of its seeds."""
    policy = policy_files.load(chunk.policy, chunk.config.sensor_radius)
    episodes = (play_episode(policy, chunk.config, seed) for seed in chunk.seeds)
    return [
        result_of(chunk.policy, episode, seed, chunk.traces)
        for seed, episode in zip(chunk.seeds, episodes, strict=True)
    ]


def play_episode(policy: Policy, config: EnvConfig, seed: int) -> Episode:
    """Play a policy, reset with the seed, on the terrain of the seed to the end."""
    return play_out(policy, Episode.begin(config, seed=seed), seed)


def play_out(policy: Policy, episode: Episode, seed: int) -> Episode:
    """Play an episode from its start to its end by a policy, reset with `seed`."""
    begin(policy, episode.config.level, seed)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    return episode


def play_terrain(policy: Policy, record: Record, seed: int = 0) -> Episode:
    """Play a policy, reset with `seed`, on the terrain of a recorded episode."""
    return play_out(policy, Episode.again(record), seed)


def result_of(policy: str, episode: Episode, seed: int, traces: bool = False) -> Result:
    """The measures of an episode that has ended; a `running` one is not explored.

    policy  the name or path to put into the result
    """
    config = episode.config
    cause = (policy, config.level, config.rows, config.cols, config.hash, seed)
    measures = (episode.outcome, episode.score, episode.total, episode.steps)
    steps_to_99 = steps_to_target(config, episode.outcome, episode.steps)
    area = area_under_coverage(config, episode.discoveries, episode.cells)
    trace = _trace(episode) if traces else None
    return Result(*cause, *measures, steps_to_99, episode.coverage, area, episode.cells, trace)


def _trace(episode: Episode) -> EpisodeTrace:
    path = tuple(row * episode.config.cols + col for row, col in episode.path)
    obstacles = tuple(np.flatnonzero(episode.codes == OBSTACLE).tolist())
    discovered, actions = tuple(episode.discoveries), tuple(episode.actions)
    return EpisodeTrace(discovered, path, obstacles, actions, episode.record().trajectory_hash)


def make_chunks(
    policies: Sequence[str], configs: Sequence[EnvConfig], seeds: Sequence[int], traces: bool
) -> list[EpisodeChunk]:
    """Divide all episodes to play into chunks."""
    starts = range(0, len(seeds), EPISODES_PER_CHUNK)
    parts = [tuple(seeds[start : start + EPISODES_PER_CHUNK]) for start in starts]
    return [
        EpisodeChunk(name, config, part, traces)
        for config, name, part in product(configs, policies, parts)
    ]


def play_chunks(
    chunks: Sequence[EpisodeChunk], executor: Executor | None
) -> Iterator[list[Result]]:
    """Yield the results chunk by chunk, in any order; no executor: played here."""
    if executor is None:
        yield from map(play_chunk, chunks)
        return
    files = {name: Path(name) for name in {chunk.policy for chunk in chunks}}
    contents = {name: path.read_bytes() for name, path in files.items() if path.is_file()}
    jobs = ((chunk, contents.get(chunk.policy)) for chunk in chunks)
    futures = [executor.submit(play_sent_chunk, *job) for job in jobs]
    try:
        for future in as_completed(futures):
            yield future.result()
    finally:
        for future in futures:
            future.cancel()


def play_sent_chunk(chunk: EpisodeChunk, content: bytes | None) -> list[Result]:
    """Play a chunk where its policy's file may be missing.

    content  the file's bytes, None for a policy without a file
    """
    if content is None:
        return play_chunk(chunk)
    with TemporaryDirectory() as folder:
        path = Path(folder) / Path(chunk.policy).name
        path.write_bytes(content)
        results = play_chunk(replace(chunk, policy=str(path)))
    return [replace(result, policy=chunk.policy) for result in results]


@dataclass(frozen=True)
class Agreement:
    """Moves made, and how many of them a policy would have made too."""

    moves: int = 0
    agreed: int = 0

    def __add__(self, other: Agreement) -> Agreement:
        return Agreement(self.moves + other.moves, self.agreed + other.agreed)

    @property
    def share(self) -> float:
        """Agreed moves over all moves, 0..1; NaN without a move."""
        return self.agreed / self.moves if self.moves else float("nan")


def agreement_with(policy: Policy, record: Record, seed: int = 0) -> Agreement:
    """How many moves of an episode a policy agrees with, shown what the rover saw.

    seed  of what the policy draws, if it draws anything
    """
    begin(policy, record.config.level, seed)
    agreed = sum(policy.act(episode.codes) == action for episode, action in moves_of(record))
    return Agreement(len(record.actions), agreed)
