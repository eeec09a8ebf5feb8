"""A release's episodes as Minari datasets (HDF5), people's and scripts' in separate ones.

Observations are the codes of `gymnasium.make("MarsExplorer-v0", observation="uint8")`, kept as they are: Minari's picture
compression would change them. Reference scores make Minari's normalized score the paper's.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import marsexplorer  # noqa: F401  # registers the environment
from app.release.errors import library
from app.release.tables import ReleasedEpisode
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode

EPISODES_PER_WRITE = 64
_CAUSE_METADATA = (
    "participant",
    "kind",
    "phase",
    "trial",
    "terrain_index",
    "episode",
    "driver",
    "script",
    "config_hash",
    "core_version",
)
_RESULT_METADATA = ("outcome", "return", "score", "steps_to_99", "trajectory_hash")


def dataset_id(study: str, driver: str, version: int) -> str:
    """Return the name `minari.load_dataset` takes."""
    return f"marsexplorer/{study}/{driver}-v{version}"


class MinariWriter:
    """The datasets of a release, one episode after another; call `close` at the end."""

    def __init__(self, root: Path, study: str, version: int, title: str, licence: str) -> None:
        self._minari = library("minari")
        library("h5py")
        self._root, self._study, self._version = root, study, version
        self._about = f"{title} Data licence: {licence}. Its environment comes with: pip install marsexplorer-playground"
        self._waiting: dict[str, list[ReleasedEpisode]] = {}
        self._made: dict[str, Any] = {}
        self.episodes: dict[str, int] = {}
        self.without_moves = 0

    def __call__(self, each: ReleasedEpisode) -> None:
        """Add one episode; Minari cannot keep one without a move, so such an episode is only counted."""
        if not each.episode.actions:
            self.without_moves += 1
            return
        waiting = self._waiting.setdefault(each.header["driver"], [])
        waiting.append(each)
        if len(waiting) >= EPISODES_PER_WRITE:
            self._flush(each.header["driver"])

    def close(self) -> None:
        """Write what is still waiting."""
        for driver in self._waiting:
            self._flush(driver)

    def _flush(self, driver: str) -> None:
        waiting = self._waiting[driver]
        if not waiting:
            return
        buffers = [_buffer(self._minari, each) for each in waiting]
        first = self.episodes.get(driver, 0)
        if driver in self._made:
            self._made[driver].update_episodes(buffers)
        else:
            self._made[driver] = self._create(driver, waiting[0].episode.config, buffers)
        numbers = range(first, first + len(waiting))
        self._made[driver].update_episode_metadata([_metadata(each) for each in waiting], numbers)
        self.episodes[driver] = first + len(waiting)
        waiting.clear()

    def _create(self, driver: str, config: EnvConfig, buffers: list[Any]) -> Any:
        env = gymnasium.make("MarsExplorer-v0", **environment(config), disable_env_checker=True)
        with _datasets_in(self._root):
            return self._minari.create_dataset_from_buffers(
                dataset_id=dataset_id(self._study, driver, self._version),
                buffer=buffers,
                env=env,
                algorithm_name=driver,
                author="the study's participants, under pseudonyms",
                description=self._about,
                requirements=["marsexplorer-playground"],
                ref_min_score=float(-config.r_invalid),
                ref_max_score=float(config.r_bonus + config.n),
                data_format="hdf5",
                jpeg_encoding=False,
            ).storage


def environment(config: EnvConfig) -> dict[str, Any]:
    """Return what `gymnasium.make` takes to give the episodes' environment."""
    rest = {
        "sensor_radius": config.sensor_radius,
        "beta": config.beta,
        "max_steps": config.max_steps,
    }
    return {
        "level": config.level,
        "size": (config.rows, config.cols),
        **rest,
        "observation": "uint8",
    }


def observations(each: ReleasedEpisode) -> list[np.ndarray]:
    """Return what was seen before each move and after the last: uint8[rows, cols]."""
    episode = Episode.begin(
        each.episode.config, terrain=each.episode.terrain, start=each.episode.start
    )
    found = [episode.codes.copy()]
    for action in each.episode.actions:
        episode.step(action)
        found.append(episode.codes.copy())
    return found


def _buffer(minari: Any, each: ReleasedEpisode) -> Any:
    moves = len(each.episode.actions)
    outcome = each.header["outcome"]
    terminated = outcome in ("explored", "collided", "out_of_bounds")
    return minari.data_collector.EpisodeBuffer(
        seed=each.header["seed"],
        observations=np.stack(observations(each)),
        actions=np.frombuffer(bytes(each.episode.actions), np.uint8).astype(np.int64),
        rewards=np.array(each.episode.rewards, np.float64),
        terminations=np.array([False] * (moves - 1) + [terminated]),
        truncations=np.array([False] * (moves - 1) + [not terminated]),
        infos=None,
    )


def _metadata(each: ReleasedEpisode) -> dict[str, Any]:
    return {
        name: each.header[name]
        for name in (*_CAUSE_METADATA, *_RESULT_METADATA)
        if each.header[name] is not None
    }


@contextmanager
def _datasets_in(root: Path) -> Iterator[None]:
    """Let Minari write below `root` inside the block."""
    before = os.environ.get("MINARI_DATASETS_PATH")
    os.environ["MINARI_DATASETS_PATH"] = str(root.resolve())  # it looks below a relative one twice
    try:
        with warnings.catch_warnings():
            # it misses an address to write to and a link to the code, which a study need not have
            warnings.filterwarnings("ignore", message=".* is set to None")
            yield
    finally:
        if before is None:
            del os.environ["MINARI_DATASETS_PATH"]
        else:
            os.environ["MINARI_DATASETS_PATH"] = before
