"""Charges for stored bytes, by owner and day.

An episode costs its largest size while it is open, and what it stored from its end on.
"""

from __future__ import annotations

import threading
import time
from collections import Counter

from humanplay.db.input_events import EVENT_BYTES, MAX_EVENTS_PER_EPISODE
from humanplay.db.trial import Trial

DAY_S = 86_400
Owner = tuple[str, str]
"""Kind ("address", "player" or "study") and name."""

STEP_BYTES, EPISODE_BYTES = 85, 2000
"""Bytes of the database's file that a move takes, and a board with its ended episode. On top come
the terrain, twice (a row of a 128x128 board fills a page), and the input events."""
EVENTS_PER_MOVE, LEAST_EVENTS = 20, 10_000
"""For how many input events an episode has room: so many for each move that it may have, and never
fewer than for a key that repeats for five minutes."""


def stored_bytes(episode: Trial, steps: int, event_bytes: int) -> int:
    """Bytes that an episode takes with its moves and input events."""
    return EPISODE_BYTES + 2 * len(episode.terrain) + steps * STEP_BYTES + event_bytes


def event_room(episode: Trial) -> int:
    """Bytes that the input events of an episode may take."""
    limit: int = episode.config.limit
    events = min(max(LEAST_EVENTS, EVENTS_PER_MOVE * limit), MAX_EVENTS_PER_EPISODE)
    return events * EVENT_BYTES


def most_bytes(episode: Trial, has_events: bool) -> int:
    """The most that an episode stores, with input events if it has them."""
    limit: int = episode.config.limit
    return stored_bytes(episode, limit, event_room(episode) if has_events else 0)


class Charges:
    """Bytes charged today (UTC) to the owners of episodes; kept in memory.

    An open episode is charged its largest size, so that it can always be finished. This class
    charges nobody; a server's subclass does.
    """

    def __init__(self) -> None:
        self._day, self._bytes = 0, Counter[Owner]()
        self._open: dict[str, tuple[tuple[Owner, ...], int]] = {}
        self._lock = threading.Lock()  # metrics are read on another thread

    def owners(self, study: str) -> tuple[Owner, ...]:
        """Who is charged for the current request; `study` is "" outside a study."""
        return ()

    def check(self, study: str) -> None:
        """Raise an error if no episode may begin."""

    def is_full(self, study: str) -> bool:
        """Whether an owner of the current request has spent their budget."""
        return False

    def today(self) -> Counter[Owner]:
        """The bytes charged by owner; open episodes are charged again at midnight."""
        with self._lock:
            self._begin_day()
            return self._bytes.copy()

    def open(self, episode: str, study: str, size: int) -> None:
        """Charge the largest size of an episode, unless it is charged already."""
        with self._lock:
            self._begin_day()
            if episode not in self._open:
                owners = self.owners(study)
                self._open[episode] = owners, size
                self._add(owners, size)

    def close(self, episode: str, stored: int) -> None:
        """Charge what was stored of an episode instead of its largest size."""
        with self._lock:
            self._begin_day()
            owners, size = self._open.pop(episode, ((), 0))
            self._add(owners, stored - size)

    def add(self, study: str, size: int) -> None:
        """Charge what is stored of an episode after its end."""
        with self._lock:
            self._begin_day()
            self._add(self.owners(study), size)

    def _begin_day(self) -> None:
        if (day := int(time.time() // DAY_S)) != self._day:
            self._day, self._bytes = day, Counter()
            for owners, size in self._open.values():
                self._add(owners, size)

    def _add(self, owners: tuple[Owner, ...], size: int) -> None:
        for owner in owners:
            self._bytes[owner] += size
