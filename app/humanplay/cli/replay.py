"""The command `humanplay replay`: an episode as a file to keep or to show."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click import ClickException, UsageError, argument, echo, option

from humanplay.cli.options import database_option
from humanplay.command.console import progress, write_file
from humanplay.command.options import path_option
from humanplay.task import counted

if TYPE_CHECKING:
    from humanplay.task import Course
    from humanplay.web.replays.episodes import ShownEpisode
    from humanplay.web.replays.files import Format

NO_GHOST = "none"


@click.command(short_help="Write an episode as a page in one file, a GIF or an MP4.")
@argument("episode")
@path_option("--out", "It ends with .html, .gif, .mp4 or .png.", required=True, metavar="FILE")
@database_option("The database to read; a running server may go on writing.")
@option("--ghost", metavar="POLICY", help="A policy on the same instance, or none.  [default: ppo]")
@option("--speed", type=click.FloatRange(0.5, 1000), help="Moves a second.  [default: 15 s in all]")
def replay(episode: str, out: Path, database: Path, ghost: str | None, speed: float | None) -> None:
    """Write the replay of a finished EPISODE, by its id or the beginning of it.

    The id is the last part of a replay's address; `humanplay export` lists them. A page of one file shows everything that
    the server's does and opens without a network. What is secret is not replayed: an episode that runs, one of an open study,
    one of today's daily terrain.

    \b
    Examples:
      humanplay replay 3f9a --out replay.html
      humanplay replay 3f9a --out replay.gif --ghost frontier-cost --speed 8
      humanplay replay 3f9a --out replay.mp4 --ghost none
    """
    from humanplay.task import GhostError
    from humanplay.web.replays.files import VideoMissingError, file_of

    form = _format_of(out)
    if form == "png":
        if ghost not in (None, NO_GHOST):
            raise UsageError(
                "a picture shows no policy: leave --ghost out, or let --out end with .html"
            )
        ghost = NO_GHOST
    shown = _find(database, episode)
    try:
        courses = _courses(shown, ghost)
        with progress("drawing") as advance:
            content = file_of(form, shown.id, courses, speed, advance)
    except (GhostError, VideoMissingError) as error:
        raise UsageError(str(error)) from error
    except ValueError as error:
        raise ClickException(str(error)) from error
    write_file(out, content, "--out")
    others = f", with {courses[1].name}" if len(courses) > 1 else ""
    size = f"{len(content):,} bytes"
    echo(f"{out}: episode {shown.id}, {counted(courses[0].moves, 'move')}{others}, {size}")


def _format_of(out: Path) -> Format:
    """The format that a file's ending names; UsageError for any other."""
    from humanplay.web.replays.files import FORMATS

    form = next((name for name in FORMATS if out.suffix.lower() == f".{name}"), None)
    if form is None:
        endings = ", ".join(f".{name}" for name in FORMATS)
        raise UsageError(f"expected --out to end with one of {endings}, got {out.name!r}")
    return form


def _find(database: Path, prefix: str) -> ShownEpisode:
    from humanplay.db.database import StoreError
    from humanplay.web.replays.episodes import UnknownReplayError, find_episode

    try:
        return find_episode(database, prefix)
    except UnknownReplayError as error:
        raise UsageError(str(error)) from error
    except StoreError as error:
        raise ClickException(str(error)) from error


def _courses(shown: ShownEpisode, ghost: str | None) -> list[Course]:
    """The course of the episode and, unless none is wanted, that of the policy."""
    from humanplay.web.replays.episodes import courses_of

    courses = courses_of(shown)
    course = courses.course_of(shown.name, shown.record)
    chosen = ghost or courses.preferred(shown.name)
    if chosen is None or chosen == NO_GHOST:
        return [course]
    return [course, courses.play_ghost(chosen, shown.record)]
