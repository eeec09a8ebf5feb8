"""Where a server takes its ids, its seeds and the time from, and the ids by which its boards are watched."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Callable
from dataclasses import dataclass

from app.storage.playground import sessions_after
from app.storage.reader import now_ms
from app.storage.store import Store
from marsexplorer.config import MAX_SEED


@dataclass(frozen=True)
class Sources:
    """Where ids, seeds and the time come from; ids and seeds are unguessable unless a test gives others."""

    session_id: Callable[[], str] = lambda: secrets.token_urlsafe(16)
    episode_id: Callable[[], str] = lambda: secrets.token_hex(8)
    player_id: Callable[[], str] = lambda: secrets.token_hex(16)
    seed: Callable[[], int] = lambda: secrets.randbelow(MAX_SEED + 1)
    clock_ms: Callable[[], int] = now_ms
    participant_id: Callable[[], str] = lambda: secrets.token_hex(16)
    completion_code: Callable[[], str] = lambda: secrets.token_hex(4).upper()


WATCH_ID_DIGITS = 24
"""Hexadecimal digits of an id by which a board is watched: 96 bits."""


class WatchIds:
    """The ids by which one database's boards are watched: each has one of its own, which grants nothing but watching.

    An id is a keyed hash (HMAC-SHA256) of its session's id under the secret of the database. Nobody can guess it or tell the
    session from it, nothing has to be stored, and boards of earlier versions have one as well. No list and no export holds it.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._key = store.secret().encode()
        self._sessions: dict[str, str] = {}
        self._last_row = 0

    def of(self, session_id: str) -> str:
        """Return the id by which a session's board is watched: 24 hexadecimal digits."""
        return hmac.new(self._key, b"watch:" + session_id.encode(), hashlib.sha256).hexdigest()[:WATCH_ID_DIGITS]

    async def session(self, watch_id: str) -> str | None:
        """Return the id of the session whose board an id shows; None where it shows none."""
        if len(watch_id) == WATCH_ID_DIGITS and watch_id not in self._sessions:
            last = self._last_row
            for row, session_id in await self._store.read(lambda: sessions_after(self._store, last)):  # those that are new
                self._last_row = max(row, self._last_row)
                self._sessions[self.of(session_id)] = session_id
        return self._sessions.get(watch_id)
