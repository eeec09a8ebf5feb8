"""The tables, migration by migration: they bring an empty file, or an older database, to the newest schema.

A released migration never changes, and it calls no code outside this module and `app.storage.first_chain`: what it needs is
written there as it was then.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Callable
from typing import Any

from app.storage.first_chain import begin_chain

Migration = Callable[[sqlite3.Connection], None]


def _create_tables(conn: sqlite3.Connection) -> None:
    for statement in (
        "CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT",
        "CREATE TABLE players (id TEXT PRIMARY KEY, created_ms INTEGER NOT NULL) STRICT",
        """CREATE TABLE sessions (
            id TEXT PRIMARY KEY,
            player_id TEXT REFERENCES players(id),
            owner_id TEXT REFERENCES players(id), -- the player at whose screen it runs: a rival's is its player's
            driver_name TEXT NOT NULL,
            rival_of TEXT REFERENCES sessions(id),
            pace_mode TEXT NOT NULL CHECK (pace_mode IN ('follow', 'timed', 'paused')),
            moves_per_second REAL NOT NULL,
            created_ms INTEGER NOT NULL) STRICT""",
        """CREATE TABLE episodes (
            id TEXT PRIMARY KEY,
            session_id TEXT NOT NULL REFERENCES sessions(id),
            number INTEGER NOT NULL,
            level TEXT NOT NULL,
            config TEXT NOT NULL,
            config_hash TEXT NOT NULL,
            seed INTEGER,
            seed_chosen INTEGER NOT NULL CHECK (seed_chosen IN (0, 1)),
            terrain BLOB NOT NULL,
            terrain_hash TEXT NOT NULL,
            terrain_met_before INTEGER NOT NULL CHECK (terrain_met_before IN (0, 1)),
            start_row INTEGER NOT NULL,
            start_col INTEGER NOT NULL,
            policy_seed INTEGER NOT NULL,
            core_version TEXT NOT NULL,
            driver TEXT NOT NULL CHECK (driver IN ('human', 'script') OR driver LIKE 'policy:%'),
            assisted INTEGER NOT NULL CHECK (assisted IN (0, 1)),
            started_ms INTEGER NOT NULL,
            ended_ms INTEGER,
            outcome TEXT,
            steps INTEGER,
            discovered INTEGER,
            total REAL,
            score REAL,
            trajectory_hash TEXT,
            UNIQUE (session_id, number),
            CHECK ((ended_ms IS NULL) = (outcome IS NULL)),
            CHECK ((ended_ms IS NULL) = (trajectory_hash IS NULL))) STRICT""",
        """CREATE TABLE steps (
            episode_id TEXT NOT NULL REFERENCES episodes(id),
            step INTEGER NOT NULL,
            action INTEGER NOT NULL CHECK (action BETWEEN 0 AND 3),
            reward REAL NOT NULL,
            discovered INTEGER NOT NULL,
            server_ms INTEGER NOT NULL,
            client_ms REAL,
            key_down_ms REAL,
            key_up_ms REAL,
            input TEXT CHECK (input IN ('key', 'touch')),
            driver TEXT NOT NULL,
            PRIMARY KEY (episode_id, step)) STRICT, WITHOUT ROWID""",
    ):
        conn.execute(statement)


def _create_indexes(conn: sqlite3.Connection) -> None:
    conn.execute("CREATE INDEX episodes_by_terrain ON episodes (terrain_hash)")
    conn.execute("CREATE INDEX episodes_by_end ON episodes (ended_ms)")
    conn.execute("CREATE INDEX sessions_by_rival ON sessions (rival_of) WHERE rival_of IS NOT NULL")


def _create_study_tables(conn: sqlite3.Connection) -> None:
    for statement in (
        # written on the first join; closed_ms and secret when the study is closed
        """CREATE TABLE studies (
            name TEXT PRIMARY KEY,
            protocol TEXT NOT NULL,
            protocol_hash TEXT NOT NULL,
            commitment TEXT NOT NULL,
            frozen_ms INTEGER NOT NULL,
            closed_ms INTEGER,
            secret TEXT) STRICT""",
        """CREATE TABLE participants (
            id TEXT PRIMARY KEY,
            study TEXT NOT NULL REFERENCES studies(name),
            player_id TEXT NOT NULL REFERENCES players(id),
            session_id TEXT REFERENCES sessions(id),
            kind TEXT NOT NULL CHECK (kind IN ('human', 'script')),
            script TEXT, -- of kind script: what plays
            stage TEXT NOT NULL CHECK (stage IN ('consent', 'instructions', 'tutorial', 'questions', 'warm_up', 'ranked',
                'debrief', 'complete', 'withdrawn')),
            consent_version TEXT,
            consent_ms INTEGER,
            joined_ms INTEGER NOT NULL,
            completed_ms INTEGER,
            completion_code TEXT,
            settings TEXT NOT NULL DEFAULT '{}',
            UNIQUE (study, player_id)) STRICT""",
        # who somebody is elsewhere: never exported, never joined by a reader that exports
        """CREATE TABLE identities (
            participant_id TEXT NOT NULL REFERENCES participants(id),
            name TEXT NOT NULL,
            value TEXT NOT NULL,
            PRIMARY KEY (participant_id, name)) STRICT""",
        """CREATE TABLE stage_events (
            participant_id TEXT NOT NULL REFERENCES participants(id),
            number INTEGER NOT NULL,
            at_ms INTEGER NOT NULL,
            kind TEXT NOT NULL,
            detail TEXT NOT NULL DEFAULT '{}',
            PRIMARY KEY (participant_id, number)) STRICT""",
        # trial counts in the order played, terrain is the index of its seed
        """CREATE TABLE study_episodes (
            episode_id TEXT PRIMARY KEY REFERENCES episodes(id),
            participant_id TEXT NOT NULL REFERENCES participants(id),
            phase TEXT NOT NULL CHECK (phase IN ('tutorial', 'warm_up', 'ranked')),
            trial INTEGER NOT NULL,
            terrain INTEGER NOT NULL,
            UNIQUE (participant_id, phase, trial)) STRICT""",
        """CREATE TABLE input_events (
            episode_id TEXT NOT NULL REFERENCES episodes(id),
            number INTEGER NOT NULL,
            kind TEXT NOT NULL,
            code TEXT,
            repeat INTEGER,
            trusted INTEGER,
            client_ms REAL NOT NULL,
            step INTEGER,
            round_trip_ms REAL,
            server_ms INTEGER NOT NULL,
            PRIMARY KEY (episode_id, number)) STRICT, WITHOUT ROWID""",
        "CREATE TABLE forgotten (trajectory_hash TEXT PRIMARY KEY, forgotten_ms INTEGER NOT NULL) STRICT",
        "CREATE INDEX participants_by_session ON participants (session_id)",
        "CREATE INDEX participants_by_player ON participants (player_id)",
        "CREATE INDEX identities_by_value ON identities (name, value)",
    ):
        conn.execute(statement)


def _create_release_tables(conn: sqlite3.Connection) -> None:
    for statement in (
        # SHA-256 over stored rows; schema 5 has the chain instead
        """CREATE TABLE digests (
            kind TEXT NOT NULL CHECK (kind IN ('episode', 'events', 'participant')),
            id TEXT NOT NULL,
            digest TEXT NOT NULL,
            PRIMARY KEY (kind, id)) STRICT, WITHOUT ROWID""",
        # what was published; outdated_ms is set when a participant in it was forgotten
        """CREATE TABLE releases (
            study TEXT NOT NULL REFERENCES studies(name),
            version INTEGER NOT NULL,
            manifest_hash TEXT NOT NULL,
            released_ms INTEGER NOT NULL,
            outdated_ms INTEGER,
            PRIMARY KEY (study, version, manifest_hash)) STRICT""",
        # hashes of the ids and times of people who were forgotten: imports and merges leave them out
        "CREATE TABLE forgotten_people (id_hash TEXT PRIMARY KEY, forgotten_ms INTEGER NOT NULL) STRICT",
    ):
        conn.execute(statement)
    _write_digests_of_schema_4(conn)


def _write_digests_of_schema_4(conn: sqlite3.Connection) -> None:
    """Fill the table of digests from the rows, by the rules that schema 4 began with."""
    insert = "INSERT INTO digests VALUES (?, ?, ?)"
    for (ident,) in conn.execute("SELECT id FROM episodes WHERE ended_ms IS NOT NULL").fetchall():
        tables = {
            "episodes": "id = ?",
            "steps": "episode_id = ? ORDER BY step",
            "study_episodes": "episode_id = ?",
        }
        conn.execute(insert, ("episode", ident, _digest_of_schema_4(conn, tables, ident)))
    for (ident,) in conn.execute("SELECT DISTINCT episode_id FROM input_events").fetchall():
        chain = ""
        for row in conn.execute(
            "SELECT * FROM input_events WHERE episode_id = ? ORDER BY number", [ident]
        ):
            chain = hashlib.sha256(chain.encode() + _line_of_schema_4(row)).hexdigest()
        conn.execute(insert, ("events", ident, chain))
    for (ident,) in conn.execute("SELECT id FROM participants").fetchall():
        tables = {"participants": "id = ?", "stage_events": "participant_id = ? ORDER BY number"}
        conn.execute(insert, ("participant", ident, _digest_of_schema_4(conn, tables, ident)))


def _digest_of_schema_4(conn: sqlite3.Connection, tables: dict[str, str], ident: str) -> str:
    """Return SHA-256 (hex) over the names of tables and columns and every row, each a line of JSON."""
    found = hashlib.sha256()
    for table, where in tables.items():
        cursor = conn.execute(f"SELECT * FROM {table} WHERE {where}", [ident])
        found.update(_line_of_schema_4([table, [column[0] for column in cursor.description]]))
        for row in cursor:
            found.update(_line_of_schema_4(row))
    return found.hexdigest()


def _line_of_schema_4(value: Any) -> bytes:
    return json.dumps(value, default=bytes.hex, separators=(",", ":")).encode() + b"\n"


def _add_attestation_and_chain(conn: sqlite3.Connection) -> None:
    unsound = _unsound_in_schema_4(conn)
    levels = "'unattested', 'declared', 'attested', 'supervised'"
    for statement in (
        # what moves a session: the cookie of its player alone, or whoever knows its id
        "ALTER TABLE sessions ADD COLUMN control TEXT NOT NULL DEFAULT 'bearer' CHECK (control IN ('cookie', 'bearer'))",
        "CREATE INDEX sessions_by_owner ON sessions (owner_id)",
        # of a finished episode of a person, and why it is not attested
        f"ALTER TABLE episodes ADD COLUMN attestation TEXT CHECK (attestation IN ({levels}))",
        "ALTER TABLE episodes ADD COLUMN attestation_reason TEXT",
        "UPDATE episodes SET attestation = 'declared' WHERE driver = 'human' AND ended_ms IS NOT NULL",
        # the invitation that brought somebody, and when the operator's code was typed last
        "ALTER TABLE participants ADD COLUMN invitation TEXT",
        "ALTER TABLE participants ADD COLUMN supervised_ms INTEGER",
        "CREATE INDEX participants_by_invitation ON participants (study, invitation) WHERE invitation IS NOT NULL",
        "DROP TABLE digests",
    ):
        conn.execute(statement)
    begin_chain(conn, unsound)


def _unsound_in_schema_4(conn: sqlite3.Connection) -> dict[tuple[str, str], str]:
    """Return what does not fit its digest, or has one and is not there: ("episode" or "participant", id) -> the digest."""
    sql = "SELECT kind, id, digest FROM digests ORDER BY kind, id"
    stored = {(kind, ident): digest for kind, ident, digest in conn.execute(sql).fetchall()}
    conn.execute("DELETE FROM digests")
    _write_digests_of_schema_4(conn)
    right = {(kind, ident): digest for kind, ident, digest in conn.execute(sql).fetchall()}
    return {
        ("participant" if kind == "participant" else "episode", ident): stored.get(
            (kind, ident), "missing"
        )
        for kind, ident in sorted(stored.keys() | right.keys())
        if stored.get((kind, ident)) != right.get((kind, ident))
    }


def _create_daily_tables(conn: sqlite3.Connection) -> None:
    for statement in (
        # the terrain of a day (UTC): the key is told to nobody before the day is over; the config is JSON
        """CREATE TABLE daily_terrains (
            commitment TEXT PRIMARY KEY, -- SHA-256 (hex) of the key, shown from the start of the day on
            day TEXT NOT NULL CHECK (day GLOB '[0-9][0-9][0-9][0-9]-[0-9][0-9]-[0-9][0-9]'),
            key TEXT NOT NULL,
            config TEXT NOT NULL) STRICT""",
        # who has played which day's terrain: each player once
        """CREATE TABLE daily_attempts (
            episode_id TEXT PRIMARY KEY REFERENCES episodes(id),
            day TEXT NOT NULL,
            player_id TEXT NOT NULL REFERENCES players(id),
            commitment TEXT NOT NULL REFERENCES daily_terrains(commitment),
            UNIQUE (day, player_id)) STRICT""",
        "CREATE INDEX daily_terrains_by_day ON daily_terrains (day)",
    ):
        conn.execute(statement)


def _create_event_batches(conn: sqlite3.Connection) -> None:
    # the batches in which input events came: a batch that comes again is known by its id, without a look at the events
    conn.execute(
        """CREATE TABLE event_batches (
            episode_id TEXT NOT NULL REFERENCES episodes(id),
            first INTEGER NOT NULL, -- number of its first event
            batch TEXT NOT NULL, -- the page's id, or SHA-256 (hex) of the events where it gave none
            PRIMARY KEY (episode_id, first),
            UNIQUE (episode_id, batch)) STRICT, WITHOUT ROWID"""
    )


def _create_operator_tables(conn: sqlite3.Connection) -> None:
    for statement in (
        # operators who log in by name: the hash is argon2id's, last_code the newest period whose code of TOTP was used
        """CREATE TABLE operators (
            name TEXT PRIMARY KEY,
            password_hash TEXT NOT NULL,
            totp_secret TEXT,
            last_code INTEGER NOT NULL,
            created_ms INTEGER NOT NULL) STRICT""",
        # what operators did; status is that of the answer, null until there is one
        """CREATE TABLE operator_actions (
            number INTEGER PRIMARY KEY,
            at_ms INTEGER NOT NULL,
            operator TEXT NOT NULL,
            action TEXT NOT NULL,
            study TEXT,
            status INTEGER) STRICT""",
    ):
        conn.execute(statement)


MIGRATIONS: tuple[Migration, ...] = (
    _create_tables,
    _create_indexes,
    _create_study_tables,
    _create_release_tables,
    _add_attestation_and_chain,
    _create_daily_tables,
    _create_event_batches,
    _create_operator_tables,
)
"""Migration k (from 1) leads from schema k - 1 to schema k."""
