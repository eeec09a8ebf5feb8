"""Backups that a server makes by itself, every so many minutes, in a folder that keeps the newest ones."""

from __future__ import annotations

import asyncio
import logging
import re
import threading
import time
from datetime import UTC, datetime
from pathlib import Path

from app.backup.copying import back_up
from app.storage.database import StoreError

_log = logging.getLogger(__name__)


class StoppedError(Exception):
    """The server ends: the backup that was being made is given up."""


class Backups:
    """The backups of one database in a folder, `NAME-YYYYMMDDTHHMMSSZ.db`.

    every_s  seconds between them; the first one is made at once when the newest in the folder is older than that
    keep     how many stay; older ones are deleted after a new one was verified. Other files in the folder stay as they are
    """

    def __init__(self, database: Path, folder: Path, every_s: float, keep: int) -> None:
        self._database, self._folder, self._every_s, self._keep = database, folder, every_s, keep
        self._pattern = re.compile(re.escape(database.stem) + r"-\d{8}T\d{6}Z\.db")
        self._stopped = threading.Event()
        self.failures = 0

    def existing(self) -> list[Path]:
        """Return the backups in the folder, oldest first."""
        if not self._folder.is_dir():
            return []
        return sorted(path for path in self._folder.iterdir() if self._pattern.fullmatch(path.name))

    def age_s(self) -> float:
        """Return seconds since the newest backup, -1 when there is none."""
        newest = self.existing()[-1:]
        return time.time() - newest[0].stat().st_mtime if newest else -1.0

    def make(self) -> Path:
        """Make a backup now, delete the oldest beyond `keep`, and return its path; StoreError when it cannot be made."""
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        target = self._folder / f"{self._database.stem}-{stamp}.db"
        back_up(self._database, target, self._check_going_on)
        for path in self.existing()[: -self._keep]:
            path.unlink(missing_ok=True)
        return target

    async def run(self) -> None:
        """Make one backup after the other until cancelled; one that fails is logged, and the next one is tried in time."""
        age_s = self.age_s()
        wait_s = 0.0 if age_s < 0 else max(0.0, self._every_s - age_s)
        try:
            while True:
                await asyncio.sleep(wait_s)
                wait_s = self._every_s
                try:
                    await asyncio.to_thread(self.make)
                except (StoreError, OSError) as error:
                    self.failures += 1
                    _log.error("no backup was made: %s", error)
        finally:
            self._stopped.set()

    def _check_going_on(self, done: int, total: int) -> None:
        del done, total
        if self._stopped.is_set():
            raise StoppedError
