"""What people have played in a pilot."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from humanplay.cli.pilot.episodes import read
from humanplay.cli.pilot.errors import PilotError
from humanplay.cli.pilot.running import RunningServer
from humanplay.task.registration import environment_of


class Plays:
    """The plays of an environment in a database, and the page that records more.

    database  the file
    task      what is played
    link      of the page
    links     of people 1, 2, ..., where some were invited
    """

    def __init__(
        self, database: Path, task: str, server: RunningServer | None = None, base: str = ""
    ) -> None:
        self.database, self.task, self._server = database, task, server
        invitations = [] if server is None else server.invitations
        self.link = f"{base}/"
        self.links = [f"{base}/?invitation={token}" for token in invitations]

    @property
    def is_open(self) -> bool:
        """Whether the page is open."""
        return self._server is not None and self._server.is_open

    def wait(self) -> None:
        """Let people play until Ctrl-C."""
        if self._server is not None:
            with suppress(KeyboardInterrupt):
                self._server.wait()
        self.close()

    def close(self) -> None:
        """Close the page; an episode that somebody is in goes on when it is opened again."""
        if self._server is not None:
            self._server.close()

    def verify(self) -> list[str]:
        """Replay every finished episode; return what differs from the record, if anything."""
        from humanplay.study.verification import verify_database

        return [str(finding) for finding in verify_database(self.database).findings]

    def to_minari(self, name: str) -> str:
        """Write the counted episodes as a Minari dataset, such as "lake/people-v0"."""
        from humanplay.release.plays import minari_of

        return minari_of(self.database, name, self.task)

    def to_parquet(self, folder: str | Path) -> str:
        """Write all finished episodes and their steps as two Parquet tables in a folder."""
        from humanplay.release.plays import parquet_of

        return parquet_of(self.database, Path(folder))

    def replay(self, number: int = -1, out: str | Path = "replay.html") -> Path:
        """Write a counted episode as one HTML file.

        Args:
            number: Of the counted episodes that have ended, from 0; -1 is the newest.
            out: The file.

        Raises:
            PilotError: There is no such episode.
        """
        from humanplay.web.replays.episodes import courses_of, find_episode
        from humanplay.web.replays.files import file_of

        ended = [
            episode.trial
            for episode in read(self.database, self.task).episodes
            if episode.trial.outcome
        ]
        if not -len(ended) <= number < len(ended):
            raise PilotError(
                f"expected a number below {len(ended)}, how many episodes count; got {number}"
            )
        shown = find_episode(self.database, ended[number].id)
        course = courses_of(shown).course_of(shown.name, shown.record)
        path = Path(out)
        path.write_bytes(file_of("html", shown.id, [course], None, lambda done, total: None))
        return path

    def __repr__(self) -> str:
        state = f"open at {self.link}" if self.is_open else "closed"
        return f"plays of {environment_of(self.task).about.title} in {self.database}, {state}"
