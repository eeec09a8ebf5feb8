"""A replay as a file: a page, a picture, or an animation.

GIFs are written by Pillow, and MP4s by PyAV where it is installed.
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from PIL import Image

from humanplay.jobs import Progress
from humanplay.task import Course
from humanplay.web.replays.page import single_file

if TYPE_CHECKING:
    from av.container import OutputContainer

Format = Literal["html", "gif", "mp4", "png"]
FORMATS: tuple[Format, ...] = get_args(Format)
MEDIA_TYPES: dict[Format, str] = {
    "html": "text/html; charset=utf-8", "gif": "image/gif", "mp4": "video/mp4", "png": "image/png",
}  # fmt: skip
MOST_PICTURES = 300
"""Pictures of moves in an animation at most; of longer replays every second, third, ... move is
drawn."""
MOST_LARGE_PICTURES = 125
"""A GIF of large boards has fewer: each move changes much of its picture."""
FASTEST = 25.0
"""Pictures per second at most: a GIF counts in hundredths of a second, and browsers slow down what
is faster than 50."""
LONGEST_S = 15.0
"""Seconds that an animation takes at most, unless a speed is asked for."""
SPEED = 10.0
"""Moves per second of a short replay."""
HELD_S = 3.0
"""Seconds that the end is shown."""
GIF_COLOURS = 64


class VideoMissingError(RuntimeError):
    """PyAV is not installed."""


def offered() -> list[Format]:
    """The formats that can be written here: a video where PyAV is installed."""
    return [form for form in FORMATS if form != "mp4" or has_video()]


def file_of(
    form: Format,
    episode_id: str,
    courses: Sequence[Course],
    speed: float | None = None,
    progress: Progress | None = None,
) -> bytes:
    """A replay as a file.

    Args:
        courses: The episode's own, and that of a policy on the same terrain where there is to be
            one.
        speed: Moves per second of an animation; None shows all of it within some seconds.
        progress: Called with (pictures drawn, in all).

    Raises:
        VideoMissingError: If the format is not `offered`.
    """
    course, *others = courses
    if form == "html":
        return single_file(episode_id, course, others[0] if others else None).encode()
    if form == "png":
        return course.preview()
    if form == "gif":
        return gif(courses, Timing.of(courses, speed, most_gif_pictures(courses)), progress)
    return mp4(courses, Timing.of(courses, speed), progress)


@dataclass(frozen=True)
class Timing:
    """Which moves are drawn, and how many pictures a second are shown.

    The first and the last move are always drawn.
    """

    steps: tuple[int, ...]
    rate: Fraction

    @classmethod
    def of(
        cls, courses: Sequence[Course], speed: float | None = None, most: int = MOST_PICTURES
    ) -> Timing:
        """The timing of courses at some moves per second.

        Args:
            speed: Moves per second; None shows all of it within LONGEST_S.
            most: Pictures of moves, the last one besides.
        """
        last = max(course.moves for course in courses)
        speed = speed or max(SPEED, last / LONGEST_S)
        stride = max(1, -(-last // most), int(-(-speed // FASTEST)))
        return cls((*range(0, last, stride), last), Fraction(speed / stride).limit_denominator(100))

    @property
    def held(self) -> int:
        """Pictures for which the end is shown."""
        return max(1, round(HELD_S * self.rate))


def most_gif_pictures(courses: Sequence[Course]) -> int:
    """How many pictures of moves a GIF of these courses has at most."""
    return MOST_LARGE_PICTURES if courses[0].is_large else MOST_PICTURES


def gif(courses: Sequence[Course], timing: Timing, progress: Progress | None = None) -> bytes:
    """The animation as a GIF that begins again at its end.

    Each picture holds what has changed.
    """
    drawn = courses[0].animation(courses[1:], is_large=False)
    last = timing.steps[-1]
    palette = _palette([drawn.at(step, step) for step in (0, last // 2, last)])
    drawings = _pictures(drawn, timing, progress)
    pictures = [drawing.quantize(palette=palette, dither=Image.Dither.NONE) for drawing in drawings]
    each_ms = round(100 / timing.rate) * 10
    buffer = io.BytesIO()
    pictures[0].save(
        buffer, "GIF", save_all=True, append_images=pictures[1:], loop=0, optimize=False, disposal=1,
        duration=[*[each_ms] * (len(pictures) - 1), round(1000 * HELD_S)],
    )  # fmt: skip
    return buffer.getvalue()


def has_video() -> bool:
    """Whether PyAV is installed."""
    return find_spec("av") is not None


def mp4(courses: Sequence[Course], timing: Timing, progress: Progress | None = None) -> bytes:
    """The animation as an MP4 (H.264).

    Raises:
        VideoMissingError: Without PyAV.
    """
    try:
        import av
    except ModuleNotFoundError as error:
        raise VideoMissingError(
            "an MP4 needs the extra [video]: pip install 'humanplay[video]'"
        ) from error
    drawn = courses[0].animation(courses[1:], is_large=True)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "replay.mp4"
        options = {"movflags": "faststart"}  # the index at the front: the file is opened once more
        _encode(av.open(str(path), "w", format="mp4", options=options), drawn, timing, progress)
        return path.read_bytes()


def _encode(opened: OutputContainer, drawn: Any, timing: Timing, progress: Progress | None) -> None:
    """Write every picture into a video, and close it."""
    from av import VideoFrame

    with opened as container:
        options = {"crf": "20", "preset": "veryfast", "threads": "1"}
        stream = container.add_stream("libx264", rate=timing.rate, options=options)
        stream.width, stream.height = drawn.size
        stream.pix_fmt = "yuv420p"
        for picture in _with_end_held(_pictures(drawn, timing, progress), timing.held):
            frame = VideoFrame.from_ndarray(np.asarray(picture), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _pictures(drawn: Any, timing: Timing, progress: Progress | None) -> Iterator[Image.Image]:
    """Yield the picture of each move that is drawn."""
    for number, (before, step) in enumerate(itertools.pairwise((0, *timing.steps)), 1):
        yield drawn.at(step, before)
        if progress:
            progress(number, len(timing.steps))


def _with_end_held(pictures: Iterator[Image.Image], count: int) -> Iterator[Image.Image]:
    """Yield the pictures, the last one `count` times."""
    picture = None
    for picture in pictures:
        yield picture
    if picture is not None:
        yield from itertools.repeat(picture, count - 1)


def _palette(pictures: Sequence[Image.Image]) -> Image.Image:
    """A picture with the colours that all pictures are drawn in."""
    width, height = pictures[0].size
    together = Image.new("RGB", (width, height * len(pictures)))
    for number, picture in enumerate(pictures):
        together.paste(picture, (0, height * number))
    return together.quantize(GIF_COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
