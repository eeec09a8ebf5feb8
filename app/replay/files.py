"""A replay as a file: which formats there are, and the bytes of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

from app.replay import animation
from app.replay.animation import Progress, Timing
from app.replay.course import Course
from app.replay.pictures import preview
from app.replay.single_file import single_file

Format = Literal["html", "gif", "mp4", "png"]
FORMATS: tuple[Format, ...] = get_args(Format)
MEDIA_TYPES: dict[Format, str] = {
    "html": "text/html; charset=utf-8",
    "gif": "image/gif",
    "mp4": "video/mp4",
    "png": "image/png",
}


def offered() -> list[Format]:
    """Return the formats that can be written here: a video where PyAV is installed."""
    return [each for each in FORMATS if each != "mp4" or animation.has_video()]


def file_of(
    form: Format,
    episode_id: str,
    courses: Sequence[Course],
    speed: float | None = None,
    progress: Progress | None = None,
) -> bytes:
    """Return a replay as a file; VideoMissingError where the format is not `offered`.

    courses   the episode's own, and that of a policy on the same terrain where there is to be one
    speed     moves per second of an animation; None shows all of it within some seconds
    progress  called with (pictures drawn, in all)
    """
    own, *others = courses
    if form == "html":
        return single_file(episode_id, own, others[0] if others else None).encode()
    if form == "png":
        return preview(own)
    if form == "gif":
        return animation.gif(
            courses, Timing.of(courses, speed, animation.most_gif_pictures(courses)), progress
        )
    return animation.mp4(courses, Timing.of(courses, speed), progress)
