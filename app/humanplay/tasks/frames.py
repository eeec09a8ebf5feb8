"""An episode as its frames, for replays of tasks that draw no courses."""

from __future__ import annotations

import base64
import io
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from PIL import Image, ImageDraw, ImageFont, ImageOps

from humanplay.task import Configuration, beat_text, counted
from humanplay.task.registration import environment_of

PREVIEW = (1200, 630)
LARGE_PX = 400
"""A picture with a longer side than this changes much in a GIF; a smaller one is enlarged to it."""
INK, GROUND = "#e8dfd6", "#171310"
WORDS = {"timed_out": "ran out of time", "abandoned": "left"}


@dataclass(frozen=True)
class FrameCourse:
    """What a replay draws of one episode of any task.

    name     who drove
    task     its name
    actions  the names of the moves
    frames   its public frames (`Environment.frames`), from the start to the end, some left out
    """

    name: str
    task: str
    config: Configuration
    actions: tuple[str, ...]
    frames: tuple[dict[str, Any], ...]

    @property
    def moves(self) -> int:
        """Moves in all."""
        return len(self.actions)

    @property
    def sentence(self) -> str:
        """What it came to, after the name: `succeeded after 12 moves: return 0.96`."""
        environment, end = environment_of(self.task), self.frames[-1]
        clock, metric = environment.clock, environment.metrics[0]
        took = counted(self.moves, "move")
        if clock:
            took = f"{self.moves / clock:.1f} s"
        outcome = WORDS.get(end["outcome"], str(end["outcome"]).replace("_", " "))
        return f"{outcome} after {took}: {metric.name} {end['headline']:g}{metric.unit}"

    @property
    def headline(self) -> str:
        """Who did what."""
        return f"{self.name} {self.sentence}"

    @property
    def challenge(self) -> str:
        """What is to be beaten."""
        return beat_text(
            self.moves, self.frames[-1]["outcome"] in environment_of(self.task).successes
        )

    @property
    def is_large(self) -> bool:
        """Whether each move may change much of a large picture."""
        return max(_picture(self.frames[0]).size) > LARGE_PX

    def to_dict(self) -> dict[str, Any]:
        """Return the course as the page reads it."""
        end = self.frames[-1]
        return {
            "name": self.name, "actions": self.actions, "outcome": end["outcome"], "score": end["score"],
            "sentence": self.sentence, "frames": self.frames,
        }  # fmt: skip

    def with_name(self, name: str) -> FrameCourse:
        """The same course under another name."""
        return replace(self, name=name)

    def preview(self, is_challenge: bool = False) -> bytes:
        """Return the end as a PNG, or the start."""
        frame, out = self.frames[0 if is_challenge else -1], io.BytesIO()
        ImageOps.pad(_picture(frame), PREVIEW, color=GROUND).save(out, "PNG")
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
    """A frame's picture, or its text as one; an empty one of neither."""
    if frame.get("picture"):
        packed = base64.b64decode(frame["picture"].partition(",")[2])
        return Image.open(io.BytesIO(packed)).convert("RGB")
    font, rows = ImageFont.load_default_imagefont(), (frame.get("text") or "").splitlines() or [""]
    size = (16 + 6 * max(map(len, rows)), 16 + 12 * len(rows))
    drawn = Image.new("RGB", size, GROUND)
    ImageDraw.Draw(drawn).multiline_text((8, 8), "\n".join(rows), INK, font, spacing=1)
    return drawn
