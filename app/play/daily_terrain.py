"""The terrain of a day: its key from a secret and the date, its commitment and its seed from the key.

The key is HMAC-SHA256(secret, date). Its SHA-256, the commitment, is shown from the start of the day; the key is told once the
day (UTC) is over, and with it anybody can check the commitment and draw the terrain again. Earlier keys say nothing about later
ones, since the secret is told to nobody.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import sqlite3
from collections.abc import Iterator
from datetime import UTC, date, datetime
from functools import lru_cache
from typing import Any

from app.storage.playground import DailyTerrain, daily_causes, daily_terrains
from app.storage.reader import utc_day
from app.storage.resimulation import Finding
from app.storage.store import DAY_MS
from marsexplorer.config import EnvConfig
from marsexplorer.terrain import generate
from marsexplorer.world import cells_that_count

CONFIG = EnvConfig.of("random", 21)
"""What is played every day: level "random" with 21x21 cells, as the playground begins."""

START_SLACK_MS = 60_000
"""How long after midnight an attempt may start that was asked for before."""


def terrain_of_day(secret: bytes, day: str) -> DailyTerrain:
    """Return the terrain that a day (UTC, "2026-11-22") has on the server with this secret."""
    key = hmac.new(secret, day.encode(), hashlib.sha256).digest()
    return DailyTerrain(commitment_of(key), day, key, CONFIG)


def commitment_of(key: bytes) -> str:
    """Return SHA-256 (hex) of a day's key: shown before the key is told."""
    return hashlib.sha256(key).hexdigest()


def seed_of(key: bytes) -> int:
    """Return the terrain's seed: the first 53 bits of SHA-256("terrain" + key), 0..2^53-1."""
    return int.from_bytes(hashlib.sha256(b"terrain" + key).digest()[:8], "big") >> 11


def cells_of_daily(terrain: DailyTerrain) -> int:
    """Return how many cells coverage refers to on the terrain of a day: all, or those that can be discovered."""
    config = terrain.config
    return cells_of_seed(config, seed_of(terrain.key)) if config.discoverable_only else config.n


@lru_cache(maxsize=64)
def cells_of_seed(config: EnvConfig, seed: int) -> int:
    """Return how many cells can be discovered on the terrain of a seed, where only those count."""
    return cells_that_count(config, generate(config, seed), (0, 0))


def day_start_ms(day: str) -> int:
    """Return when a day began (UTC), in milliseconds since 1970; ValueError unless it is a date like "2026-11-22"."""
    if len(day) != 10:
        raise ValueError(f"a day must be a date like 2026-11-22, got {day!r}")
    return (
        int(datetime.combine(date.fromisoformat(day), datetime.min.time(), UTC).timestamp()) * 1000
    )


def day_before(day: str, days: int = 1) -> str:
    """Return the day that came so many days before."""
    return utc_day(day_start_ms(day) - days * DAY_MS)


def check_daily(conn: sqlite3.Connection) -> Iterator[Finding]:
    """Yield daily terrains that are not those of their commitments, and attempts that are not of their day's terrain."""
    for row in daily_terrains(conn):
        try:
            found = commitment_of(bytes.fromhex(row["key"]))
        except ValueError as error:
            found = f"a key that cannot be read: {error}"
        if found != row["commitment"]:
            yield Finding(
                f"daily terrain {row['day']}",
                "commitment",
                row["commitment"],
                f"{found} from its key",
            )
    for row in daily_causes(conn):
        yield from _check_cause(row)


def _check_cause(row: dict[str, Any]) -> Iterator[Finding]:
    where = f"episode {row['episode_id']}"
    try:
        seed, began = seed_of(bytes.fromhex(row["key"])), day_start_ms(row["day"])
    except ValueError as error:
        yield Finding(where, "day and key of its daily terrain", row["day"], str(error))
        return
    for what, stored, expected in (
        ("seed", row["seed"], seed),
        ("config", json.loads(row["config"]), json.loads(row["terrain_config"])),
        ("seed_chosen, assisted", (row["seed_chosen"], row["assisted"]), (0, 0)),
        ("day", row["day"], row["terrain_day"]),
        ("player", row["player_id"], row["owner_id"]),
    ):
        if stored != expected:
            yield Finding(where, f"{what} of a daily attempt", stored, expected)
    if not 0 <= row["started_ms"] - began < DAY_MS + START_SLACK_MS:
        yield Finding(
            where, "start of a daily attempt", row["started_ms"], f"a time on {row['day']} (UTC)"
        )
