"""Which episodes have a replay: the ended ones that the asker may see, by the same rule as the API's finished episodes."""

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

    player_id  None for a stranger
    at_ms      milliseconds since 1970; None for now
    """

    player_id: str | None = None
    at_ms: int | None = None


STRANGER = Asker()


@dataclass(frozen=True)
class ShownEpisode:
    """An ended episode that the asker may see: where it is stored, and who drove in words.

    name        for everybody
    asker_name  for the asker: "You" where it was they
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
        """Its cause: all of its moves are read when it is first asked for, so ask on a thread."""
        with closing(Reader.open(self.database)) as reader:
            return reader.load_record(self.id)


def courses_of(episode: ShownEpisode, served: Environment | None = None) -> DrawnReplays:
    """Return what makes courses of an episode's task; `served` is that of a server, whose runs are guarded."""
    task = episode.trial.task
    environment = served if served and served.name == task else environment_of(task)
    return environment.courses or FrameCourses(environment)


def shown_episode(database: Path, episode_id: str, asker: Asker = STRANGER) -> ShownEpisode:
    """Return an ended episode by its id; UnknownReplayError for every other id, so that nothing is told of what is secret.

    Secret are a running episode, one of a study that is open or of a day that is not over, and a policy's that ended before its
    player's on the same terrain.
    """
    opened = Reader.open(database, public=True, at_ms=asker.at_ms)
    with closing(opened) as reader, reader.snapshot():
        trial = reader.trial(episode_id)
        if trial is None:
            what = f"no finished episode {episode_id!r} that can be replayed"
            raise UnknownReplayError(f"{what}: check the link")
        drivers = [reader.who_drove(episode_id, viewer) for viewer in (None, asker.player_id)]
        names = [NAMES.get(each) or each.removeprefix("policy:") for each in drivers]
        return ShownEpisode(database, trial, *names)


def find_episode(database: Path, prefix: str) -> ShownEpisode:
    """Return the one ended episode whose id begins with a prefix; UnknownReplayError where none or several do."""
    with closing(Reader.open(database, public=True)) as reader:
        found = reader.ids_beginning(prefix, MAX_NAMED + 1)
    if not found:
        raise UnknownReplayError(
            f"no finished episode in {database} has an id that begins with {prefix!r}; "
            "`humanplay export` lists them, and the address of a replay ends with one"
        )
    if len(found) > 1 and prefix not in found:
        named = ", ".join([*found[:MAX_NAMED], *["..."] * (len(found) > MAX_NAMED)])
        what = f"several episodes begin with {prefix!r}: {named}"
        raise UnknownReplayError(f"{what}; give more of the id")
    return shown_episode(database, prefix if prefix in found else found[0])
