"""Where a server takes its ids, its seeds and the time from."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass

from app.storage.reader import now_ms
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
