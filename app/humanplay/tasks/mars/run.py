"""An episode of MarsExplorer on a board, and what may be seen of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import TypedDict

import msgspec
import numpy as np
from numpy.typing import NDArray

from humanplay.task import AgentObservation, Allowed, counted
from humanplay.tasks.mars.colours import data_url
from humanplay.tasks.mars.messages import MAX_DRAWN_SIDE
from marsexplorer.config import ACTIONS
from marsexplorer.episode import Episode
from marsexplorer.warmup import step_once

CELL_CHARACTERS = bytes.maketrans(bytes(range(4)), b"?.@#")
"""Code of a cell -> its character in a frame's grid."""

_ENCODER = msgspec.json.Encoder()


def encode_grid(codes: NDArray[np.uint8]) -> list[str]:
    """Return a known map, codes uint8[rows, cols], as the `grid` of a frame."""
    rows, cols = codes.shape
    cells = codes.tobytes().translate(CELL_CHARACTERS).decode()
    return [cells[start : start + cols] for start in range(0, rows * cols, cols)]


_DIGITS = np.array([0, 1, 1, 2], np.uint8)
"""Code of a cell -> its digit to the base 3 in a packed row; the rover's is that of free ground."""
_PACKED = np.array([number for number in range(35, 117) if number != ord("\\")], np.uint8)
"""Four digits to the base 3 -> a character that JSON writes as one byte."""


def pack_grid(codes: NDArray[np.uint8]) -> list[str]:
    """Return a known map as the `grid` of a packed frame: four cells in a character."""
    rows, cols = codes.shape
    digits = np.zeros((rows, -(-cols // 4) * 4), np.uint8)
    digits[:, :cols] = _DIGITS[codes]
    numbers = digits.reshape(rows, -1, 4) @ np.array([27, 9, 3, 1], np.uint8)
    return [row.tobytes().decode() for row in _PACKED[numbers]]


def occupancy_codes(frame: Mapping[str, object]) -> NDArray[np.uint8]:
    """What a frame shows: uint8[rows, cols], 0 unknown, 1 free, 2 rover, 3 obstacle."""
    grid = frame["grid"]
    if not isinstance(grid, list):
        raise TypeError(f"expected a frame whose grid is a list of rows, got {grid!r}")
    if "packed" in frame:
        return _unpack_grid(frame, grid)
    return np.array([["?.@#".index(cell) for cell in row] for row in grid], np.uint8)


def _unpack_grid(frame: Mapping[str, object], grid: list[str]) -> NDArray[np.uint8]:
    """What a packed frame shows, as `occupancy_codes` has it."""
    cols, position = frame["cols"], frame["position"]
    assert isinstance(cols, int)
    assert isinstance(position, (list, tuple))
    numbers = np.searchsorted(_PACKED, np.array([list(row.encode()) for row in grid], np.uint8))
    digits = numbers[..., None] // np.array([27, 9, 3, 1]) % 3
    codes: NDArray[np.uint8] = np.array([0, 1, 3], np.uint8)[
        digits.reshape(len(grid), -1)[:, :cols]
    ]
    codes[tuple(position)] = 2
    return codes


@cache
def _load_step() -> None:
    """Load the compiled move, or raise NotReadyError.

    A board moves on its event loop, where nothing may take long.
    """
    step_once()


class ShownMap(TypedDict):
    """What a frame shows of a map and a rover; coverage is a share of `cells`."""

    rows: int
    cols: int
    grid: list[str]
    position: list[int]
    discovered: int
    cells: int
    coverage: float
    heading: str


class MarsRun:
    """One running episode (`humanplay.task.Run`)."""

    def __init__(self, episode: Episode) -> None:
        _load_step()
        self._episode = episode
        self.step, self.abandon, self.record = episode.step, episode.abandon, episode.record

    def observation(self) -> NDArray[np.uint8]:
        """Return a copy of what is known: uint8[rows, cols]."""
        return self._episode.codes.copy()

    def agent_observation(self, picture: bool, observation: bool) -> AgentObservation:
        """Return the known map as a picture and as an observation, without scores."""
        view = self.view()
        drawn = data_url(view.codes) if picture else None
        shown = view.shown_map() if observation else None
        text = None if shown is None else text_frame(shown)
        return {"picture": drawn, "text": text, "observation": shown, "allowed": None}

    def rewards(self) -> Sequence[float]:
        """Return the reward of each move."""
        return self._episode.rewards

    def counts(self) -> Sequence[int]:
        """Return the cells discovered after 0, 1, 2, ... moves."""
        return self._episode.discoveries

    def allowed(self) -> Sequence[Allowed]:
        """Nothing: every move may be made, and an invalid one ends the episode."""
        return ()

    def place(self, step: int) -> dict[str, float]:
        """Return row, column and coverage after so many moves."""
        row, col = self._episode.place(step)
        discovered = self._episode.discoveries[step]
        return {"row": row, "col": col, "coverage": discovered / self._episode.cells}

    @property
    def ended(self) -> bool:
        """Whether the episode has an outcome."""
        return self._episode.ended

    @property
    def path(self) -> list[tuple[int, int]]:
        """(row, col) of the rover after 0, 1, 2, ... moves."""
        return self._episode.path

    @property
    def cells(self) -> int:
        """How many cells coverage refers to."""
        return int(self._episode.cells)

    def view(self) -> View:
        """Return what may be seen of the run as it stands."""
        return View(self._episode)


class View:
    """An episode's view, which stays the same as the episode goes on.

    The terrain is not in it.

    allowed  None: every move may be made
    codes  uint8[rows, cols], what is known: UNKNOWN 0, FREE 1, ROVER 2, OBSTACLE 3
    The other attributes are those of `marsexplorer.episode.Episode` (`humanplay.task.View`).
    """

    allowed: Allowed = None

    def __init__(self, episode: Episode) -> None:
        self._episode = episode
        self.config = episode.config
        self.codes = episode.codes.copy()
        self.position = episode.position
        self.discovered = episode.discovered
        self.cells = episode.cells
        self.steps, self.outcome = episode.steps, episode.outcome
        self.reward, self.total, self.score = episode.reward, episode.total, episode.score
        self.ended = episode.ended

    def is_of_same_run(self, other: View) -> bool:
        """Return whether the other view shows the same episode, earlier or later."""
        return self._episode is other._episode

    def observation(self) -> NDArray[np.uint8]:
        """Return a copy of what is known: uint8[rows, cols]."""
        return self.codes.copy()

    @property
    def coverage(self) -> float:
        """Discovered cells over the cells that count, 0..1."""
        return self.discovered / self.cells

    @property
    def heading(self) -> str:
        """Direction of the last move in words, `east` before the first."""
        return ACTIONS[self._episode.actions[self.steps - 1]] if self.steps else "east"

    @property
    def actions(self) -> bytes:
        """The moves so far, a byte each, codes 0..3."""
        return bytes(self._episode.actions[: self.steps])

    @property
    def path(self) -> list[tuple[int, int]]:
        """(row, col) of the rover after 0, 1, 2, ... moves: a new list."""
        return self._episode.path[: self.steps + 1]

    @property
    def discoveries(self) -> list[int]:
        """Cells discovered after 0, 1, 2, ... moves: a new list."""
        return list(self._episode.discoveries[: self.steps + 1])

    def shown_map(self) -> ShownMap:
        """Return the map and the rover as a frame shows them."""
        rows, cols = self.codes.shape
        row, col = self.position
        return {
            "rows": rows,
            "cols": cols,
            "grid": encode_grid(self.codes),
            "position": [int(row), int(col)],
            "discovered": int(self.discovered),
            "cells": int(self.cells),
            "coverage": float(self.coverage),
            "heading": self.heading,
        }

    def _frame_map(self) -> Mapping[str, object]:
        """The map and the rover, packed on a large board."""
        shown = self.shown_map()
        if max(self.codes.shape) <= MAX_DRAWN_SIDE:
            return shown
        return {**shown, "grid": pack_grid(self.codes), "packed": True}

    def frame(self, episode_id: str, hides_scores: bool = False) -> str:
        """Return the frame as JSON text; reward, return and score null if hidden."""
        frame = {
            "kind": "frame",
            "episode": episode_id,
            "step": self.steps,
            **self._frame_map(),
            "reward": None if hides_scores else float(self.reward),
            "return": None if hides_scores else float(self.total),
            "score": None if hides_scores else float(self.score),
            "outcome": self.outcome if self.ended else None,
        }
        return _ENCODER.encode(frame).decode()

    def history(self, episode_id: str, hides_scores: bool = False) -> str:
        """Return the path so far as JSON text."""
        history = {
            "kind": "history",
            "episode": episode_id,
            "positions": self.path,
            "discovered": self.discoveries,
        }
        return _ENCODER.encode(history).decode()


TEXT_SIDE = 25
"""Rows and columns of a text frame at most, so that it stays below 1 kB."""


def text_frame(shown: ShownMap) -> str:
    """Return a map and the rover as a matrix with a legend.

    Of a large board it has the part around the rover.
    """
    row, col = shown["position"]
    spans = []
    for at, cells in ((row, shown["rows"]), (col, shown["cols"])):
        first = max(0, min(at - TEXT_SIDE // 2, cells - TEXT_SIDE))
        spans.append(range(first, min(cells, first + TEXT_SIDE)))
    rows, cols = spans
    matrix = [f"{number:3} {shown['grid'][number][cols[0] : cols[-1] + 1]}" for number in rows]
    size = (
        f"{counted(shown['rows'], 'row')} from north to south, "
        f"{counted(shown['cols'], 'column')} from west to east"
    )
    part = f"here are rows {rows[0]} to {rows[-1]} (each with its number), columns {cols[0]} to {cols[-1]}"
    legend = (
        f"@ the rover, at row {row}, column {col}; ? not seen yet; . free; # rock. "
        f"{shown['coverage']:.1%} is mapped."
    )
    return "\n".join((f"{size}; {part}.", legend, *matrix))
