"""Migrations: databases of every earlier schema keep everything that is in them, and go on."""

import json
import sqlite3
from contextlib import closing

import pytest

from app.play.replays import restore_episode
from app.storage import chain, database
from app.storage.database import StoreError, open_database
from app.storage.migrations import MIGRATIONS
from app.storage.reader import Reader
from app.storage.store import Store
from app.study.verification import verify_database
from marsexplorer.episode import replay
from tests.support import earlier
from tests.support.recorded import resumable


@pytest.fixture
def path(tmp_path):
    return tmp_path / "play.db"


@pytest.fixture(params=earlier.SCHEMAS, ids=lambda schema: f"schema {schema}")
def old(request, tmp_path):
    """A copy of the database of an earlier schema, and what is expected of it."""
    return earlier.database(request.param, tmp_path)


def count_rows(conn):
    tables = [
        name
        for (name,) in conn.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name"
        )
    ]
    return {table: conn.execute(f"SELECT count(*) FROM {table}").fetchone()[0] for table in tables}


def read_digests(conn):
    return [
        list(row) for row in conn.execute("SELECT kind, id, digest FROM digests ORDER BY kind, id")
    ]


def test_there_is_a_database_of_every_earlier_schema():
    assert tuple(range(1, len(MIGRATIONS))) == earlier.SCHEMAS


LATER = ("daily_attempts", "daily_terrains", "event_batches", "operators", "operator_actions")
"""Tables that came after schema 5; an upgrade leaves them empty where they are new."""


def test_an_old_database_has_the_newest_schema_afterwards_and_every_row_it_had(old):
    path, expected = old
    with closing(sqlite3.connect(path)) as conn:
        assert conn.execute("PRAGMA user_version").fetchone() == (expected["user_version"],)
        assert count_rows(conn) == expected["rows"]
    with closing(open_database(path).conn) as conn:
        assert conn.execute("PRAGMA user_version").fetchone() == (len(MIGRATIONS),)
        after = count_rows(conn)
        entries = len(chain.things(conn))
    for name in ("chain", "chain_salts"):
        assert after[name] == expected["rows"].get(name, entries)
    for name in LATER:
        assert after.pop(name) == expected["rows"].get(name, 0)
    for rows in (expected["rows"], expected["upgraded"]["rows"]):
        kept = {name: count for name, count in rows.items() if name not in ("digests", *LATER)}
        assert {name: after[name] for name in kept} == kept
    before_the_chain = after.keys() - {"chain", "chain_salts"} | {"digests"}
    assert expected["upgraded"]["rows"].keys() - set(LATER) in (after.keys(), before_the_chain)


@pytest.mark.parametrize("schema", earlier.SCHEMAS[:4])
def test_an_old_database_gets_the_digests_it_always_got(schema, tmp_path):
    path, expected = earlier.database(schema, tmp_path)
    with closing(open_database(path, migrations=MIGRATIONS[:4]).conn) as conn:
        assert read_digests(conn) == expected["upgraded"]["digests"]


@pytest.mark.parametrize("schema", earlier.SCHEMAS[:4])
def test_the_first_chain_is_what_the_code_that_goes_on_with_it_would_have_made(schema, tmp_path):
    path, _ = earlier.database(schema, tmp_path)
    with closing(open_database(path).conn) as conn:
        found = conn.execute(
            "SELECT c.*, s.id, s.salt, s.parts FROM chain c JOIN chain_salts s USING (number)"
        ).fetchall()
        before = ""
        for *entry, head, ident, salt, parts in sorted(found):
            made = chain.compute(conn, chain.Thing(entry[2], ident), salt, entry[3])
            assert json.loads(parts) == made
            assert entry[5] == chain.combine(made)
            assert head == (before := chain.link(before, entry))
        assert {chain.Thing(row[2], row[-3]) for row in found} == chain.things(conn)


def test_a_chain_of_an_earlier_schema_keeps_its_head_and_goes_on_with_entries_of_the_newest_version(
    tmp_path,
):
    path, expected = earlier.database(5, tmp_path)
    was = expected["upgraded"]["chain"]
    with closing(Store(path)) as store:
        assert tuple(chain.head(store.connection)) == (was["entries"], was["head"])
        store.add_player("somebody-new", 1)
        (running, *_) = (found for found in resumable(store, 0) if not found.ended)
        episode = restore_episode(running.episode, running.actions)
        episode.abandon()
        store.close_episode(
            running.episode.id,
            episode.record(),
            running.episode.started_ms + 1,
            "unattested",
            "given up",
        )
        versions = store.query(
            "SELECT version, count(*) AS n FROM chain GROUP BY version ORDER BY version"
        )
    assert [tuple(row.values()) for row in versions] == [(1, was["entries"]), (chain.VERSION, 1)]
    verified = verify_database(path, head=was["head"])
    assert [finding.what for finding in verified.findings] == [
        "attestation"
    ]  # which this test made up
    assert verified.since.entry == was["entries"]


HARMED_BEFORE = [
    ("UPDATE steps SET client_ms = 5 WHERE episode_id = (SELECT min(episode_id) FROM steps)", 1),
    ("UPDATE participants SET joined_ms = joined_ms + 1 WHERE stage = 'complete'", 1),
    (
        "DELETE FROM stage_events WHERE number = 2 AND participant_id = (SELECT min(participant_id) FROM stage_events)",
        1,
    ),
    (
        "DELETE FROM digests WHERE kind = 'episode' AND id = (SELECT min(id) FROM digests WHERE kind = 'episode')",
        1,
    ),
    ("UPDATE input_events SET code = 'x' WHERE number = 0", 12),
    ("DELETE FROM participants WHERE stage = 'withdrawn'", 2),
]


@pytest.mark.parametrize(("harm", "count"), HARMED_BEFORE)
def test_what_schema_4_could_find_is_found_after_the_upgrade_and_after_later_changes(
    harm, count, tmp_path
):
    path, _ = earlier.database(4, tmp_path)
    with closing(sqlite3.connect(path, isolation_level=None)) as conn:
        conn.execute("PRAGMA foreign_keys = OFF")
        conn.execute(harm)
    with closing(open_database(path).conn) as conn:
        found = [finding for finding in verify_database(path).findings if "digest" in finding.what]
        assert len({finding.where for finding in found}) == count
        assert not any("of version 0" in str(finding) for finding in found)
        for kind, ident, _ in chain.things(conn):
            chain.append(conn, kind, ident)
        after = [finding for finding in verify_database(path).findings if "digest" in finding.what]
        assert after == found


def test_the_old_schemas_are_what_the_migrations_make(old):
    path, expected = old
    with (
        closing(sqlite3.connect(path)) as conn,
        closing(sqlite3.connect(":memory:", isolation_level=None)) as fresh,
    ):
        for migration in MIGRATIONS[: expected["user_version"]]:
            migration(fresh)
        schema = (
            "SELECT type, name, sql FROM sqlite_master WHERE sql IS NOT NULL ORDER BY type, name"
        )
        assert conn.execute(schema).fetchall() == fresh.execute(schema).fetchall()


def test_every_episode_of_an_old_database_simulates_to_what_was_recorded(old):
    path, expected = old
    Store(path).close()
    with closing(Reader.open(path)) as reader:
        for ident, totals in expected["finished"].items():
            record = reader.load_record(ident)
            episode = replay(record)
            assert {
                name: getattr(episode, name) for name in ("outcome", "steps", "discovered", "score")
            } == {name: totals[name] for name in ("outcome", "steps", "discovered", "score")}
            assert (record.total, record.trajectory_hash) == (
                totals["total"],
                totals["trajectory_hash"],
            )
    verified = verify_database(path)
    assert (
        [str(finding) for finding in verified.findings]
        == expected["upgraded"]["verify"]["findings"]
        == []
    )
    for name in ("episodes", "moves", "still_open"):
        assert getattr(verified, name) == expected["upgraded"]["verify"][name]


def test_an_episode_that_was_running_in_an_old_database_goes_on(old):
    path, expected = old
    with closing(Store(path)) as store:
        running = [found for found in resumable(store, 0) if not found.ended]
        assert {found.episode.id: len(found.actions) for found in running} == expected["running"]


def test_an_older_schema_is_brought_up_with_everything_in_it(path, monkeypatch):
    monkeypatch.setattr(database, "MIGRATIONS", MIGRATIONS[:1])
    open_database(path, migrations=MIGRATIONS[:1]).close()
    db = sqlite3.connect(path)
    db.execute("INSERT INTO players VALUES ('old', 1)")
    db.commit()
    db.close()
    monkeypatch.undo()
    with closing(Reader.open(path)) as reader:
        assert reader.query("SELECT id FROM players") == [{"id": "old"}]
    with closing(sqlite3.connect(path)) as conn:
        assert conn.execute("PRAGMA user_version").fetchone() == (1,)
    store = Store(path)
    assert store._db.execute("SELECT id FROM players").fetchall() == [("old",)]
    assert store._db.execute("PRAGMA user_version").fetchone() == (len(MIGRATIONS),)
    assert store._db["episodes"].indexes
    store.close()


def test_a_migration_that_fails_leaves_the_schema_before_it(path):
    Store(path).close()

    def broken(conn):
        conn.execute("CREATE TABLE half (a)")
        conn.execute("nonsense")

    with pytest.raises(StoreError, match="cannot open"):
        open_database(path, migrations=(*MIGRATIONS, broken))
    store = Store(path)
    assert store._db.execute(
        "SELECT count(*) FROM sqlite_master WHERE name = 'half'"
    ).fetchone() == (0,)
    store.close()
