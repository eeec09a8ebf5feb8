"""What people have played in a pilot."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from humanplay.cli.pilot.running import RunningServer


class Plays:
    """The plays of an environment in a database, and the page that goes on recording them until it is closed.

    database  the file
    task      what is played
    link      of the page
    links     of people 1, 2, ..., where some were invited
    """

    def __init__(self, database: Path, task: str, server: RunningServer, base: str) -> None:
        self.database, self.task, self._server = database, task, server
        self.link = f"{base}/"
        self.links = [f"{base}/?invitation={token}" for token in server.invitations]

    @property
    def is_open(self) -> bool:
        """Whether the page is open."""
        return self._server.is_open

    def wait(self) -> None:
        """Let people play until Ctrl-C."""
        with suppress(KeyboardInterrupt):
            self._server.wait()
        self.close()

    def close(self) -> None:
        """Close the page; an episode that somebody is in goes on when it is opened again."""
        self._server.close()

    def __repr__(self) -> str:
        state = f"open at {self.link}" if self.is_open else "closed"
        return f"plays of {self.task.partition(':')[2] or self.task} in {self.database}, {state}"
