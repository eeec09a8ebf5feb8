"""Which episodes have a replay: the ended ones that the asker may see.

The rule is that of the API's finished episodes.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from humanplay.db.reader import Reader
from humanplay.db.trial import Trial
from humanplay.task import DrawnReplays, Environment, Record
from humanplay.task.registration import environment_of
from humanplay.tasks.courses import FrameCourses

NAMES = {"you": "You", "human": "A person", "synthetic": "A synthetic player", "script": "A script"}
"""Who drove an episode -> how a replay names them; a policy has its own name."""
MAX_NAMED = 5
"""Episodes that are named where a prefix fits several."""


class UnknownReplayError(LookupError):
    """There is no episode with this id of which the asker may see a replay."""


@dataclass(frozen=True)
class Asker:
    """Who asks for a replay, and when.

    Attributes:
        player_id: None for a stranger.
        at_ms: Milliseconds since 1970; None for now.
    """

    player_id: str | None = None
    at_ms: int | None = None


STRANGER = Asker()


@dataclass(frozen=True)
class ShownEpisode:
    """An ended episode that the asker may see.

    Attributes:
        database: Where it is stored.
        name: Who drove, in words for everybody.
        asker_name: The same for the asker: "You" where it was they.
    """

    database: Path
    trial: Trial
    name: str
    asker_name: str

    @property
    def id(self) -> str:
        """Its id."""
        return self.trial.id

    @cached_property
    def record(self) -> Record:
        """Its cause.

        All of its moves are read when it is first asked for, so ask on a thread.
        """
        with closing(Reader.open(self.database)) as reader:
            return reader.load_record(self.id)


def courses_of(episode: ShownEpisode, served: Environment | None = None) -> DrawnReplays:
    """What makes courses of an episode's task.

    Args:
        served: The environment of a server, whose runs are guarded.
    """
    task = episode.trial.task
    environment = served if served and served.name == task else environment_of(task)
    return environment.courses or FrameCourses(environment)


def shown_episode(database: Path, episode_id: str, asker: Asker = STRANGER) -> ShownEpisode:
    """An ended episode by its id.

    Secret are a running episode, one of a study that is open or of a day that is not over, and a
    policy's that ended before its player's on the same terrain.

    Raises:
        UnknownReplayError: For every other id, so that nothing is shown of what is secret.
    """
    opened = Reader.open(database, public=True, at_ms=asker.at_ms)
    with closing(opened) as reader, reader.snapshot():
        trial = reader.trial(episode_id)
        if trial is None:
            raise UnknownReplayError(
                f"no finished episode {episode_id!r} that can be replayed: check the link"
            )
        drivers = [reader.who_drove(episode_id, viewer) for viewer in (None, asker.player_id)]
        names = [NAMES.get(driver) or driver.removeprefix("policy:") for driver in drivers]
        return ShownEpisode(database, trial, *names)


def find_episode(database: Path, prefix: str) -> ShownEpisode:
    """The one ended episode whose id begins with a prefix.

    Raises:
        UnknownReplayError: If none or several do.
    """
    with closing(Reader.open(database, public=True)) as reader:
        ids = reader.ids_beginning(prefix, MAX_NAMED + 1)
    if not ids:
        raise UnknownReplayError(
            f"no finished episode in {database} has an id that begins with {prefix!r}; "
            "`humanplay export` lists them, and the address of a replay ends with one"
        )
    if len(ids) > 1 and prefix not in ids:
        named = ", ".join([*ids[:MAX_NAMED], *["..."] * (len(ids) > MAX_NAMED)])
        raise UnknownReplayError(
            f"several episodes begin with {prefix!r}: {named}; give more of the id"
        )
    return shown_episode(database, prefix if prefix in ids else ids[0])
