"""Which episodes have a replay: the ended ones that anybody may see, by the same rule as the list of finished episodes."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from app.storage.reader import Reader
from marsexplorer.episode import Record

NAMES = {"human": "A person", "script": "A script"}
"""Driver of an episode -> how a replay names it; a policy has its own name."""
MAX_NAMED = 5
"""Episodes that are named where a prefix fits several."""


class UnknownReplayError(LookupError):
    """There is no episode with this id that anybody may see a replay of."""


@dataclass(frozen=True)
class PublicEpisode:
    """An ended episode that anybody may see: its id, its cause, and who drove in words."""

    id: str
    record: Record
    name: str


def public_episode(database: Path, episode_id: str, viewer: str | None = None) -> PublicEpisode:
    """Return an ended episode by its id; UnknownReplayError for every other id, so that nothing is told of what is secret.

    Secret are a running episode, one of an open study, a policy's that ended before its player's on the same terrain, and one
    of a daily terrain whose day is not over, except to `viewer`, the player who asks, if it is theirs.
    """
    with closing(Reader.open(database, public=True)) as reader, reader.snapshot():
        found = reader.episode(episode_id, viewer)
        if found is None:
            raise UnknownReplayError(f"no finished episode {episode_id!r} that can be replayed: check the link")
        driver = str(found["driver"])
        return PublicEpisode(episode_id, reader.load_record(episode_id), NAMES.get(driver) or driver.removeprefix("policy:"))


def find_episode(database: Path, prefix: str) -> PublicEpisode:
    """Return the one ended episode whose id begins with a prefix; UnknownReplayError where none or several do."""
    with closing(Reader.open(database, public=True)) as reader:
        found = reader.ids_beginning(prefix, MAX_NAMED + 1)
    if not found:
        raise UnknownReplayError(
            f"no finished episode in {database} has an id that begins with {prefix!r}; "
            "`marsexplorer export` lists them, and the address of a replay ends with one"
        )
    if len(found) > 1 and prefix not in found:
        named = ", ".join(found[:MAX_NAMED]) + (", ..." if len(found) > MAX_NAMED else "")
        raise UnknownReplayError(f"several episodes begin with {prefix!r}: {named}; give more of the id")
    return public_episode(database, prefix if prefix in found else found[0])
