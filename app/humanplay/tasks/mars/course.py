"""The course of an episode: when each cell became known, and where the rover was after each move.

It is that of a finished episode, or of a policy on its terrain, to compare with: its ghost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from humanplay.task import GhostError, PolicyOffer, counted
from humanplay.tasks.mars.run import encode_grid
from marsexplorer.config import ACTIONS, FREE, MAP, ROVER, UNKNOWN, EnvConfig
from marsexplorer.episode import Episode, Record, replay
from marsexplorer.policies import begin, load
from marsexplorer.policies import names as shipped

NEVER = -1
"""The move at which a cell became known that never did."""
LARGE_SIDE = 60
"""A board with a longer side than this, cells, is large in an animation."""
PREFERRED = ("ppo", "frontier-cost")
"""The policy that is shown when none is asked for: the first of these that did not drive the episode itself."""


PLAIN_POLICIES = {
    "ppo": "Expert", "frontier-cost": "Nearest", "frontier-utility": "Greedy", "frontier-priced": "Tidy",
    "lookahead": "Expert that knows how terrains are made", "random": "Random",
}  # fmt: skip
"""Names of policies as pages and pictures say them; `static/task/mars/names.js` has the same."""
PLAIN_LEVELS = {
    "1-1-1": "Open", "random": "Scattered", "3-2-1": "Boulders", "building": "Building", "cave": "Cave"
}  # fmt: skip
"""Those of levels; any other has the paper's code."""

NextAction = Callable[[NDArray[np.uint8]], int | None]


@dataclass(frozen=True)
class Course:
    """What a replay draws of one episode; index k of each sequence is the board after k moves.

    name        who drove
    config      of the episode
    actions     codes of config.ACTIONS, one a move
    path        (row, col) of the rover, one more than actions
    discovered  cells known, one more than actions
    cells       that coverage refers to: all, or those that can be discovered
    codes       uint8[rows, cols], what was known at the end, the rover's cell as FREE
    known_since int32[rows, cols], after how many moves each cell was known; NEVER for one that was not
    outcome     in words
    score       normalized, at the end
    """

    name: str
    config: EnvConfig
    actions: bytes
    path: tuple[tuple[int, int], ...]
    discovered: tuple[int, ...]
    cells: int
    codes: NDArray[np.uint8]
    known_since: NDArray[np.int32]
    outcome: str
    score: float

    @property
    def place(self) -> str:
        """Where it was played, in words."""
        level = self.config.level
        return "a map" if level == MAP else PLAIN_LEVELS.get(level) or f"level {level}"

    @property
    def moves(self) -> int:
        """Moves in all."""
        return len(self.actions)

    def coverage(self, step: int) -> float:
        """Return the share of the cells known after some moves, 0..1; a course that has ended stays at its end."""
        return self.discovered[min(step, self.moves)] / self.cells

    @property
    def headline(self) -> str:
        """Who did what: `A person mapped 99 % of the ground in 75 moves`."""
        return f"{self.plain_name} {sentence(self)}"

    @property
    def plain_name(self) -> str:
        """Who drove, a policy by its plain name."""
        return PLAIN_POLICIES.get(self.name, self.name)

    def preview(self) -> bytes:
        """Return the end as a PNG."""
        from humanplay.tasks.mars.pictures import preview

        return preview(self)

    def animation(self, others: Sequence[Course], is_large: bool) -> Any:
        """Return what draws the course after each move, with others beside it."""
        from humanplay.tasks.mars.pictures import AnimationPicture, Look

        look = Look(board=540, margin=30, text=24) if is_large else Look()
        return AnimationPicture([self, *others], look)

    @property
    def is_large(self) -> bool:
        """Whether a move changes much of a picture of the board."""
        return max(self.config.rows, self.config.cols) > LARGE_SIDE

    def about(self) -> dict[str, Any]:
        """Return what the page is told of where it was played."""
        config = self.config
        return {"level": config.level, "rows": config.rows, "cols": config.cols}

    def to_dict(self) -> dict[str, Any]:
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
    """Return the course of a finished episode; ValueError when this version's rules cannot replay it."""
    ended = replay(record)
    actions = iter(record.actions)
    return _course(name, Episode.again(record), lambda _: next(actions, None), ended)


def _course(name: str, episode: Episode, next_action: NextAction, ended: Episode) -> Course:
    """Return the course of an episode from its start on, made move by move until `next_action` returns None."""
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


def sentence(course: Course) -> str:
    """Return what a course came to, after the name: `mapped 99 % of the ground in 75 moves`."""
    share, moves = f"{floor(1000 * course.coverage(course.moves) + 1e-6) / 10:.1f} %", course.moves
    count = counted(moves, "move")
    return {
        "explored": f"mapped {share} of the ground in {count}",
        "collided": f"crashed into a rock at {share} after {count}",
        "out_of_bounds": f"drove off the map at {share} after {count}",
        "timed_out": f"ran out of moves at {share} after {count}",
    }.get(course.outcome, f"left at {share} after {count}")


def choices(offers: Sequence[PolicyOffer], config: EnvConfig) -> list[str]:
    """Return the names of the policies that play boards of this size."""
    return [offer.name for offer in offers if offer.size in (None, (config.rows, config.cols))]


def preferred(driver: str, names: Sequence[str] | None = None) -> str | None:
    """Return the policy to show beside a driver; None where only the driver itself is on offer.

    names  of those on offer; None: the shipped ones
    """
    names = shipped() if names is None else names
    return next((name for name in (*PREFERRED, *names) if name in names and name != driver), None)


def play_ghost(source: str, record: Record) -> Course:
    """Return the course of a policy from the start of a record on its terrain; GhostError where it cannot be had.

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
