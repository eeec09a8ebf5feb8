"""The people who stay out of a release, counted: those who did not agree, and invitations that nobody used.

The counts go into the release's database, from which its report draws the flow of participants, and with an import into the
next database.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping
from dataclasses import asdict

from app.storage.database import rows
from app.storage.erasure import ARRIVALS, ERASED
from app.study.flow import Arrivals, with_invitations, with_noted
from app.study.invitations import Invitation


def count_arrivals(
    conn: sqlite3.Connection, study: str, invitations: Mapping[str, Invitation] | None
) -> Arrivals:
    """Return the arrivals of a study in the database that a release is made from.

    invitations  of the study by id, where its folder is at hand
    """
    undecided = """SELECT coalesce(sum(stage = 'withdrawn'), 0) AS declined, coalesce(sum(stage <> 'withdrawn'), 0) AS undecided
        FROM participants WHERE study = ? AND kind = 'human' AND consent_ms IS NULL"""
    (counted,) = rows(conn, undecided, study)
    (erased,) = rows(
        conn, "SELECT count(*) AS n FROM meta WHERE name LIKE ?", f"{ERASED}|{study}|%"
    )
    noted = rows(conn, "SELECT value FROM meta WHERE name = ?", f"{ARRIVALS}|{study}")
    found = with_noted(
        Arrivals(**counted, erased=erased["n"]), json.loads(noted[0]["value"]) if noted else {}
    )
    if invitations is None:
        return found
    opened = rows(
        conn,
        "SELECT invitation FROM participants WHERE study = ? AND invitation IS NOT NULL",
        study,
    )
    return with_invitations(found, invitations, [row["invitation"] for row in opened])


def arrivals_row(study: str, arrivals: Arrivals) -> dict[str, str]:
    """Return the row of the table `meta` that holds a study's arrivals; the erased have rows of their own there."""
    counts = {name: count for name, count in asdict(arrivals).items() if name != "erased"}
    return {"name": f"{ARRIVALS}|{study}", "value": json.dumps(counts, sort_keys=True)}
