"""A database of many episodes, in minutes: copies of recorded ones.

They have new ids, players and seeds.

Of a hundred episodes some sixty are ranked ones of people, a tenth was left, twenty are a policy's,
fifteen attempts at daily terrains and the others of two studies, of which one is closed. A copy has
hashes of its terrain and its trajectory drawn anew, so that nothing which is kept by them serves
two episodes; `verify` would therefore find every copy wrong.
"""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

from humanplay.db import volunteers
from humanplay.db.columns import TABLES
from humanplay.db.database import transaction
from humanplay.db.reader import now_ms, utc_day
from humanplay.db.store import Store
from humanplay.db.trial import parse_config
from humanplay.results.entries import entry_of
from humanplay.study.days import day_before
from marsexplorer.config import EnvConfig
from tests.support.recorded import play
from tests.support.recorded_daily import play_daily
from tests.support.stored_studies import freeze, play_study

SHARES = {"ranked": 0.5, "left": 0.1, "policy": 0.2, "daily": 0.15, "dunes": 0.025, "ridge": 0.025}
DAYS = 60
"""Of daily terrains, the last of them today, and of everything else."""
_DRAWN = "lower(hex(randomblob(32)))"
_SHIFTED = ("started_ms", "ended_ms", "server_ms", "created_ms", "joined_ms", "completed_ms")


def make_episodes(
    path: Path,
    studies: Path,
    episodes: int,
    configs: tuple[EnvConfig, ...],
    players: int = 3000,
) -> None:
    """Make a database with about so many episodes and players, and its studies."""
    for name in ("dunes", "ridge"):
        study = freeze(studies, name, close=name == "dunes")
        play_study(path, study, ("human",) * 6)
    store = Store(path)
    try:
        with store.transaction():
            originals = {name: [] for name in ("ranked", "left", "policy", "daily")}
            for seed, config in enumerate(configs * 12):
                originals["ranked"].append(play(store, seed, "a", True, config))
                originals["left"].append(play(store, 10_000 + seed, "b", config=config))
                policy = {"driver": "policy:frontier-cost"}
                originals["policy"].append(play(store, 20_000 + seed, "c", True, config, **policy))
            day = utc_day(now_ms())
            for _ in range(DAYS):
                originals["daily"].append(play_daily(store, "d", day, explore=True))
                day = day_before(day)
        conn = store.connection
        conn.execute("PRAGMA foreign_keys = OFF")
        conn.execute("PRAGMA cache_size = -400000")
        with transaction(conn):
            conn.execute(
                "CREATE TEMP TABLE copies (old TEXT, new TEXT, player TEXT, person TEXT, shift "
                "INTEGER)"
            )
            _plan(
                conn,
                {name: [row.session_id for row in rows] for name, rows in originals.items()},
                episodes,
                players,
            )
            _copy(conn)
            conn.execute("DROP TABLE copies")
            volunteers.renew(conn)
            conn.execute(
                "INSERT INTO names SELECT id, id, id, 0, 0 FROM players WHERE id GLOB 'player-*'"
            )
    finally:
        store.close()


def public_reads(path: Path) -> list[str]:
    """The public addresses of such a database, without exports and slow jobs."""
    with closing(sqlite3.connect(path)) as conn:
        # one of the longest of people: of another length other databases would hold another amount
        # to read
        alike = """FROM episodes WHERE driver = 'human' AND steps = (SELECT max(steps) FROM episodes
            WHERE driver = 'human' AND id NOT IN (SELECT episode_id FROM series_episodes))"""
        sql = f"SELECT id {alike} ORDER BY ended_ms DESC, id LIMIT 1 OFFSET (SELECT count(*) / 3 {alike})"
        (middle,) = conn.execute(sql).fetchone()
        (config,) = conn.execute("SELECT config FROM episodes WHERE id = ?", [middle]).fetchone()
        board = entry_of(parse_config("mars", config)).id
    of, yesterday = "/api/episodes", day_before(utc_day(now_ms()))
    return [
        "/api/health",
        "/readyz",
        "/api/levels",
        "/api/policies",
        of,
        f"{of}?who=human",
        f"{of}?limit=200",
        f"{of}?after={middle}",
        f"{of}?after={middle}&who=human",
        f"{of}/{middle}",
        f"{of}/{middle}/replay",
        f"/replay/{middle}",
        f"/watch/{middle}",
        f"/api/watch/{middle}",
        "/api/human-level",
        "/api/leaderboard",
        f"/api/leaderboard/{board}",
        "/api/leaderboard/study-dunes",
        "/api/me/history",
        "/api/me/session",
        "/api/daily",
        f"/api/daily/{yesterday}",
        f"/api/daily/{yesterday}/results",
        "/api/studies",
        "/api/studies/dunes",
        "/api/people",
        "/",
        "/me",
        "/leaderboard",
        "/daily",
    ]


def _plan(conn, sessions: dict[str, list[str]], episodes: int, players: int) -> None:
    """Plan which session is copied how often, for whom, and how much later (ms)."""
    add = f"""INSERT INTO copies WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n WHERE i < ?1 - 1)
        SELECT value, {_DRAWN}, 'player-' || ((?4 + i) % {players}), NULL, ?3 * -(abs(random()) % {DAYS * 86_400_000})
        FROM n JOIN json_each(?2) ON key = i % json_array_length(?2)"""

    for kind, ids in sessions.items():
        copies = int(episodes * SHARES[kind])
        if kind != "daily":
            conn.execute(add, (copies, json.dumps(ids), 1, 0))
            continue
        for number, session in enumerate(ids):  # a player plays a day's terrain once
            conn.execute(add, (min(copies // DAYS, players), json.dumps([session]), 0, 37 * number))
    for study in ("dunes", "ridge"):
        sql = "SELECT session_id FROM participants WHERE study = ? AND kind = 'human'"
        ids = [row[0] for row in conn.execute(sql, [study])]
        conn.execute(add, (int(episodes * SHARES[study]) // 6, json.dumps(ids), 0, 0))
        conn.execute(
            f"""UPDATE copies SET person = lower(hex(randomblob(16))), player = {_DRAWN}
            WHERE person IS NULL AND old IN (SELECT session_id FROM participants WHERE study = ?)""",
            [study],
        )


def _copy(conn) -> None:
    conn.execute("CREATE INDEX temp.copies_by_old ON copies (old)")
    conn.execute(
        f"""CREATE TEMP TABLE copied AS SELECT e.id AS old, {_DRAWN} AS new, c.new AS session, c.player, c.person,
        c.shift FROM copies c JOIN episodes e ON e.session_id = c.old ORDER BY 2"""
    )
    conn.execute("INSERT OR IGNORE INTO players SELECT DISTINCT player, 0 FROM copies")
    person = {"participant_id": "c.person"}
    _rows(
        conn,
        "sessions",
        "copies",
        "id",
        {"id": "c.new", "player_id": "c.player", "owner_id": "c.player"},
    )
    _rows(
        conn,
        "participants",
        "copies",
        "session_id",
        {
            "id": "c.person",
            "player_id": "c.player",
            "session_id": "c.new",
            "completion_code": "c.person",
        },
    )
    of_person = "copies c JOIN participants p ON p.session_id = c.old JOIN stage_events t ON t.participant_id = p.id"
    _insert(conn, "stage_events", of_person, person)
    drawn = {
        "terrain_hash": _DRAWN,
        "trajectory_hash": _DRAWN,
        "seed": "abs(random()) % 1000000000",
    }
    _rows(conn, "episodes", "copied", "id", {"id": "c.new", "session_id": "c.session", **drawn})
    new = {"episode_id": "c.new"}
    _rows(conn, "steps", "copied", "episode_id", new)
    _rows(conn, "input_events", "copied", "episode_id", new)
    place = {"player_id": "iif(t.player_id IS NULL, NULL, c.player)", "participant_id": "c.person"}
    _rows(conn, "series_episodes", "copied", "episode_id", {**new, **place})
    conn.execute("DROP TABLE copied")


def _rows(conn, table: str, copies: str, key: str, replaced: dict[str, str]) -> None:
    _insert(conn, table, f"{copies} c CROSS JOIN {table} t ON t.{key} = c.old", replaced)


def _insert(conn, table: str, source: str, replaced: dict[str, str]) -> None:
    names = TABLES[table].names()
    values = [
        replaced.get(name) or (f"t.{name} + c.shift" if name in _SHIFTED else f"t.{name}")
        for name in names
    ]
    conn.execute(
        f"INSERT INTO {table} ({', '.join(names)}) SELECT {', '.join(values)} FROM {source}"
    )
