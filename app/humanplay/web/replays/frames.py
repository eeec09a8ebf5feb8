"""The course of an episode whose task draws none of its own: its frames, each a picture or a text, as a replay shows them."""

from __future__ import annotations

import base64
import io
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

from PIL import Image, ImageDraw, ImageFont, ImageOps

from humanplay.task import Environment, GhostError, PolicyOffer, Record, describe

MOST_BYTES = 16 * 2**20
"""Bytes of pictures that a replay holds; of one with more every second, third, ... frame is left out."""
PREVIEW = (1200, 630)
LARGE_PX = 400
"""A picture with a longer side than this changes much in a GIF; a smaller one is enlarged to it."""
INK, GROUND = "#e8dfd6", "#171310"
WORDS = {"timed_out": "ran out of time", "abandoned": "left"}


@dataclass(frozen=True)
class FrameCourse:
    """What a replay draws of one episode of any task.

    name     who drove
    task     `humanplay.task.describe` of it
    actions  the names of the moves
    frames   its public frames (`Environment.frames`), from the start to the end, some left out
    """

    name: str
    task: dict[str, Any]
    level: str
    actions: tuple[str, ...]
    frames: tuple[dict[str, Any], ...]

    @property
    def moves(self) -> int:
        """Moves in all."""
        return len(self.actions)

    @property
    def place(self) -> str:
        """What was played, in words."""
        return str(self.task["title"])

    @property
    def sentence(self) -> str:
        """What it came to, after the name: `succeeded after 12 moves: return 0.96`."""
        end, clock, metric = self.frames[-1], self.task["clock"], self.task["metrics"][0]
        took = f"{self.moves} move{'s' * (self.moves != 1)}"
        if clock:
            took = f"{self.moves / clock:.1f} s"
        outcome = WORDS.get(end["outcome"], str(end["outcome"]).replace("_", " "))
        return f"{outcome} after {took}: {metric['name']} {end['headline']:g}{metric['unit']}"

    @property
    def headline(self) -> str:
        """Who did what."""
        return f"{self.name} {self.sentence}"

    @property
    def is_large(self) -> bool:
        """Whether each move may change much of a large picture."""
        return max(_picture(self.frames[0]).size) > LARGE_PX

    def about(self) -> dict[str, Any]:
        """Return what the page is told of where it was played."""
        return {"level": self.level, "rows": 1, "cols": 1, "task": self.task}

    def to_dict(self) -> dict[str, Any]:
        """Return the course as the page reads it."""
        end = self.frames[-1]
        return {
            "name": self.name, "actions": self.actions, "outcome": end["outcome"], "score": end["score"],
            "sentence": self.sentence, "frames": self.frames,
        }  # fmt: skip

    def renamed(self, name: str) -> FrameCourse:
        """The same course under another name."""
        return replace(self, name=name)

    def preview(self) -> bytes:
        """Return the end as a PNG."""
        out = io.BytesIO()
        ImageOps.pad(_picture(self.frames[-1]), PREVIEW, color=GROUND).save(out, "PNG")
        return out.getvalue()

    def animation(self, others: Sequence[Any], is_large: bool) -> FramePictures:
        """Return what draws the course after each move; there are no others."""
        return FramePictures(self.frames)


class FramePictures:
    """The pictures of an animation, of even sides as a video wants them."""

    def __init__(self, frames: Sequence[dict[str, Any]]) -> None:
        self._frames, self._steps = frames, [frame["step"] for frame in frames]
        width, height = _picture(frames[0]).size
        times = max(1, LARGE_PX // max(width, height))
        self.size = (width * times // 2 * 2, height * times // 2 * 2)

    def at(self, step: int, before: int) -> Image.Image:
        """Return the picture after so many moves."""
        frame = self._frames[max(0, bisect_right(self._steps, step) - 1)]
        return _picture(frame).resize(self.size, Image.Resampling.NEAREST)


def _picture(frame: dict[str, Any]) -> Image.Image:
    """Return a frame's picture, or its text as one."""
    if frame["picture"] is not None:
        packed = base64.b64decode(frame["picture"].partition(",")[2])
        return Image.open(io.BytesIO(packed)).convert("RGB")
    font, rows = ImageFont.load_default_imagefont(), frame["text"].splitlines() or [""]
    size = (16 + 6 * max(map(len, rows)), 16 + 12 * len(rows))
    drawn = Image.new("RGB", size, GROUND)
    ImageDraw.Draw(drawn).multiline_text((8, 8), "\n".join(rows), INK, font, spacing=1)
    return drawn


@dataclass(frozen=True)
class FrameCourses:
    """The courses of a task without `Environment.courses`; no policy is beside them."""

    environment: Environment

    def course_of(self, name: str, record: Record) -> FrameCourse:
        """Return the course of a finished episode, played again; ValueError where it cannot be played here."""
        if record.core_version != self.environment.version:
            raise ValueError(f"the episode was played under {record.core_version}")
        frames = self.environment.frames(record, "")
        size = sum(len(frame["picture"] or frame["text"] or "") for frame in frames)
        kept = (*frames[: -1 : 1 + size // MOST_BYTES], frames[-1])
        actions = tuple(self.environment.actions[action] for action in record.actions)
        return FrameCourse(name, describe(self.environment), record.config.level, actions, kept)

    def choices(self, offers: Sequence[PolicyOffer], config: Any) -> list[str]:
        """Return no policy."""
        return []

    def preferred(self, driver: str, names: Sequence[str] | None = None) -> None:
        """Return no policy."""

    def play_ghost(self, source: str, record: Record) -> NoReturn:
        """Raise GhostError."""
        raise GhostError(f"no policy is shown beside an episode of {self.environment.about.title}")
