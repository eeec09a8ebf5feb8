"""A backup put in the place of a database, after both were looked at; what stood there is kept under another name."""

from __future__ import annotations

import os
from pathlib import Path

from app.backup.copying import PARTIAL, Advance, back_up, sync_folder
from app.database_file.lock import take_lock
from app.storage.database import StoreError


def restore(
    backup: Path, database: Path, stamp: str, advance: Advance | None = None
) -> Path | None:
    """Put a verified copy of a backup in the place of a database, and return the name of what stood there, if anything did.

    stamp  distinguishes that name: NAME.before-STAMP, with its log NAME.before-STAMP-wal where it has one

    StoreError while a server has the database, when the backup is not whole, and when the disk is full: nothing changes then.
    """
    if not backup.exists():
        raise StoreError(
            f"no backup at {backup}: give the path of a file that `marsexplorer backup` wrote"
        )
    if database.exists() and backup.samefile(database):
        raise StoreError(f"{backup} is the database itself: give the path of a backup")
    lock = take_lock(database)
    new = database.with_name(database.name + ".restored")
    try:
        new.unlink(missing_ok=True)
        back_up(backup, new, advance)
        kept = _set_aside(database, stamp) if database.exists() else None
        new.replace(database)
        lock.clear_step()
        sync_folder(database.parent)
        return kept
    except OSError as error:
        raise StoreError(f"cannot restore to {database}: {error.strerror or error}") from error
    finally:
        lock.close()
        new.unlink(missing_ok=True)
        new.with_name(new.name + PARTIAL).unlink(missing_ok=True)


def _set_aside(database: Path, stamp: str) -> Path:
    """Give the database and its log a second name, and take the log away from the first: it must not meet the restored file."""
    kept = database.with_name(f"{database.name}.before-{stamp}")
    os.link(database, kept)
    log = database.with_name(database.name + "-wal")
    if log.exists():
        os.link(log, kept.with_name(kept.name + "-wal"))
    sync_folder(database.parent)
    for suffix in ("-wal", "-shm"):
        database.with_name(database.name + suffix).unlink(missing_ok=True)
    return kept
