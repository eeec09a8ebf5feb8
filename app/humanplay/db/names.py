"""Players' names."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection
from typing import NamedTuple, TypedDict

from humanplay.db.reader import Reader

MOST_CHALLENGERS = 20
"""People in the list of a challenge."""

SHOWN = 100
"""Names in the operator's list."""

_OWN = """SELECT n.name, n.hidden FROM (SELECT ? AS id) p LEFT JOIN names n ON n.player_id = p.id"""


class OwnName(TypedDict):
    """A player's own name, None for none, and whether an operator has hidden it."""

    name: str | None
    hidden: bool


class ChosenName(TypedDict):
    """A name, when it was chosen, and whether an operator has hidden it."""

    name: str
    hidden: bool
    chosen_ms: int


class NameTakenError(ValueError):
    """Somebody has this name, or one that looks like it."""


def shown_names(reader: Reader) -> dict[str, str]:
    """The names by player, without those that an operator has hidden."""
    rows = reader.query("SELECT player_id, name FROM names WHERE NOT hidden")
    return {row["player_id"]: row["name"] for row in rows}


class ChallengeSuccess(NamedTuple):
    """Somebody's success at a challenge: their name, if they have one, and moves."""

    name: str | None
    moves: int


def challengers(
    reader: Reader, episode_id: str, successes: Collection[str]
) -> list[ChallengeSuccess]:
    """Who took up a challenge and succeeded, the fewest moves first."""
    marks = ", ".join("?" for _ in successes)
    sql = f"""SELECT n.name, e.steps AS moves FROM sessions s CROSS JOIN episodes e ON e.session_id = s.id
        LEFT JOIN names n ON n.player_id = s.owner_id AND NOT n.hidden
        WHERE s.challenges = ? AND e.ended_ms IS NOT NULL AND e.driver = 'human' AND e.outcome IN ({marks})
        ORDER BY e.steps, e.ended_ms LIMIT {MOST_CHALLENGERS}"""
    return [ChallengeSuccess(**row) for row in reader.query(sql, [episode_id, *successes])]


def own(reader: Reader, player_id: str) -> OwnName:
    """A player's own name."""
    (row,) = reader.query(_OWN, [player_id])
    return {"name": row["name"], "hidden": bool(row["hidden"])}


def set_name(
    conn: sqlite3.Connection, player_id: str, name: str, likeness: str, at_ms: int
) -> bool:
    """Give a player a name; return whether there is such a player.

    Raises:
        NameTakenError: If somebody else has the name.

    A name that an operator has hidden stays hidden after a change.
    """
    sql = """INSERT INTO names SELECT id, ?2, ?3, ?4, 0 FROM players WHERE id = ?1
        ON CONFLICT (player_id) DO UPDATE SET name = ?2, likeness = ?3, chosen_ms = ?4"""
    try:
        return conn.execute(sql, (player_id, name, likeness, at_ms)).rowcount > 0
    except sqlite3.IntegrityError as error:
        raise NameTakenError(
            "somebody has this name, or one that looks like it: choose another"
        ) from error


def introduce(
    conn: sqlite3.Connection, player_id: str, name: str, likeness: str, at_ms: int
) -> bool:
    """Name a player as `set_name` does, who need not have played."""
    conn.execute("INSERT OR IGNORE INTO players (id, created_ms) VALUES (?, ?)", [player_id, at_ms])
    return set_name(conn, player_id, name, likeness, at_ms)


def remove_name(conn: sqlite3.Connection, player_id: str) -> None:
    """Remove a player's name. A hidden name stays, so that nobody can choose it again."""
    conn.execute("DELETE FROM names WHERE player_id = ? AND NOT hidden", [player_id])


def hide_name(conn: sqlite3.Connection, name: str, hidden: bool) -> bool:
    """Hide a name or show it again; return whether anybody has it."""
    return conn.execute("UPDATE names SET hidden = ? WHERE name = ?", (hidden, name)).rowcount > 0


def newest_names(reader: Reader) -> list[ChosenName]:
    """The names that were chosen last, and whether each is hidden."""
    sql = "SELECT name, chosen_ms, hidden FROM names ORDER BY chosen_ms DESC LIMIT ?"
    return [
        {"name": row["name"], "chosen_ms": row["chosen_ms"], "hidden": bool(row["hidden"])}
        for row in reader.query(sql, [SHOWN])
    ]


def named(conn: sqlite3.Connection, name: str) -> str | None:
    """The id of the player with a name; None for nobody's."""
    row = conn.execute("SELECT player_id FROM names WHERE name = ?", [name]).fetchone()
    return None if row is None else str(row[0])


INVITED = "invited"
"""A row of the table `meta` called `invited|NUMBER` has the id of the player whose link has that number."""


def invited(conn: sqlite3.Connection, number: int) -> str | None:
    """The id of the player whose link has a number; None if there is none."""
    sql = "SELECT p.id FROM meta m JOIN players p ON p.id = m.value WHERE m.name = ?"
    row = conn.execute(sql, [f"{INVITED}|{number}"]).fetchone()
    return None if row is None else str(row[0])


def invite(conn: sqlite3.Connection, number: int, player_id: str) -> None:
    """Remember whose link has a number."""
    conn.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (f"{INVITED}|{number}", player_id))


def forget_invitation(conn: sqlite3.Connection, player_id: str) -> None:
    """Forget the number of a player's link."""
    sql = "DELETE FROM meta WHERE name LIKE ? || '|%' AND value = ?"
    conn.execute(sql, (INVITED, player_id))
