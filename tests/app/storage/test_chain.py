"""The chain: what appends an entry, what an entry tells, what a step costs."""

import hashlib
import json
import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace

import pytest

from humanplay.db import chain
from humanplay.db.chain import Thing
from humanplay.db.erasure import forget
from humanplay.db.input_events import InputEventRow, add_input_events
from humanplay.db.merging import merge
from humanplay.db.series import StudyStore
from humanplay.db.store import Closing, Store
from humanplay.release.build import ReleaseRequest, build_release
from humanplay.release.manifest import MANIFEST
from humanplay.study.verification import verify_database
from tests.support.command import command
from tests.support.page_loads import STORED_LOAD
from tests.support.recorded import (
    add_session,
    add_steps,
    alter,
    ask,
    free_moves,
    open_episode,
    play,
)
from tests.support.stored_studies import StudyRecorder, freeze, play_study


@pytest.fixture(scope="module")
def origin(tmp_path_factory):
    folder = tmp_path_factory.mktemp("origin")
    study = freeze(folder / "play.db-studies")
    return folder / "play.db", play_study(folder / "play.db", study)


@pytest.fixture
def copy(origin, tmp_path):
    """A copy of a closed study's database, and its participants."""
    return shutil.copy(origin[0], tmp_path / "play.db"), origin[1]


def kinds(store):
    return [kind for (kind,) in store.connection.execute("SELECT kind FROM chain ORDER BY number")]


def test_a_session_enters_with_its_first_move_and_an_episode_when_it_ends(store):
    session = add_session(store)
    row, episode = open_episode(store, session, seed=1)
    assert kinds(store) == []
    add_steps(store, row, episode, free_moves(episode)[:4])
    assert kinds(store) == ["session"]
    episode.abandon()
    store.next_episode([Closing(row.id, episode.record(), row.started_ms + 1000, "attested")], ())
    again, second = open_episode(store, session, seed=2, number=1)
    add_steps(store, again, second, free_moves(second)[:1])
    assert kinds(store) == ["session", "episode"]
    assert verify_database(store.path).findings == ()


@pytest.mark.parametrize(
    ("code", "ms"),
    [
        ("KeyW", 0.1),
        ("],[", 0.1),
        (']\n["', 0.1),
        ('"\\/\x7f', 0.1),
        ("é\u2028", 0.1),
        ("KeyW", 1e-5),
        ("KeyW", 1.5e-7),
        ("KeyW", 1e16),
        ("KeyW", 1.7e22),
    ],
)
@pytest.mark.parametrize("before", [0, 1, 4])
def test_a_hash_that_was_begun_before_the_end_makes_the_entry_that_one_made_at_the_end_makes(
    store, before, code, ms
):
    """Of four events some are hashed before the end, the others come later."""
    row, episode = open_episode(store, add_session(store), seed=1)
    events = [
        InputEventRow("keydown", code, False, True, ms * number, 0, 2.5) for number in range(4)
    ]
    add_input_events(store, row.id, events[:before], 5, "first-batch", STORED_LOAD)
    begun = chain.begin_hash(store.connection, row.id)
    add_input_events(store, row.id, events[before:], 5, "second-batch", STORED_LOAD)
    episode.abandon()
    store.next_episode([Closing(row.id, episode.record(), 6, "attested", events=begun)], ())
    sql = "SELECT salt, parts, hash FROM chain_salts JOIN chain USING (number) WHERE chain_salts.kind = 'episode'"
    salt, parts, whole = store.connection.execute(sql).fetchone()
    table = json.loads(parts)["input_events"]
    columns = (
        "episode_id, number, tab, page_load, kind, code, repeat, trusted, client_ms, step, round_trip_ms, "
        "server_ms"
    )
    lines = [["input_events", columns]]
    lines += [
        [row.id, number, 0, 0, "keydown", code, 0, 1, ms * number, 0, 2.5, 5] for number in range(4)
    ]
    hashed = "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines)
    assert table == hashlib.sha256(salt + hashed.encode()).hexdigest()
    digests = chain.compute(store.connection, Thing("episode", row.id), salt)
    assert (digests, chain.combine(digests)) == (json.loads(parts), whole)
    assert verify_database(store.path).findings == ()


def test_input_events_that_come_late_are_an_entry_of_their_own_and_change_none(store):
    row, episode = open_episode(store, add_session(store), seed=1)
    events = [
        InputEventRow("keydown", "KeyW", False, True, float(number), 0, 2.5) for number in range(6)
    ]
    add_input_events(store, row.id, events[:2], 5, "batch-0", STORED_LOAD)
    assert kinds(store) == []
    add_steps(store, row, episode, free_moves(episode)[:1])
    episode.abandon()
    store.next_episode([Closing(row.id, episode.record(), row.started_ms + 1000, "attested")], ())
    before = store.connection.execute("SELECT * FROM chain").fetchall()
    for batch, name in (
        (events[2:5], "batch-1"),
        (events[2:5], "batch-1"),
        (events[5:], "batch-2"),
    ):
        add_input_events(store, row.id, batch, 7, name, STORED_LOAD)
    assert kinds(store) == ["session", "episode", "events", "events"]
    assert store.connection.execute("SELECT * FROM chain").fetchall()[:2] == before
    assert store.connection.execute(
        "SELECT first FROM chain_salts WHERE kind = 'events'"
    ).fetchall() == [(3,), (6,)]
    assert verify_database(store.path).findings == ()
    for number in range(7):
        store.connection.execute(
            "UPDATE input_events SET client_ms = client_ms + 0.5 WHERE number = ?", [number]
        )
        (finding,) = verify_database(store.path).findings
        assert (finding.where, finding.what) == (
            f"episode {row.id}",
            "digest of its stored fields in the table input_events",
        )
        store.connection.execute(
            "UPDATE input_events SET client_ms = client_ms - 0.5 WHERE number = ?", [number]
        )


def test_a_participants_change_replaces_their_entry_and_hides_no_change_made_before_it(tmp_path):
    recorder = StudyRecorder(tmp_path / "play.db", freeze(tmp_path / "play.db-studies"))
    person = recorder.join(0, stage="ranked")
    study_store = StudyStore(recorder.store)
    study_store.add_stage_event(person, 5, "break", {})
    (entry,) = recorder.conn.execute(
        "SELECT kind, replaces IS NOT NULL FROM chain ORDER BY number DESC LIMIT 1"
    ).fetchall()
    assert entry == ("participant", 1)
    assert verify_database(recorder.path).findings == ()
    recorder.conn.execute(
        "UPDATE stage_events SET at_ms = 1 WHERE participant_id = ? AND number = 0", [person]
    )
    study_store.add_stage_event(person, 6, "break", {})
    study_store.set_stage(person, 7, "withdrawn")
    recorder.close()
    (finding,) = verify_database(recorder.path).findings
    assert (finding.where, finding.what) == (f"participant {person}", "digest of its stored fields")


def test_a_step_or_a_change_that_fails_leaves_no_entry(store, monkeypatch):
    row, episode = open_episode(store, add_session(store), seed=1)

    def fail(*_):
        raise OSError("full")

    episode.abandon()
    with monkeypatch.context() as patch:
        patch.setattr(store, "_close", fail)
        with pytest.raises(OSError, match="full"):
            store.add_step(replace(a_step(row), driver="script"), episode.record())
    assert kinds(store) == []
    store.add_step(a_step(row))
    assert kinds(store) == ["session"]


def a_step(row):
    from humanplay.db.store import StepRow

    return StepRow(row.id, 0, 1, 0.0, 1, 5, None, None, None, "key", "human")


def test_the_same_rows_have_another_hash_each_time(copy):
    path, people = copy
    conn = sqlite3.connect(path, isolation_level=None)
    for _ in range(2):
        chain.append(conn, "participant", people[0])
    hashes = conn.execute("SELECT hash FROM chain ORDER BY number DESC LIMIT 2").fetchall()
    assert len(set(hashes)) == 2
    assert conn.execute(
        "SELECT count(*) FROM chain_salts WHERE id = ?", [people[0]]
    ).fetchone() == (1,)
    conn.close()


def test_a_head_is_sha256_over_the_head_before_and_the_entry(copy):
    """By the definition in docs/release.md, without this package."""
    before = ""
    for *entry, head in ask(copy[0], "SELECT * FROM chain ORDER BY number"):
        line = json.dumps([before, *entry], separators=(",", ":")) + "\n"
        assert head == hashlib.sha256(line.encode()).hexdigest()
        before = head
    assert before == verify_database(copy[0]).chain.head


def test_nothing_in_the_chain_says_who_or_when_but_for_the_day(copy):
    for table in ("players", "sessions", "participants", "episodes"):
        ids = {ident for (ident,) in ask(copy[0], f"SELECT id FROM {table}")}
        assert not any(
            ident in repr(row) for row in ask(copy[0], "SELECT * FROM chain") for ident in ids
        )
    assert all(day_ms % 86_400_000 == 0 for (day_ms,) in ask(copy[0], "SELECT day_ms FROM chain"))


def test_no_hash_of_a_forgotten_person_can_be_made_again(copy):
    """Even with all of the person's rows, none of their hashes is found in the chain."""
    path, people = copy
    copied = path.with_name("known.db")
    shutil.copy(path, copied)
    theirs = "id = ?1 OR id IN (SELECT session_id FROM participants WHERE id = ?1) OR id IN (SELECT e.id FROM episodes e " \
        "JOIN participants p ON p.session_id = e.session_id WHERE p.id = ?1)"  # fmt: skip
    lost = ask(
        copied,
        f"SELECT number, kind, id, first, salt, parts FROM chain_salts WHERE {theirs}",
        people[0],
    )
    assert len(lost) > 7
    forget(path, people[0])
    left = path.read_bytes()
    hashes = {hash_ for (hash_,) in ask(path, "SELECT hash FROM chain")}
    salts = [salt for (salt,) in ask(path, "SELECT salt FROM chain_salts")]
    conn = sqlite3.connect(copied)
    for _, kind, ident, first, salt, parts in lost:
        thing = Thing(kind, ident, first)
        assert chain.combine(chain.compute(conn, thing, salt)) in hashes, (
            "with the salt it could be made"
        )
        assert (
            not {
                chain.combine(chain.compute(conn, thing, other_salt))
                for other_salt in (*salts, b"")
            }
            & hashes
        )
        assert salt not in left
        assert not any(part.encode() in left for part in json.loads(parts).values())
    conn.close()
    (forgotten,), (erased,) = ask(path, "SELECT note FROM chain ORDER BY number DESC LIMIT 2")[::-1]
    assert json.loads(forgotten) == {"forgotten": sorted(number for number, *_ in lost)}
    noted = {"study", "stage", "after_closing", "ranked_ended", "asked_by", "row"}
    assert json.loads(erased).keys() == noted
    result = verify_database(path)
    assert (result.findings, result.chain.forgotten) == ((), len(lost))


def test_an_entry_that_calls_others_forgotten_cannot_take_two_or_later_ones(copy):
    path, _ = copy
    conn = sqlite3.connect(path, isolation_level=None)
    (live,) = conn.execute("SELECT max(number) FROM chain_salts").fetchone()
    chain.append_note(conn, "forgotten", {"forgotten": [live, live, 10_000]})
    notes = [finding.stored for finding in verify_database(path).findings if finding.what == "it"]
    assert notes == [
        f"entry {live} forgotten, which is not in force",
        "entry 10000 forgotten, which is not in force",
    ]
    conn.close()


def test_kept_episodes_that_were_changed_are_found_after_their_person_is_forgotten(tmp_path):
    study = freeze(tmp_path / "play.db-studies", keep_episodes_when_forgotten=True)
    path = tmp_path / "play.db"
    person, *_ = play_study(path, study)
    conn = sqlite3.connect(path, isolation_level=None)
    (ident,) = conn.execute(
        "SELECT min(episode_id) FROM series_episodes WHERE participant_id = ?", [person]
    ).fetchone()
    conn.execute("UPDATE steps SET key_up_ms = 1 WHERE episode_id = ?", [ident])
    conn.execute("UPDATE participants SET completed_ms = 1 WHERE id = ?", [person])
    conn.close()
    forget(path, person)
    places = {finding.where for finding in verify_database(path).findings}
    (now,) = ask(path, "SELECT participant_id FROM series_episodes WHERE episode_id = ?", ident)
    assert places == {f"episode {ident}", f"participant {now[0]}"}


@pytest.mark.parametrize(
    ("harm", "kind"),
    [
        (
            "UPDATE input_events SET code = 'KeyQ' WHERE episode_id = (SELECT min(id) FROM episodes)",
            "episode",
        ),
        (
            "UPDATE identities SET value = 'other' WHERE participant_id = (SELECT min(id) FROM participants)",
            "participant",
        ),
        (
            "UPDATE sessions SET control = 'cookie' WHERE id = (SELECT min(id) FROM sessions)",
            "session",
        ),
        ("UPDATE series SET frozen_ms = 5", "series"),
        ("DELETE FROM chain_salts WHERE id = (SELECT min(id) FROM episodes)", "episode"),
    ],
)
def test_a_merge_makes_nothing_sound_that_was_changed_before(copy, tmp_path, harm, kind):
    path, _ = copy
    conn = sqlite3.connect(path, isolation_level=None)
    assert conn.execute(harm).rowcount > 0
    other = Store(tmp_path / "other.db")
    play(other, seed=4)
    other.close()
    conn.close()
    both = tmp_path / "both.db"
    merge([path, tmp_path / "other.db"], both)
    findings = verify_database(both).findings
    assert {finding.where.split()[0] for finding in findings} == {kind}
    with closing(sqlite3.connect(both, isolation_level=None)) as conn:
        for thing in chain.things(conn):
            chain.append(conn, thing.kind, thing.id)
    assert verify_database(both).findings == findings, "nor does a later change"


def test_a_merge_begins_a_chain_that_holds_the_heads_of_its_sources(copy, tmp_path):
    path, _ = copy
    other = Store(tmp_path / "other.db")
    play(other, seed=4)
    other.close()
    merge([path, tmp_path / "other.db"], tmp_path / "both.db")
    notes = [
        json.loads(note)["merged"]
        for (note,) in ask(tmp_path / "both.db", "SELECT note FROM chain WHERE kind = 'merged'")
    ]
    heads = [verify_database(source).chain for source in (path, tmp_path / "other.db")]
    assert notes == [{"head": head.head, "entries": head.entries} for head in heads]
    assert verify_database(tmp_path / "both.db").findings == ()


def run(capsys, *args):
    code, out, err = command(capsys, *args)
    return code, out + err


def test_verify_prints_the_head_and_where_an_earlier_one_stood(copy, tmp_path, capsys):
    path, people = copy
    arguments = ("verify", "--database", path)
    code, output = run(capsys, *arguments)
    head = verify_database(path).chain
    assert code == 0
    assert f"chain: {head.entries:,} entries; head {head.head}\n" in output
    build_release(ReleaseRequest(path, "dunes", tmp_path / "out"))
    manifest = json.loads((tmp_path / "out" / MANIFEST).read_text())
    assert (manifest["chain_head"], manifest["chain_entries"]) == (head.head, head.entries)
    forget(path, people[0])
    for earlier in (head.head, head.head.upper(), tmp_path / "out"):
        code, output = run(capsys, *arguments, "--head", earlier)
        assert (
            code,
            "since then: 1 of kind erased, 1 of kind forgotten, 1 of kind released" in output,
            "1 of kind participant" in output,
        ) == (0, True, True)
    code, output = run(capsys, *arguments, "--head", "0" * 64)
    assert (code, output.startswith("chain: the head given is 000")) == (1, True)


@pytest.mark.parametrize(
    ("args", "sentence"),
    [
        (("--database", "a.db", "--head", "12"), "--head is the 64 hexadecimal digits"),
        (("--dataset", "a", "--head", "0" * 64), "--head goes with --database"),
    ],
)
def test_a_head_that_is_none_is_refused_in_a_sentence(capsys, args, sentence):
    code, printed = run(capsys, "verify", *args)
    assert code == 2
    assert sentence in printed


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        ("DELETE FROM meta WHERE name LIKE 'erased|%'", "what the chain says was erased"),
        ("UPDATE meta SET value = json_set(value, '$.stage', 'ranked') WHERE name LIKE 'erased|%'",
         "what the chain says was erased"),
        ("DELETE FROM releases", "what the chain says was released"),
        ("UPDATE releases SET manifest_hash = 'ab'", "what the chain says was released"),
        ("DELETE FROM chain WHERE kind = 'released'", "an entry of the chain that it was released"),
    ],
)  # fmt: skip
def test_an_erasure_or_a_release_that_is_taken_back_is_found(copy, tmp_path, harm, message):
    path, people = copy
    build_release(ReleaseRequest(path, "dunes", tmp_path / "out"))
    marks = "SELECT kind FROM chain WHERE kind IN ('frozen', 'closed', 'erased', 'released') ORDER BY number"
    assert [kind for (kind,) in ask(path, marks)] == ["frozen", "closed", "released"]
    forget(path, people[0])
    assert [kind for (kind,) in ask(path, marks)] == ["frozen", "closed", "released", "erased"]
    assert verify_database(path).findings == ()
    assert alter(path, harm) == 1
    assert message in {finding.what for finding in verify_database(path).findings}


def test_a_merge_takes_over_every_freezing_that_its_sources_know(copy, tmp_path):
    path, _ = copy
    with closing(sqlite3.connect(path, isolation_level=None)) as conn:
        tried = {
            "study": "dunes",
            "commitment": "c0",
            "protocol_hash": "",
            "frozen_ms": 1,
        }
        chain.append_note(conn, "frozen", tried)
    merge([path], tmp_path / "merged.db")
    assert len(ask(tmp_path / "merged.db", "SELECT 1 FROM chain WHERE kind = 'frozen'")) == 2
    assert verify_database(tmp_path / "merged.db").findings == ()
