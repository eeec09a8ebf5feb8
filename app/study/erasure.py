"""A participant erased for good, found by what they or the operator know of them: an id, a label or an outside id."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

from app.storage.connection import reading
from app.storage.database import StoreError
from app.storage.erasure import Erasure, erase, opened_for_erasure, participants_named


class ParticipantLookupError(StoreError):
    """No participant is meant, or more than one; the message says which, and the way out."""


def find_participant(database: Path, name: str, study: str | None = None) -> dict[str, Any]:
    """Return the row of the one participant meant by an id, a label or an outside id.

    ParticipantLookupError when there is none, or several.
    """
    with reading(database) as conn:
        return _the_one(conn, database, name, study)


def forget(database: Path, name: str, study: str | None = None) -> Erasure:
    """Erase a participant and return what was erased.

    name  a participant's id, the label their page shows, or an outside id of theirs

    The database must not be in use: StoreError while a server, or any other program, has it open.
    """
    with opened_for_erasure(database) as conn:
        return erase(conn, database, _the_one(conn, database, name, study))


def _the_one(conn: sqlite3.Connection, database: Path, name: str, study: str | None) -> dict[str, Any]:
    found = participants_named(conn, name, study)
    if not found:
        where = f"the study {study!r} of {database}" if study else str(database)
        raise ParticipantLookupError(
            f"no participant {name!r} in {where}: give their id, label or the outside id of their link"
        )
    if len(found) > 1:
        studies = ", ".join(sorted({person["study"] for person in found}))
        raise ParticipantLookupError(
            f"{name!r} stands for {len(found)} participants (studies: {studies}): give --study, or one participant's id; "
            "nothing was erased"
        )
    return found[0]
