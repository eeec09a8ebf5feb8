"""Pictures of a replay: boards with paths, the animation, the link's preview."""

from __future__ import annotations

import io
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import floor

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from humanplay.tasks.mars.colours import AMBER, NIGHT, ROCK, SOIL, Colour
from humanplay.tasks.mars.drawn import NEVER, DrawnEpisode, sentence
from marsexplorer.config import ACTIONS, OBSTACLE

SOIL_EDGE: Colour = (147, 82, 49)
ROCK_EDGE: Colour = (189, 169, 143)
SHOWN_NOW: Colour = (201, 144, 102)
"""Ground that the last move has shown."""
TEAL: Colour = (95, 208, 197)
ALARM: Colour = (255, 92, 69)
ROVERS = (AMBER, TEAL)
"""Colours of the episode's own rover and of the policy's beside it."""
_FINE = 4
"""Pixels that a pixel of a sprite is made from."""
_HEADINGS = {"north": 90, "east": 0, "south": 270, "west": 180}
_AROUND = {"north": (-1, 0), "east": (0, 1), "south": (1, 0), "west": (0, -1)}
PREVIEW = (1200, 630)
"""Width and height in pixels that sites show a preview of a link in."""
TEXT: Colour = (241, 231, 222)
MUTED: Colour = (179, 162, 151)
LINE: Colour = (58, 44, 40)
GOAL = 0.99


def pixels_a_cell(course: DrawnEpisode, pixels: int) -> int:
    """Return the pixels of a cell's side, so that a board's longer side fits `pixels`."""
    return max(1, pixels // max(course.config.rows, course.config.cols))


def board_picture(
    course: DrawnEpisode,
    step: int,
    cell: int,
    colour: Colour,
    other: tuple[DrawnEpisode, Colour] | None = None,
    before: int | None = None,
) -> Image.Image:
    """Return a board after some moves; `cell` is a cell's side in pixels.

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


def _ground(course: DrawnEpisode, step: int, cell: int, before: int) -> Image.Image:
    """Return the cells alone, with lines between them where there is room."""
    is_known = (course.known_since != NEVER) & (course.known_since <= step)
    fresh = is_known & (course.known_since > before)
    cells = np.empty((*course.codes.shape, 3), np.uint8)
    cells[:] = NIGHT
    is_rock = course.codes == OBSTACLE
    cells[is_known & ~is_rock] = SOIL
    cells[fresh & ~is_rock] = SHOWN_NOW
    cells[is_known & is_rock] = ROCK
    pixels: NDArray[np.uint8] = np.repeat(np.repeat(cells, cell, 0), cell, 1)
    if cell >= 7:
        edges = cells.copy()
        edges[is_known & ~is_rock] = SOIL_EDGE
        edges[is_known & is_rock] = ROCK_EDGE
        pixels[cell - 1 :: cell] = np.repeat(edges, cell, 1)
        pixels[:, cell - 1 :: cell] = np.repeat(edges, cell, 0)
    return Image.fromarray(pixels)


def _draw_path(
    draw: ImageDraw.ImageDraw,
    course: DrawnEpisode,
    step: int,
    cell: int,
    colour: Colour,
    is_dashed: bool = False,
) -> None:
    """Draw the way of a rover from its start, cell by cell."""
    width = max(1, round(cell * 0.16))
    path = course.path[: min(step, course.moves) + 1]
    points = [((col + 0.5) * cell, (row + 0.5) * cell) for row, col in path]
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        if (x0, y0) == (x1, y1):
            continue
        if is_dashed:  # the second half of each cell's way stays open
            x1, y1 = (x0 + x1) / 2, (y0 + y1) / 2
        grow = width / 2 if not is_dashed else 0
        left, right, top, bottom = min(x0, x1), max(x0, x1), min(y0, y1), max(y0, y1)
        wide, high = (grow, width / 2) if y0 == y1 else (width / 2, grow)
        draw.rectangle((left - wide, top - high, right + wide - 1, bottom + high - 1), fill=colour)


@lru_cache(maxsize=64)
def _rover(side: int, colour: Colour, heading: str) -> Image.Image:
    """Return a square rover with an arrow that shows where it heads."""
    fine = side * _FINE
    picture = Image.new("RGB", (fine, fine), colour)
    if side >= 7:
        middle = fine / 2
        tip, back, wing = fine * 0.32, fine * 0.22, fine * 0.26
        foot = middle - back
        arrow = [(middle + tip, middle), (foot, middle - wing), (foot, middle + wing)]
        ImageDraw.Draw(picture).polygon(arrow, fill=NIGHT)
        picture = picture.rotate(_HEADINGS[heading])
    return picture.resize((side, side), Image.Resampling.LANCZOS)


def _mark_crash(picture: Image.Image, course: DrawnEpisode, cell: int) -> None:
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
    corner = (round(x - side / 2), round(y - side / 2))
    picture.paste(Image.new("RGB", (side, side), ALARM), corner, mask)


@dataclass(frozen=True)
class Look:
    """Sizes in pixels: the board's longer side at most, the margin and the text."""

    board: int = 360
    margin: int = 20
    text: int = 16


class AnimationPicture:
    """Draws the boards of one course or two, with names, moves and coverage."""

    def __init__(self, courses: Sequence[DrawnEpisode], look: Look) -> None:
        self._courses, self._look = courses, look
        self._cell = pixels_a_cell(courses[0], look.board)
        config = courses[0].config
        self._width, self._height = config.cols * self._cell, config.rows * self._cell
        self._column = max(self._width, look.text * 17)
        count = len(courses)
        width = count * self._column + (count + 1) * look.margin
        height = self._height + round(5.4 * look.text) + 2 * look.margin
        self.size = (width + width % 2, height + height % 2)
        """(width, height): even numbers, as the codecs of videos want them."""

    def at(self, step: int, before: int) -> Image.Image:
        """Return the picture after some moves; cells seen after `before` are lighter."""
        picture = Image.new("RGB", self.size, NIGHT)
        for number, (course, colour) in enumerate(zip(self._courses, ROVERS, strict=False)):
            rovers = zip(self._courses, ROVERS, strict=False)
            other = next((rover for rover in rovers if rover[0] is not course), None)
            left = self._look.margin + number * (self._column + self._look.margin)
            board = board_picture(course, step, self._cell, colour, other, before)
            top = self._look.margin + round(2.2 * self._look.text)
            picture.paste(board, (left + (self._column - self._width) // 2, top))
            self._write(ImageDraw.Draw(picture), course, step, colour, left)
        return picture

    def _write(
        self, draw: ImageDraw.ImageDraw, course: DrawnEpisode, step: int, colour: Colour, left: int
    ) -> None:
        """Write name and moves above the board, coverage and the outcome below it."""
        look, right = self._look, left + self._column
        base = look.margin + round(1.4 * look.text)
        draw.text((left, base), course.plain_name, TEXT, font(look.text), anchor="ls")
        moves = f"{min(step, course.moves)}"
        draw.text((right, base), "moves", MUTED, font(look.text), anchor="rs")
        place, large = (right - round(3.3 * look.text), base), font(round(1.6 * look.text))
        draw.text(place, moves, colour, large, anchor="rs")
        top = look.margin + round(2.2 * look.text) + self._height + round(0.7 * look.text)
        share = course.coverage(step)
        _bar(draw, (left, top, right, top + round(0.5 * look.text)), share, colour)
        words, shade = f"{percent(share)} % mapped", MUTED
        if step >= course.moves:
            words, shade = sentence(course), TEXT
        draw.text((left, top + round(1.9 * look.text)), words, shade, font(look.text), anchor="ls")


def preview(course: DrawnEpisode) -> bytes:
    """Return a link's preview as PNG: the final board, its path and the outcome."""
    return _preview(
        course,
        course.moves,
        course.headline,
        "Watch every move, and a policy",
        "on the same ground.",
    )


def challenge_preview(course: DrawnEpisode) -> bytes:
    """Return a challenge's preview as PNG: the first frame, and what is to be beaten."""
    return _preview(course, 0, course.challenge, "This is what you see", "before the first move.")


def _preview(course: DrawnEpisode, step: int, headline: str, *below: str) -> bytes:
    picture = Image.new("RGB", PREVIEW, NIGHT)
    draw = ImageDraw.Draw(picture)
    room = PREVIEW[1] - 2 * 35
    cell = pixels_a_cell(course, room)
    board = board_picture(course, step, cell, AMBER)
    corner = (35 + (room - board.width) // 2, 35 + (room - board.height) // 2)
    picture.paste(board, corner)
    draw.rectangle((*corner, corner[0] + board.width, corner[1] + board.height), outline=LINE)
    left, right = room + 2 * 40, PREVIEW[0] - 40
    draw.text((left, 92), "MarsExplorer", MUTED, font(30), anchor="ls")
    for number, line in enumerate(_lines(headline, 50, right - left)[:5]):
        draw.text((left, 185 + 62 * number), line, TEXT, font(50), anchor="ls")
    _bar(draw, (left, 470, right, 486), course.coverage(step), AMBER)
    for number, line in enumerate(below):
        draw.text((left, 535 + 40 * number), line, MUTED, font(30), anchor="ls")
    return png(picture)


def _lines(text: str, height: int, room: int) -> list[str]:
    """Break a text into lines of at most `room` pixels, never before a per cent sign."""
    lines: list[str] = []
    for word in text.replace(" %", "\u00a0%").split(" "):
        whole = word.replace("\u00a0", " ")  # for which the font has no glyph
        longer = f"{lines[-1]} {whole}" if lines else whole
        if lines and font(height).getlength(longer) <= room:
            lines[-1] = longer
        else:
            lines.append(whole)
    return lines


def png(picture: Image.Image) -> bytes:
    """Return a picture as PNG."""
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def percent(share: float) -> str:
    """Return a share 0..1 in percent, rounded down: 99.0 never stands too early."""
    return f"{floor(share * 1000 + 1e-9) / 10:.1f}"


@lru_cache(maxsize=16)
def font(height: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the typeface that Pillow brings."""
    return ImageFont.load_default(height)


def _bar(
    draw: ImageDraw.ImageDraw, box: tuple[int, int, int, int], share: float, colour: Colour
) -> None:
    """Draw a bar that is full at 100 %, with a mark at 99 %."""
    left, top, right, bottom = box
    radius = (bottom - top) // 2
    draw.rounded_rectangle(box, radius, fill=LINE)
    if share > 0:
        end = max(left + 2 * radius, left + round(share * (right - left)))
        draw.rounded_rectangle((left, top, end, bottom), radius, fill=colour)
    goal = left + round(GOAL * (right - left))
    draw.line((goal, top - radius, goal, bottom + radius), fill=TEXT, width=max(1, radius // 3))
