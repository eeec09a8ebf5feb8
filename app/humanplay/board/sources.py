"""Where a server takes ids, seeds and the time from; how it signs players' ids.

Here too are the ids by which its boards are watched.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from array import array
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from itsdangerous import BadSignature, Signer

from humanplay.db.playground import session_of_row, sessions_after
from humanplay.db.reader import now_ms
from humanplay.db.store import Store
from humanplay.task import MAX_SEED


def _draw_id(num_bytes: int) -> str:
    """Random hexadecimal digits that no reader of a table takes for a number."""
    # All digits, or digits around one e, would be read as one: begin with another letter. None of
    # these three begins the name of a month that is written in hexadecimal digits (DEC, FEB).
    return secrets.choice("abc") + secrets.token_hex(num_bytes)[1:]


@dataclass(frozen=True)
class Sources:
    """Where ids, seeds and the time come from.

    Ids and seeds are unguessable unless a test gives others.
    """

    session_id: Callable[[], str] = lambda: secrets.token_urlsafe(16)
    episode_id: Callable[[], str] = lambda: _draw_id(8)
    player_id: Callable[[], str] = lambda: _draw_id(16)
    seed: Callable[[], int] = lambda: secrets.randbelow(MAX_SEED + 1)
    clock_ms: Callable[[], int] = now_ms
    participant_id: Callable[[], str] = lambda: _draw_id(16)
    completion_code: Callable[[], str] = lambda: _draw_id(4).upper()


WATCH_ID_DIGITS = 24
"""Hexadecimal digits of an id by which a board is watched: 96 bits."""

SESSIONS_A_LOOK = 5_000
"""Sessions whose ids for watching are worked out together, in some 10 ms of a reading thread."""

MAX_FOUND = 1_000
"""Ids whose sessions are remembered; beyond it, all of them are forgotten and found again."""


class WatchIds:
    """The ids by which one database's boards are watched; they grant nothing else.

    An id is a keyed hash (HMAC-SHA256) of its session's id under the secret of the database. Nobody
    can guess it or tell the session from it, and nothing has to be stored. No list and no export
    holds it. Memory holds 16 bytes of each session that there ever was: the first 64 bits of its
    id, and the number of its row.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._key = store.secret().encode()
        self._prefixes, self._rows = array("Q"), array("Q")
        self._found: dict[str, str] = {}

    def of(self, session_id: str) -> str:
        """The id by which a session's board is watched: 24 hexadecimal digits."""
        digest = hmac.digest(self._key, b"watch:" + session_id.encode(), hashlib.sha256)
        return digest.hex()[:WATCH_ID_DIGITS]

    async def session(self, watch_id: str) -> str | None:
        """The id of the session whose board an id shows; None if it shows none."""
        if len(watch_id) != WATCH_ID_DIGITS or not set(watch_id) <= _DIGITS:
            return None
        if watch_id not in self._found:
            candidates = self._candidates(watch_id)
            while not candidates and await self._look_further():
                candidates = self._candidates(watch_id)
            for row in candidates:
                await self._remember(watch_id, row)
        return self._found.get(watch_id)

    def _candidates(self, watch_id: str) -> list[int]:
        """Rows of the sessions whose watching ids begin as this one.

        Almost always one or none.
        """
        prefixes = np.frombuffer(self._prefixes, np.uint64)
        return [self._rows[at] for at in np.flatnonzero(prefixes == np.uint64(_prefix(watch_id)))]

    async def _look_further(self) -> bool:
        """Take in new sessions.

        Returns:
            Whether there may be more.
        """
        last = self._rows[-1] if self._rows else 0

        def read() -> tuple[array[int], array[int]]:
            sessions = sessions_after(self._store, last, SESSIONS_A_LOOK)
            prefixes = array("Q", [_prefix(self.of(session_id)) for _, session_id in sessions])
            return prefixes, array("Q", [row for row, _ in sessions])

        prefixes, rows = await self._store.read(read)
        if last == (self._rows[-1] if self._rows else 0):  # nobody else took them in meanwhile
            self._prefixes.extend(prefixes)
            self._rows.extend(rows)
        return bool(rows)

    async def _remember(self, watch_id: str, row: int) -> None:
        """Remember the session in a row if it is the one that an id shows."""
        session_id = await self._store.read(lambda: session_of_row(self._store, row))
        if session_id is not None and self.of(session_id) == watch_id:
            if len(self._found) >= MAX_FOUND:
                self._found.clear()
            self._found[watch_id] = session_id


_DIGITS = frozenset("0123456789abcdef")


def _prefix(watch_id: str) -> int:
    return int(watch_id[:16], 16)


class PlayerTokens:
    """Signs players' ids and reads them back.

    Args:
        secret: The database's, so that tokens outlive a restart.
    """

    def __init__(self, secret: str) -> None:
        self._signer = Signer(secret, salt="humanplay-player")

    def sign(self, player_id: str) -> str:
        """The token of a player."""
        return self._signer.sign(player_id).decode()

    def read(self, token: str) -> str | None:
        """The player's id in a token; None if this server did not sign it."""
        try:
            return self._signer.unsign(token).decode()
        except (BadSignature, UnicodeError):
            return None
