"""The store on real files: what it keeps, refuses and finds again."""

import os
import shutil
import sqlite3
import tempfile
import warnings
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from humanplay.db import database
from humanplay.db.columns import TABLES
from humanplay.db.database import APPLICATION_ID, StoreError
from humanplay.db.reader import Reader
from humanplay.db.store import Closing, StepRow, Store
from marsexplorer.episode import Episode
from tests.support.recorded import (
    NOW,
    SMALL,
    add_session,
    add_steps,
    alter,
    free_moves,
    open_episode,
    play,
    resumable,
    tour,
)

STEP = StepRow(
    episode_id="", step=0, action=1, reward=0.5, discovered=9, server_ms=NOW,
    client_ms=None, key_down_ms=None, key_up_ms=None, input="key", driver="human",
)  # fmt: skip


@pytest.fixture
def path(tmp_path):
    return tmp_path / "play.db"


def listing(folder):
    return {entry.name: entry.read_bytes() for entry in folder.iterdir()}


def test_a_step_is_taken_once_and_in_order_and_never_after_the_end(store):
    row, episode = open_episode(store, add_session(store), seed=1)
    add_steps(store, row, episode, free_moves(episode)[:2])
    step = replace(STEP, episode_id=row.id, step=1)
    for wrong in (
        step,
        replace(step, step=3),
        replace(step, step=2, episode_id="nowhere"),
        replace(step, step=-1),
    ):
        with pytest.raises(StoreError, match="nothing changed"):
            store.add_step(wrong)
    episode.abandon()
    store.next_episode([Closing(row.id, episode.record(), NOW)], ())
    with pytest.raises(StoreError, match="nothing changed"):
        store.add_step(replace(step, step=2))
    assert len(store.steps(row.id)) == 2


def test_a_record_that_does_not_fit_the_steps_closes_nothing_and_takes_its_step_back(store):
    row, episode = open_episode(store, add_session(store), seed=1)
    episode.step(free_moves(episode)[0])
    record = replace(episode.record(), outcome="explored", steps=5)
    with pytest.raises(StoreError, match="not open with 5 steps"):
        store.add_step(replace(STEP, episode_id=row.id), record)
    assert store.steps(row.id) == []
    assert not resumable(store, NOW)[0].ended


def test_closing_and_opening_the_next_episodes_is_all_or_nothing(store):
    session = add_session(store)
    row, episode = open_episode(store, session, seed=1)
    episode.abandon()
    closing = Closing(row.id, episode.record(), NOW)
    following = replace(row, id="next", number=1)
    with pytest.raises(StoreError, match="nothing changed"):
        store.next_episode([closing], [following, replace(following, id="other")])
    assert not store.resume_session(session, NOW).ended
    store.next_episode([closing], [following])
    assert store.resume_session(session, NOW).episode.id == "next"
    assert store.episode(row.id)["outcome"] == "abandoned"


def test_an_episode_without_a_move_does_not_count(store):
    row, episode = open_episode(store, add_session(store), seed=1)
    episode.abandon()
    store.next_episode([Closing(row.id, episode.record(), NOW)], ())
    assert store.episode(row.id)["counts"] is False


def test_a_terrain_met_before_does_not_count_whoever_drove_then(store):
    assert store.episode(play(store, seed=1).id)["counts"]
    again = store.episode(play(store, seed=1).id)
    assert (again["terrain_met_before"], again["counts"]) == (True, False)
    assert store.episode(play(store, seed=1, player="bob").id)["counts"]
    rival = add_session(store, None, "random", rival_of=add_session(store, "cid"))
    open_episode(store, rival, seed=1, driver="policy:random")
    assert store.episode(play(store, seed=1, player="cid").id)["terrain_met_before"]


def test_the_same_bits_in_another_shape_are_another_terrain(store):
    first = play(store, seed=1)
    other = replace(first.config, rows=7, cols=5)
    row = replace(first, id="turned", session_id=add_session(store), config=other)
    store.next_episode((), [row])
    assert store._db.execute(
        "SELECT terrain_met_before FROM episodes WHERE id = 'turned'"
    ).fetchone() == (0,)


def test_a_player_and_a_rival_opened_together_do_not_meet_each_others_terrain(store):
    mine = add_session(store)
    row, _ = open_episode(store, mine, seed=1, assisted=True)
    rival = add_session(store, None, "random", rival_of=mine)
    rows = [
        replace(row, id="b", session_id=rival, seed=2, terrain=b"other"),
        replace(row, id="a", number=1, terrain=b"other"),
    ]
    store.next_episode([], rows)
    assert store._db.execute(
        "SELECT terrain_met_before FROM episodes WHERE id IN ('a', 'b')"
    ).fetchall() == [(0,), (0,)]


def test_a_rival_that_ended_first_does_not_tell_the_terrain_its_player_is_on(store):
    mine = add_session(store)
    row, episode = open_episode(store, mine, seed=1, assisted=True)
    rival = add_session(store, None, "frontier-cost", rival_of=mine)
    its_row, its_episode = open_episode(store, rival, seed=1, driver="policy:frontier-cost")
    add_steps(store, its_row, its_episode, tour(its_episode), "policy:frontier-cost")
    assert store.episodes() == []
    assert store.episode(its_row.id) is None
    episode.abandon()
    store.next_episode([Closing(row.id, episode.record(), NOW)], ())
    assert {listed["episode"] for listed in store.episodes()} == {row.id, its_row.id}


def test_lists_hold_seed_actions_and_times_and_no_ids_of_players_or_sessions(store):
    rows = [play(store, seed=seed, player="secret-player") for seed in (1, 2, 3)]
    listed = store.episodes(limit=2)
    assert len(listed) == 2
    one = store.episode(rows[0].id)
    assert one["seed"] == 1
    assert [move["action"] for move in one["moves"]] == one["actions"]
    assert one["moves"][0] | {"reward": 0} == {
        "step": 0, "action": one["actions"][0], "reward": 0, "discovered": one["moves"][0]["discovered"],
        "server_ms": rows[0].started_ms + 100, "client_ms": 100.5, "key_down_ms": 100.0, "key_up_ms": 180.5,
        "input": "key", "driver": "human",
    }  # fmt: skip
    text = repr((listed, one))
    assert "secret-player" not in text
    assert rows[0].session_id not in text


def test_pages_after_an_episode_are_the_whole_list_whatever_ends_meanwhile(store):
    for seed in range(7):  # some end in the same millisecond
        play(store, seed, started_ms=NOW + seed // 3)
    whole = [row["episode"] for row in store.episodes()]
    pages, last = [], None
    while page := store.episodes(limit=2, after=last):
        last = page[-1]["episode"]
        pages += [row["episode"] for row in page]
        play(store, 100 + len(pages), started_ms=NOW + 1000)
    assert pages == whole
    with pytest.raises(LookupError, match="no finished episode 'nobody' to go on after"):
        store.episodes(after="nobody")


def test_a_missing_folder_is_refused_and_not_made(tmp_path):
    with pytest.raises(StoreError, match=r"no folder .*b for the database play.db: make it"):
        Store(tmp_path / "a" / "b" / "play.db")
    assert list(tmp_path.iterdir()) == []


def test_tables_are_strict_in_wal_mode_and_marked_as_ours(store, path):
    sql = dict(
        store._db.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'").fetchall()
    )
    assert all("STRICT" in text for text in sql.values())
    pragma = {
        name: store._db.execute(f"PRAGMA {name}").fetchone()[0]
        for name in ("journal_mode", "synchronous", "foreign_keys")
    }
    assert pragma == {"journal_mode": "wal", "synchronous": 1, "foreign_keys": 1}
    assert int.from_bytes(path.read_bytes()[68:72], "big") == APPLICATION_ID


def test_durable_syncs_every_commit(path):
    store = Store(path, durable=True)
    assert store._db.execute("PRAGMA synchronous").fetchone() == (2,)
    store.close()


def test_reading_goes_on_while_a_server_runs(store, path):
    play(store, seed=1)
    reader = Reader.open(path)
    assert reader.count() == 1
    play(store, seed=2)
    assert reader.count() == 2
    with pytest.raises(sqlite3.OperationalError, match="readonly"):
        reader._db.execute("DELETE FROM steps")
    reader.close()


def foreign(path):
    alter(path, "PRAGMA journal_mode = WAL", "CREATE TABLE theirs (a)")


@pytest.mark.parametrize(
    "make",
    [
        foreign,
        lambda path: path.write_text("dear diary\n" * 50),
        lambda path: path.write_bytes(b"x"),
    ],
)
@pytest.mark.parametrize("opening", [Store, Reader.open])
def test_a_file_that_is_not_ours_is_refused_and_left_as_it_is(tmp_path, path, make, opening):
    make(path)
    before = listing(tmp_path)
    with pytest.raises(StoreError, match=r"nothing was written; give another --database"):
        opening(path)
    assert listing(tmp_path) == before


def test_a_folder_in_place_of_a_file_is_refused(tmp_path):
    with pytest.raises(StoreError, match="is a folder"):
        Store(tmp_path)


@pytest.mark.parametrize("number", [2, 8])
def test_another_schema_is_refused_and_left_as_it_is(path, number):
    Store(path).close()
    alter(path, f"PRAGMA user_version = {number}")
    before = path.read_bytes()
    for opening in (Store, Reader.open):
        with pytest.raises(
            StoreError, match=f"must have schema 1, got schema {number}: open it with"
        ):
            opening(path)
    assert path.read_bytes() == before


def test_tables_that_cannot_all_be_made_are_not_made_at_all(path, monkeypatch):
    with monkeypatch.context() as patch:
        half = replace(TABLES["forgotten"], name="half", indexes=["nonsense"])
        patch.setattr(database, "TABLES", {"half": half})
        with pytest.raises(StoreError, match="cannot open"):
            Store(path)
    with closing(Store(path)) as store:
        assert not store.query("SELECT name FROM sqlite_master WHERE name = 'half'")


@pytest.mark.parametrize("keep", [20, 90, 600, 4096, 9000])
def test_a_truncated_database_is_refused(tmp_path, path, keep):
    store = Store(path)
    play(store, seed=1)
    store.close()
    path.write_bytes(path.read_bytes()[:keep])
    for opening in (Store, Reader.open):
        with pytest.raises(StoreError, match=r"damaged|not a database|another program"):
            opening(path)
    assert path.stat().st_size == keep


def test_a_database_killed_before_its_first_checkpoint_is_still_ours(tmp_path, path):
    store = Store(path)
    play(store, seed=1)
    copy = tmp_path / "copy"
    copy.mkdir()
    for suffix in ("", "-wal", "-lock"):
        shutil.copy(f"{path}{suffix}", copy / f"play.db{suffix}")
    store.close()
    again = Store(copy / "play.db")
    assert again.count() == 1
    again.close()


def as_nobody(action):
    """Return what `action()` prints without rights, in a child: root may write all."""
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # forking beside threads: the child uses none of their locks
        child = os.fork()
    if child == 0:
        try:
            if os.geteuid() == 0:
                os.setgroups([])
                os.setgid(65534)
                os.setuid(65534)
            printed = "\n".join(str(line) for line in action())
        except BaseException as error:
            printed = f"failed: {error!r}"
        os.write(writing, printed.encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as file:
        printed = file.read()
    os.waitpid(child, 0)
    return printed.splitlines()


@pytest.fixture
def open_folder():
    """A folder every user can look into."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


def test_a_read_only_database_is_refused_for_writing_and_open_for_reading(open_folder):
    path = open_folder / "play.db"
    store = Store(path)
    play(store, seed=1)
    store.close()
    path.chmod(0o444)
    before = path.read_bytes()

    def read_and_write():
        reader = Reader.open(path)
        yield reader.count()
        reader.close()
        for target in (path, open_folder / "new.db"):
            try:
                Store(target)
            except StoreError as error:
                yield error

    one, two, three = as_nobody(read_and_write)
    assert one == "1"
    assert two == f"the database {path} is read-only: make it writable or give another --database"
    assert three.startswith(
        f"cannot write the database {open_folder / 'new.db'}: Permission denied"
    )
    assert path.read_bytes() == before


def test_random_episodes_come_back_as_they_were(store):
    for seed in range(20):
        row = play(
            store, seed=seed, explore=seed % 2 == 0, config=replace(SMALL, rows=5 + seed % 3)
        )
        twin = Episode.begin(row.config, seed=seed)
        record = store.load_record(row.id)
        for action in record.actions:
            twin.step(action)
        if record.outcome == "abandoned":
            twin.abandon()
        assert twin.record() == record
