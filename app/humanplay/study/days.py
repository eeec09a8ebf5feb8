"""The terrain of a day: a series of one terrain, which closes at midnight (UTC).

The day's secret, its key, is HMAC-SHA256(the database's secret, date). Earlier keys say nothing about later ones. Commitment
and seed follow from it as from a study's secret (`humanplay.study.seeds`): the protocol is the day, the task and the
configuration.
"""

from __future__ import annotations

import hashlib
import hmac
import json
from dataclasses import dataclass, field
from datetime import UTC, date, datetime

from humanplay.db.reader import Reader, utc_day
from humanplay.db.series import find_day
from humanplay.db.store import DAY_MS
from humanplay.db.study_rows import SeriesRow
from humanplay.db.trial import DAILY, parse_config
from humanplay.study.protocol import canonical_json
from humanplay.study.seeds import commitment, seed
from humanplay.task import Configuration

START_SLACK_MS = 60_000
"""How long after midnight an attempt may start that was asked for before."""


@dataclass(frozen=True)
class DailyTerrain:
    """The terrain of a day.

    Attributes:
        series: Its row in the database, which nobody may see before the day is over.
    """

    series: SeriesRow = field(repr=False)
    day: str
    config: Configuration
    task: str

    @classmethod
    def of(cls, series: SeriesRow) -> DailyTerrain:
        """The terrain of a day's series.

        Raises:
            ValueError, TypeError, KeyError: If its protocol cannot be read.
        """
        protocol = json.loads(series.protocol)
        config = parse_config(protocol["task"], json.dumps(protocol["config"]))
        return cls(series, protocol["day"], config, protocol["task"])

    @classmethod
    def draw(cls, secret: bytes, day: str, task: str, config: Configuration) -> DailyTerrain:
        """Draw the terrain of a day (UTC, "2026-11-22") from a database's secret."""
        key = hmac.digest(secret, day.encode(), hashlib.sha256)
        protocol = canonical_json({"config": config.to_dict(), "day": day, "task": task})
        began, bound = day_start_ms(day), commitment(key)
        series = SeriesRow(
            f"{DAILY}:{day}:{bound[:12]}", protocol.decode(), hashlib.sha256(protocol).hexdigest(), bound,
            began, began + DAY_MS, key.hex(), DAILY,
        )  # fmt: skip
        return cls(series, day, config, task)

    @property
    def seed(self) -> int:
        """The seed that draws it, 0..2^53-1."""
        return seed(bytes.fromhex(self.series.secret or ""), self.series.protocol_hash, "ranked", 0)

    @property
    def ends_ms(self) -> int:
        """When the day is over, in milliseconds since 1970."""
        return self.series.closed_ms or 0


def terrain_on(reader: Reader, day: str) -> DailyTerrain | None:
    """The terrain of a day in the database; None without one.

    A merged database may have several: the most played one.
    """
    series = find_day(reader, day)
    return None if series is None else DailyTerrain.of(series)


def day_start_ms(day: str) -> int:
    """When a day like "2026-11-22" begins (UTC), in ms since 1970.

    Raises:
        ValueError: If it is no such date.
    """
    if len(day) != 10:
        raise ValueError(f"a day must be a date like 2026-11-22, got {day!r}")
    began = datetime.combine(date.fromisoformat(day), datetime.min.time(), UTC)
    return int(began.timestamp()) * 1000


def day_before(day: str, days: int = 1) -> str:
    """Return the day that came so many days before."""
    return utc_day(day_start_ms(day) - days * DAY_MS)
