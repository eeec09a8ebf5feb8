"""What episodes may store: the largest size is charged when one opens, and at its end what was stored."""

from __future__ import annotations

import threading
import time
from collections import Counter

DAY_S = 86_400
Owner = tuple[str, str]
"""Kind ("address", "player" or "study") and name."""


class Charges:
    """Bytes of the database's file that were charged to their owners today (UTC), in memory alone.

    An open episode is charged the most that it can store, so that it goes on whatever else is stored. This class charges
    nobody, as on a board away from a server.
    """

    def __init__(self) -> None:
        self._day, self._bytes = 0, Counter[Owner]()
        self._open: dict[str, tuple[tuple[Owner, ...], int]] = {}
        self._lock = threading.Lock()  # metrics are read on another thread

    def owners(self, study: str) -> tuple[Owner, ...]:
        """Who pays for what is stored just now, on a board of a study or ("") on another."""
        return ()

    def check(self, study: str) -> None:
        """Check that an episode may begin; an error of its own otherwise."""

    def is_full(self, study: str) -> bool:
        """Whether who asks just now has spent their budget."""
        return False

    def today(self) -> Counter[Owner]:
        """The bytes charged by owner; those of open episodes are charged again at midnight."""
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
