"""Pictures of a replay: each picture of its animation, and the one that a preview of its link shows."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import floor

from PIL import Image, ImageDraw, ImageFont

from app.replay.board_picture import AMBER, NIGHT, ROVERS, Colour, board_picture, pixels_a_cell
from app.replay.course import Course, sentence

PREVIEW = (1200, 630)
"""Width and height in pixels that sites show a preview of a link in."""
TEXT: Colour = (241, 231, 222)
MUTED: Colour = (179, 162, 151)
LINE: Colour = (58, 44, 40)
GOAL = 0.99


@dataclass(frozen=True)
class Look:
    """Sizes of an animation's pictures in pixels: the longer side of a board at most, the margin, and the height of text."""

    board: int = 360
    margin: int = 20
    text: int = 16


class AnimationPicture:
    """Draws the boards of one course or two side by side, with names, moves and coverage."""

    def __init__(self, courses: Sequence[Course], look: Look) -> None:
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
        """Return the picture after some moves; ground shown after `before` moves is lighter."""
        picture = Image.new("RGB", self.size, NIGHT)
        for number, (course, colour) in enumerate(zip(self._courses, ROVERS, strict=False)):
            others = [
                (each, ROVERS[k]) for k, each in enumerate(self._courses) if each is not course
            ]
            left = self._look.margin + number * (self._column + self._look.margin)
            board = board_picture(
                course, step, self._cell, colour, others[0] if others else None, before
            )
            top = self._look.margin + round(2.2 * self._look.text)
            picture.paste(board, (left + (self._column - self._width) // 2, top))
            self._write(ImageDraw.Draw(picture), course, step, colour, left)
        return picture

    def _write(
        self, draw: ImageDraw.ImageDraw, course: Course, step: int, colour: Colour, left: int
    ) -> None:
        """Write name and moves above the board, coverage as a bar and what it came to below."""
        look, right = self._look, left + self._column
        base = look.margin + round(1.4 * look.text)
        draw.text((left, base), course.name, TEXT, font(look.text), anchor="ls")
        moves = f"{min(step, course.moves)}"
        draw.text((right, base), "moves", MUTED, font(look.text), anchor="rs")
        draw.text(
            (right - round(3.3 * look.text), base),
            moves,
            colour,
            font(round(1.6 * look.text)),
            anchor="rs",
        )
        top = look.margin + round(2.2 * look.text) + self._height + round(0.7 * look.text)
        share = course.coverage(step)
        _bar(draw, (left, top, right, top + round(0.5 * look.text)), share, colour)
        words = sentence(course) if step >= course.moves else f"{percent(share)} % mapped"
        draw.text(
            (left, top + round(1.9 * look.text)),
            words,
            TEXT if step >= course.moves else MUTED,
            font(look.text),
            anchor="ls",
        )


def preview(course: Course) -> bytes:
    """Return the picture of a link's preview as PNG: the board at the end with the path, and what it came to in words."""
    picture = Image.new("RGB", PREVIEW, NIGHT)
    draw = ImageDraw.Draw(picture)
    room = PREVIEW[1] - 2 * 35
    cell = pixels_a_cell(course, room)
    board = board_picture(course, course.moves, cell, AMBER)
    picture.paste(board, (35 + (room - board.width) // 2, 35 + (room - board.height) // 2))
    left, right = room + 2 * 40, PREVIEW[0] - 40
    draw.text((left, 92), "MarsExplorer", MUTED, font(30), anchor="ls")
    lines = textwrap.wrap(course.headline.replace(" %", "\u00a0%"), 22)[:5]
    for number, line in enumerate(lines):
        draw.text((left, 185 + 62 * number), line, TEXT, font(50), anchor="ls")
    _bar(draw, (left, 470, right, 486), course.coverage(course.moves), AMBER)
    draw.text((left, 535), "Watch every move, and a policy", MUTED, font(30), anchor="ls")
    draw.text((left, 575), "on the same ground.", MUTED, font(30), anchor="ls")
    return png(picture)


def png(picture: Image.Image) -> bytes:
    """Return a picture as PNG."""
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def percent(share: float) -> str:
    """Return a share 0..1 in percent, rounded down, so that 99.0 never stands before it is reached."""
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
        draw.rounded_rectangle(
            (left, top, max(left + 2 * radius, left + round(share * (right - left))), bottom),
            radius,
            fill=colour,
        )
    goal = left + round(GOAL * (right - left))
    draw.line((goal, top - radius, goal, bottom + radius), fill=TEXT, width=max(1, radius // 3))
