"""A board as a picture: the ground in the colours of every page, the path of one rover or two, a crash."""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from app.replay.course import NEVER, Course
from marsexplorer.config import ACTIONS, OBSTACLE

Colour = tuple[int, int, int]
NIGHT: Colour = (14, 11, 13)
SOIL: Colour = (168, 98, 60)
SOIL_EDGE: Colour = (147, 82, 49)
ROCK: Colour = (220, 203, 184)
ROCK_EDGE: Colour = (189, 169, 143)
SHOWN_NOW: Colour = (201, 144, 102)
"""Ground that the last move has shown."""
AMBER: Colour = (255, 179, 71)
TEAL: Colour = (95, 208, 197)
ALARM: Colour = (255, 92, 69)
ROVERS = (AMBER, TEAL)
"""Colours of the episode's own rover and of the policy's beside it."""
_FINE = 4
"""Pixels that a pixel of a sprite is made from."""
_HEADINGS = {"north": 90, "east": 0, "south": 270, "west": 180}
_AROUND = {"north": (-1, 0), "east": (0, 1), "south": (1, 0), "west": (0, -1)}


def pixels_a_cell(course: Course, pixels: int) -> int:
    """Return how many pixels a cell gets so that the longer side of the board stays within `pixels`."""
    return max(1, pixels // max(course.config.rows, course.config.cols))


def board_picture(
    course: Course,
    step: int,
    cell: int,
    colour: Colour,
    other: tuple[Course, Colour] | None = None,
    before: int | None = None,
) -> Image.Image:
    """Return a board as it stood after some moves; `cell` is the side of a cell in pixels.

    other   a second rover whose path is drawn dashed
    before  the move of the picture before this one: ground that has been shown since is lighter; None for none
    """
    picture = _ground(course, step, cell, step if before is None else before)
    draw = ImageDraw.Draw(picture)
    if other is not None:
        _draw_path(draw, other[0], step, cell, other[1], is_dashed=True)
    _draw_path(draw, course, step, cell, colour)
    at = min(step, course.moves)
    heading = ACTIONS[course.actions[at - 1]] if at else "east"
    side = max(cell, 7)
    row, col = course.path[at]
    corner = (round((col + 0.5) * cell - side / 2), round((row + 0.5) * cell - side / 2))
    picture.paste(_rover(side, colour, heading), corner)
    if step >= course.moves and course.outcome in ("collided", "out_of_bounds"):
        _mark_crash(picture, course, cell)
    return picture


def _ground(course: Course, step: int, cell: int, before: int) -> Image.Image:
    """Return the cells alone, with lines between them where there is room."""
    known = (course.known_since != NEVER) & (course.known_since <= step)
    fresh = known & (course.known_since > before)
    cells = np.empty((*course.codes.shape, 3), np.uint8)
    cells[:] = NIGHT
    is_rock = course.codes == OBSTACLE
    for mask, colour in (
        (known & ~is_rock, SOIL),
        (fresh & ~is_rock, SHOWN_NOW),
        (known & is_rock, ROCK),
    ):
        cells[mask] = colour
    pixels: NDArray[np.uint8] = np.repeat(np.repeat(cells, cell, 0), cell, 1)
    if cell >= 7:
        edges = cells.copy()
        edges[known & ~is_rock] = SOIL_EDGE
        edges[known & is_rock] = ROCK_EDGE
        pixels[cell - 1 :: cell] = np.repeat(edges, cell, 1)
        pixels[:, cell - 1 :: cell] = np.repeat(edges, cell, 0)
    return Image.fromarray(pixels)


def _draw_path(
    draw: ImageDraw.ImageDraw,
    course: Course,
    step: int,
    cell: int,
    colour: Colour,
    is_dashed: bool = False,
) -> None:
    """Draw the way of a rover from its start, cell by cell."""
    width = max(1, round(cell * 0.16))
    points = [
        ((col + 0.5) * cell, (row + 0.5) * cell)
        for row, col in course.path[: min(step, course.moves) + 1]
    ]
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        if (x0, y0) == (x1, y1):
            continue
        if is_dashed:  # the second half of each cell's way stays open
            x1, y1 = (x0 + x1) / 2, (y0 + y1) / 2
        grow = width / 2 if not is_dashed else 0
        left, right, top, bottom = min(x0, x1), max(x0, x1), min(y0, y1), max(y0, y1)
        half_x, half_y = (grow, width / 2) if y0 == y1 else (width / 2, grow)
        draw.rectangle(
            (left - half_x, top - half_y, right + half_x - 1, bottom + half_y - 1), fill=colour
        )


@lru_cache(maxsize=64)
def _rover(side: int, colour: Colour, heading: str) -> Image.Image:
    """Return a square rover with an arrow that shows where it heads."""
    fine = side * _FINE
    picture = Image.new("RGB", (fine, fine), colour)
    if side >= 7:
        middle = fine / 2
        tip, back, wing = fine * 0.32, fine * 0.22, fine * 0.26
        arrow = [
            (middle + tip, middle),
            (middle - back, middle - wing),
            (middle - back, middle + wing),
        ]
        ImageDraw.Draw(picture).polygon(arrow, fill=NIGHT)
        picture = picture.rotate(_HEADINGS[heading])
    return picture.resize((side, side), Image.Resampling.LANCZOS)


def _mark_crash(picture: Image.Image, course: Course, cell: int) -> None:
    """Draw a cross on the rock that was hit, or at the edge that was driven over."""
    down, right = _AROUND[ACTIONS[course.actions[-1]]]
    (row, col), (row_before, col_before) = course.path[-1], course.path[-2]
    if (row, col) == (row_before, col_before):
        row, col = row + down, col + right
    side = max(cell, 9)
    x = min(max(col + 0.5, 0.5), course.config.cols - 0.5) * cell
    y = min(max(row + 0.5, 0.5), course.config.rows - 0.5) * cell
    fine = side * _FINE
    cross = Image.new("L", (fine, fine), 0)
    draw, inset, width = ImageDraw.Draw(cross), fine * 0.18, round(fine * 0.18)
    draw.line((inset, inset, fine - inset, fine - inset), fill=255, width=width)
    draw.line((inset, fine - inset, fine - inset, inset), fill=255, width=width)
    mask = cross.resize((side, side), Image.Resampling.LANCZOS)
    picture.paste(
        Image.new("RGB", (side, side), ALARM), (round(x - side / 2), round(y - side / 2)), mask
    )
