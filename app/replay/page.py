"""The page of a replay, from the template `static/replay/index.html`: as the server gives it, or whole in one file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from app.replay.course import Course
from app.settings import STATIC
from marsexplorer.config import MAP

_ENVIRONMENT = Environment(
    loader=FileSystemLoader(STATIC),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


@dataclass(frozen=True)
class Addresses:
    """Absolute addresses for whoever shows a preview of the link: of the page, and of its picture."""

    page: str
    picture: str


@dataclass(frozen=True)
class Inlined:
    """What a page that stands in one file holds itself: its styles and the script that chooses their theme; its modules by name
    and its icon, as data URLs.
    """

    style: Markup
    theme: Markup
    modules: dict[str, str]
    entry: str
    icon: str


def render(
    data: dict[str, Any],
    course: Course,
    formats: Sequence[str] = (),
    addresses: Addresses | None = None,
    inlined: Inlined | None = None,
) -> str:
    """Return the HTML of a replay; `data` is what the page draws, `course` that of the episode itself.

    formats  in which the server gives the replay as a file
    """
    text: str = _ENVIRONMENT.get_template("replay/index.html").render(
        root="../",
        data=data,
        headline=course.headline,
        terrain=terrain_in_words(course),
        formats=formats,
        addresses=addresses,
        inlined=inlined,
    )
    return text


def terrain_in_words(course: Course) -> str:
    """Return level and size: `level random, 21 x 21 cells`, or `a map, 9 x 14 cells`."""
    name = "a map" if course.config.level == MAP else f"level {course.config.level}"
    return f"{name}, {course.config.rows} \u00d7 {course.config.cols} cells"
