"""A release's episodes as Minari datasets (HDF5), people's and scripts' apart.

Observations are the codes of `gymnasium.make("MarsExplorer-v0", observation="uint8")`, stored as
they are: Minari's picture compression would change them. Reference scores make Minari's normalized
score the paper's.
"""

from __future__ import annotations

import os
import shlex
import string
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from humanplay.db.trial import Trial
from humanplay.release.errors import library
from humanplay.release.manifest import ReleaseHeader
from humanplay.release.tables import TableRow
from humanplay.task import Configuration, Record, Run
from humanplay.task.registration import environment_of

EPISODES_PER_WRITE, MOVES_PER_WRITE = 64, 4000
"""Most that is held in memory, and an episode more: a minute of Breakout's observations takes 360
MB."""
TEXT_LENGTH = 1000
"""Most characters of an observed text whose space is unknown."""
_METADATA = (
    "participant", "kind", "phase", "trial", "terrain_index", "episode", "driver", "script", "config_hash", "core_version",
    "outcome", "return", "score", "steps_to_99", "trajectory_hash",
)  # fmt: skip


def dataset_id(header: ReleaseHeader, driver: str) -> str:
    """The name that `minari.load_dataset` takes."""
    return f"humanplay/{header.study}/{driver}-v{header.version}"


class MinariWriter:
    """The datasets of a release, one episode after another; call `close` at the end."""

    def __init__(self, root: Path, header: ReleaseHeader) -> None:
        self._minari = library("minari")
        library("h5py")
        self._root, self._header = root, header
        self._waiting: dict[str, list[tuple[TableRow, Configuration, Any]]] = {}
        self._datasets: dict[str, Any] = {}
        self.episodes: dict[str, int] = {}
        self.without_moves = 0

    def add(self, row: TableRow, episode: Run) -> None:
        """Add one episode.

        Minari cannot hold one without a move, so such an episode is only counted.
        """
        if not episode.rewards():
            self.without_moves += 1
            return
        waiting = self._waiting.setdefault(row["driver"], [])
        buffer = _buffer(self._minari, row, episode)
        waiting.append((row, episode.record().config, buffer))
        moves = sum(len(buffered.actions) for *_, buffered in waiting)
        if len(waiting) >= EPISODES_PER_WRITE or moves >= MOVES_PER_WRITE:
            self._flush(row["driver"])

    def close(self) -> None:
        """Write what is still waiting."""
        for driver in self._waiting:
            self._flush(driver)

    def _flush(self, driver: str) -> None:
        waiting = self._waiting[driver]
        if not waiting:
            return
        buffers = [buffer for *_, buffer in waiting]
        first = self.episodes.get(driver, 0)
        if driver in self._datasets:
            self._datasets[driver].update_episodes(buffers)
        else:
            self._datasets[driver] = self._create(driver, *waiting[0][:2], buffers)
        numbers = range(first, first + len(waiting))
        self._datasets[driver].update_episode_metadata(
            [_metadata(row) for row, *_ in waiting], numbers
        )
        self.episodes[driver] = first + len(waiting)
        waiting.clear()

    def _create(self, driver: str, row: TableRow, config: Configuration, buffers: list[Any]) -> Any:
        licence = self._header.protocol.data_licence
        with datasets_in(self._root):
            return _created(
                self._minari,
                dataset_id(self._header, driver),
                row["task"],
                config,
                buffers,
                algorithm_name=driver,
                author="the study's participants, under pseudonyms",
                description=f"{self._header.title} Data licence: {licence}.",
            ).storage


def write_plays(name: str, plays: Iterable[tuple[Trial, Run]]) -> int:
    """Write episodes of one configuration as a dataset where Minari keeps its own.

    Args:
        name: What `minari.load_dataset` takes, such as "lake/people-v0".
        plays: Each episode with its replay; one without a move is left out.

    Returns:
        How many were written.
    """
    minari = library("minari")
    library("h5py")
    dataset = None
    for trial, run in plays:
        if not run.rewards():
            continue
        row = {"task": trial.task, "seed": trial.seed, "outcome": trial.outcome}
        buffers = [_buffer(minari, row, run)]
        if dataset is not None:
            dataset.storage.update_episodes(buffers)
            continue
        dataset = _created(
            minari,
            name,
            trial.task,
            trial.config,
            buffers,
            algorithm_name="human",
            author="people, who chose how often to play",
            description=f"People playing {trial.environment.about.title}.",
        )
    return 0 if dataset is None else int(dataset.storage.total_episodes)


def _created(
    minari: ModuleType,
    name: str,
    task: str,
    config: Configuration,
    buffers: list[Any],
    description: str,
    **more: str,
) -> Any:
    """A new dataset with its first episodes."""
    environment = environment_of(task)
    low, high = environment.returns(config) or (None, None)
    needs = list(environment.requirements)
    env = environment.gymnasium_env(config)
    with warnings.catch_warnings():
        # it misses an address to write to and a link to the code, which there need not be
        warnings.filterwarnings("ignore", message=".* is set to None")
        warnings.filterwarnings("ignore", message="env_spec is None")  # of one that is recorded
        return minari.create_dataset_from_buffers(
            dataset_id=name,
            buffer=buffers,
            env=env,
            observation_space=_storable(env.observation_space),
            description=f"{description} Its environment comes with: pip install {shlex.join(needs)}",
            requirements=needs,
            ref_min_score=low,
            ref_max_score=high,
            data_format="hdf5",
            jpeg_encoding=False,
            **more,
        )


def _buffer(minari: ModuleType, row: TableRow, episode: Run) -> Any:
    record: Record = episode.record()
    moves, environment = len(record.actions), environment_of(row["task"])
    terminated = row["outcome"] not in ("timed_out", "abandoned", "environment_failed")
    return minari.data_collector.EpisodeBuffer(
        seed=row["seed"],
        observations=_stacked(environment.observations(record)),
        actions=environment.own_actions(record.config, record.actions),
        rewards=np.array(episode.rewards(), np.float64),
        terminations=np.array([False] * (moves - 1) + [terminated]),
        truncations=np.array([False] * (moves - 1) + [not terminated]),
        infos=None,
    )


def _stacked(observations: Sequence[Any]) -> object:
    """Observations as Minari takes them.

    They are arrays over the moves, in the dictionaries and tuples of their space.
    """
    first = observations[0]
    if isinstance(first, Mapping):
        return {
            name: _stacked([observation[name] for observation in observations]) for name in first
        }
    if isinstance(first, tuple):
        return tuple(map(_stacked, zip(*observations, strict=True)))
    return list(observations) if isinstance(first, str) else np.stack(observations)


def _storable(space: Any) -> Any:
    """A space that Minari can store.

    One of a package's own, such as MiniGrid's missions, becomes one of texts.
    """
    from gymnasium import spaces
    from minari.serialization import serialize_space

    if isinstance(space, spaces.Dict):
        return spaces.Dict({name: _storable(part) for name, part in space.spaces.items()})
    if isinstance(space, spaces.Tuple):
        return spaces.Tuple(map(_storable, space.spaces))
    try:
        serialize_space(space)
    except NotImplementedError:
        return spaces.Text(TEXT_LENGTH, min_length=0, charset=string.printable)
    return space


def _metadata(row: TableRow) -> dict[str, object]:
    return {name: row[name] for name in _METADATA if row[name] is not None}


@contextmanager
def datasets_in(root: Path) -> Iterator[None]:
    """Let Minari write below `root` inside the block."""
    before = os.environ.get("MINARI_DATASETS_PATH")
    os.environ["MINARI_DATASETS_PATH"] = str(root.resolve())  # it looks below a relative one twice
    try:
        yield
    finally:
        if before is None:
            del os.environ["MINARI_DATASETS_PATH"]
        else:
            os.environ["MINARI_DATASETS_PATH"] = before
