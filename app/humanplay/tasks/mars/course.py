"""An episode's course: when each cell became known, and where the rover went.

It is that of a finished episode, or of a policy on its terrain, to compare with: its ghost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from humanplay import task as seam
from humanplay.task import GhostError
from humanplay.tasks.mars.drawn import NEVER, DrawnEpisode, sentence
from humanplay.tasks.mars.pictures import AnimationPicture, Look, challenge_preview, preview
from humanplay.tasks.mars.run import encode_grid
from marsexplorer.config import ACTIONS, FREE, ROVER, UNKNOWN
from marsexplorer.episode import Episode, Record, replay
from marsexplorer.policies import begin, load
from marsexplorer.policies import names as shipped

LARGE_SIDE = 60
"""A board with a longer side than this, cells, is large in an animation."""
PREFERRED = ("ppo", "frontier-cost")
"""The policy that is shown when none is asked for: the first of these that did not drive the episode itself."""


NextAction = Callable[[NDArray[np.uint8]], int | None]


@dataclass(frozen=True)
class Course(DrawnEpisode):
    """What a replay shows of one episode."""

    task: ClassVar[str] = "mars"

    def with_name(self, name: str) -> Course:
        """The same course under another name."""
        return replace(self, name=name)

    def preview(self, is_challenge: bool = False) -> bytes:
        """Return the end as a PNG, or what is seen before the first move."""
        return challenge_preview(self) if is_challenge else preview(self)

    def animation(self, others: Sequence[seam.Course], is_large: bool) -> AnimationPicture:
        """Return what draws the course after each move, with others of the task beside it."""
        look = Look(board=540, margin=30, text=24) if is_large else Look()
        beside = [course for course in others if isinstance(course, Course)]
        return AnimationPicture([self, *beside], look)

    @property
    def is_large(self) -> bool:
        """Whether a move changes much of a picture of the board."""
        return max(self.config.rows, self.config.cols) > LARGE_SIDE

    def to_dict(self) -> dict[str, object]:
        """Return the course as the page reads it."""
        return {
            "name": self.name,
            "actions": [ACTIONS[action] for action in self.actions],
            "positions": [list(cell) for cell in self.path],
            "discovered": list(self.discovered),
            "cells": self.cells,
            "grid": encode_grid(self.codes),
            "known_since": self.known_since.tolist(),
            "outcome": self.outcome,
            "score": self.score,
            "sentence": sentence(self),
        }


def course_of(name: str, record: Record) -> Course:
    """Return a finished episode's course; ValueError if these rules cannot replay it."""
    ended = replay(record)
    actions = iter(record.actions)
    return _course(name, Episode.again(record), lambda _: next(actions, None), ended)


def _course(name: str, episode: Episode, next_action: NextAction, ended: Episode) -> Course:
    """Return an episode's course, played until `next_action` returns None."""
    known_since = np.where(episode.codes != UNKNOWN, 0, NEVER).astype(np.int32)
    while (action := next_action(episode.codes)) is not None:
        episode.step(action)
        known_since[(episode.codes != UNKNOWN) & (known_since == NEVER)] = episode.steps
    codes = episode.codes.copy()
    codes[codes == ROVER] = FREE
    return Course(
        name=name,
        config=episode.config,
        actions=bytes(episode.actions),
        path=tuple((int(row), int(col)) for row, col in episode.path),
        discovered=tuple(int(count) for count in episode.discoveries),
        cells=int(episode.cells),
        codes=codes,
        known_since=known_since,
        outcome=ended.outcome,
        score=float(ended.score),
    )


def preferred(driver: str, names: Sequence[str] | None = None) -> str | None:
    """Return the policy to show beside a driver; None if only the driver is on offer.

    names  of those on offer; None: the shipped ones
    """
    names = shipped() if names is None else names
    return next((name for name in (*PREFERRED, *names) if name in names and name != driver), None)


def play_ghost(source: str, record: Record) -> Course:
    """Return a policy's course from the start of a record; GhostError if it has none.

    The policy is given what its own rover discovers, as everywhere, and is reset with 0, so that every call gives the same.

    source  what `policies.load` takes: a name or a path
    """
    config = record.config
    try:
        policy = load(source, config.sensor_radius)
    except (LookupError, ValueError, OSError) as error:
        raise GhostError(f"the policy cannot be loaded: {error}") from error
    if getattr(policy, "size", None) not in (None, (config.rows, config.cols)):
        size = f"{config.rows}x{config.cols}"
        raise GhostError(f"{policy.name} plays no boards of {size}; choose another policy")
    begin(policy, config.level, 0)
    episode = Episode.again(record)

    def next_action(codes: NDArray[np.uint8]) -> int | None:
        return None if episode.ended else policy.act(codes.copy())

    return _course(policy.name, episode, next_action, episode)
