"""`forget`: nothing of somebody is left in any byte, and nothing brings them back."""

import io
import json
import shutil
import sqlite3

import pytest

from humanplay.db import backup
from humanplay.db.database import open_read_only
from humanplay.db.erasure import ParticipantLookupError, find_participant, forget
from humanplay.db.file import log_path
from humanplay.db.merging import merge
from humanplay.db.series import StudyStore
from humanplay.db.store import Store, StoreError
from humanplay.db.study_rows import participant_label
from humanplay.release.build import ReleaseRequest, build_release
from humanplay.release.bundle import import_release
from humanplay.release.errors import ReleaseError
from humanplay.release.manifest import MANIFEST
from humanplay.study.verification import verify_database
from tests.support.command import command, run
from tests.support.recorded import alter, ask, play
from tests.support.stored_studies import (
    CONFIG,
    IDENTITIES,
    StudyRecorder,
    freeze,
    play_study,
    write_chain_anew,
)


@pytest.fixture(scope="module")
def origin(tmp_path_factory):
    """A closed study of three, whose first participant also plays for themselves."""
    folder = tmp_path_factory.mktemp("origin")
    study = freeze(folder / "studies")
    people = play_study(folder / "play.db", study)
    recorder = StudyRecorder(folder / "play.db", study)
    (player,) = recorder.conn.execute(
        "SELECT player_id FROM participants WHERE id = ?", [people[0]]
    ).fetchone()
    play(recorder.store, seed=5, player=player, config=CONFIG)
    recorder.close()
    return folder, study, people


@pytest.fixture
def copy(origin, tmp_path):
    for path in origin[0].glob("play.db*"):
        shutil.copy(path, tmp_path / path.name)
    return tmp_path / "play.db", origin[1], origin[2]


def test_a_release_waits_for_whoever_asked_to_be_erased_and_counts_that_they_asked(tmp_path):
    path, study = tmp_path / "play.db", freeze(tmp_path / "play.db-studies")
    play_study(path, study)
    recorder = StudyRecorder(path, study)
    person = recorder.join(7, stage="ranked")
    recorder.play(person, "ranked", 0, "tour")
    study_store = StudyStore(recorder.store)
    study_store.withdraw(study_store.participant(person), recorder.tick(1000), erase=True)
    recorder.close()
    request, label = ReleaseRequest(path, study.name, tmp_path / "out"), participant_label(person)
    with pytest.raises(ReleaseError, match=f"1 participant .* `humanplay forget {label}` first"):
        build_release(request)
    forget(path, label)
    arrivals = build_release(request).header.arrivals
    assert (arrivals.erased, arrivals.erased_asked_by) == (1, {"participant": 1})


def traces_of(path, person):
    """Every id and word by which the database knows a participant."""
    traces = {person}
    (row,) = ask(
        path, "SELECT player_id, session_id, completion_code FROM participants WHERE id = ?", person
    )
    traces |= set(row)
    traces |= {
        row[0] for row in ask(path, "SELECT value FROM identities WHERE participant_id = ?", person)
    }
    boards = ask(path, "SELECT id FROM sessions WHERE player_id = ?", row[0])
    traces |= {board for (board,) in boards}
    for (board,) in boards:
        traces |= {
            ident for (ident,) in ask(path, "SELECT id FROM episodes WHERE session_id = ?", board)
        }
    assert len(traces) > 10
    return traces


def bytes_in_folder(path):
    """Every byte of the database, its log and whatever else lies in its folder."""
    return b"".join(file.read_bytes() for file in path.parent.iterdir() if file.is_file())


def test_nothing_remains_in_any_byte_and_the_others_are_as_they_were(copy):
    path, study, people = copy
    traces = traces_of(path, people[0])
    before = bytes_in_folder(path)
    assert all(trace.encode() in before for trace in traces)
    done = forget(path, IDENTITIES["PROLIFIC_PID"].format(0))
    assert (done.study, done.episodes, done.keeps, done.outdated) == (study.name, 7, False, ())
    after = bytes_in_folder(path)
    for trace in traces:
        assert trace.encode() not in after, trace
    assert ask(path, "SELECT count(*) FROM participants") == [(2,)]
    result = verify_database(path)
    assert (result.findings, result.episodes) == ((), 12)
    assert ask(path, "PRAGMA journal_mode") == [("wal",)]


def test_it_leaves_the_log_empty_of_a_database_that_was_not_closed_well(copy):
    """Rows that are still in the log alone are gone as well."""
    path, _, people = copy
    writer = sqlite3.connect(path)
    writer.execute("PRAGMA wal_autocheckpoint = 0")
    writer.execute(
        "UPDATE participants SET completion_code = 'CODE-in-the-log' WHERE id = ?", [people[0]]
    )
    writer.commit()
    for name in ("play.db", "play.db-wal", "play.db-shm"):
        shutil.copy(path.with_name(name), path.with_name(f"killed{name[4:]}"))
    writer.close()
    killed = path.with_name("killed.db")
    for file in path.parent.glob("play.db*"):
        file.unlink()
    assert b"CODE-in-the-log" in bytes_in_folder(killed)
    forget(killed, people[0])
    assert b"CODE-in-the-log" not in bytes_in_folder(killed)


def test_while_a_server_runs_nothing_of_them_remains_in_file_or_log(copy):
    path, study, people = copy
    recorder = StudyRecorder(path, study)
    traces = traces_of(path, people[0])
    recorder.join(8, stage="ranked")
    assert log_path(path).stat().st_size > 0
    forget(path, people[0])
    after = bytes_in_folder(path)
    assert [trace for trace in traces if trace.encode() in after] == []
    recorder.join(9, stage="ranked")
    recorder.close()
    assert verify_database(path).findings == ()
    assert ask(path, "SELECT count(*) FROM participants") == [(4,)]


def test_a_program_that_still_reads_an_older_moment_is_told_of(copy, monkeypatch):
    path, _, people = copy
    monkeypatch.setattr("humanplay.db.erasure.WITHIN_S", 0.5)
    ident = IDENTITIES["PROLIFIC_PID"].format(0).encode()
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN")
    other.execute("SELECT count(*) FROM episodes").fetchone()
    with pytest.raises(
        StoreError, match=r"erased the rows, but another program still reads .*-wal"
    ):
        forget(path, people[0])
    assert ident in bytes_in_folder(path)
    other.close()
    ask(path, "PRAGMA wal_checkpoint(TRUNCATE)")
    assert ident not in bytes_in_folder(path)
    assert ask(path, "SELECT count(*) FROM participants") == [(2,)]


def test_a_disk_without_room_for_a_copy_erases_nobody(copy, monkeypatch):
    path, _, people = copy
    monkeypatch.setattr(backup, "SPARE_BYTES", 2**60)
    with pytest.raises(StoreError, match="make room there; nothing was erased"):
        forget(path, people[0])
    monkeypatch.undo()
    assert ask(path, "SELECT count(*) FROM participants") == [(3,)]
    forget(path, people[0])


def test_a_disk_that_fills_up_after_the_erasure_leaves_it_done_and_says_what_is_left_to_do(copy):
    """No file may grow beyond the part of the database that the deletion changes."""
    resource = pytest.importorskip("resource")
    path, _, people = copy
    length = path.stat().st_size
    alter(path, "INSERT INTO meta VALUES ('others', hex(zeroblob(1000000)))")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (length, hard))
    try:
        with pytest.raises(StoreError, match=r"erased the rows, but .*VACUUM`"):
            forget(path, people[0])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert ask(path, "SELECT count(*) FROM participants") == [(2,)]
    ask(path, "VACUUM")
    assert verify_database(path).findings == ()
    Store(path).close()


def test_nobody_is_erased_by_a_word_that_many_share(copy):
    path, study, people = copy
    recorder = StudyRecorder(path, study)
    for person in people:
        recorder.insert("identities", person, "STUDY_ID", "the-shared-study-id")
    recorder.close()
    with pytest.raises(ParticipantLookupError, match="stands for 3 participants"):
        forget(path, "the-shared-study-id")
    with pytest.raises(ParticipantLookupError, match="no participant 'nobody'"):
        forget(path, "nobody")
    with pytest.raises(ParticipantLookupError, match="in the study 'other'"):
        forget(path, people[0], "other")
    assert ask(path, "SELECT count(*) FROM participants") == [(3,)]
    for who in (
        people[0],
        participant_label(people[0]),
        participant_label(people[0]).lower(),
        IDENTITIES["SESSION_ID"].format(0),
    ):
        assert find_participant(path, who).id == people[0]


def test_the_next_release_is_a_successor_without_them_and_an_old_one_does_not_bring_them_back(
    copy, tmp_path
):
    path, study, people = copy
    first = build_release(ReleaseRequest(path, study.name, tmp_path / "out1"))
    assert forget(path, people[0]).outdated == (1,)
    second = build_release(ReleaseRequest(path, study.name, tmp_path / "out2"))
    assert second.header.rows["participants"] == 2
    manifest = json.loads((tmp_path / "out2" / MANIFEST).read_text())
    assert manifest["version"] == 2
    assert manifest["supersedes"] == {
        "version": 1,
        "manifest_sha256": first.manifest_hash,
        "reason": "a participant asked to be forgotten",
    }

    def came(database):
        return {row[0] for row in ask(database, "SELECT joined_ms FROM participants")}

    (gone,) = came(tmp_path / "out1/study.sqlite") - came(path)
    _empty(path)
    assert import_release(tmp_path / "out1", path).forgotten == 1
    assert came(path) == came(tmp_path / "out1/study.sqlite") - {gone}
    assert verify_database(path).findings == ()
    _empty(path, "forgotten_people")  # the trajectories alone are enough
    assert import_release(tmp_path / "out1", path).forgotten == 1


def _empty(path, *more):
    """Delete all rows but the list of the forgotten."""
    tables = "chain chain_salts input_events steps series_episodes episodes stage_events identities participants sessions"
    every = [*tables.split(), "players", "series", "releases", *more]
    alter(path, "PRAGMA foreign_keys = OFF", *(f"DELETE FROM {table}" for table in every))


def test_a_merge_with_an_older_copy_does_not_bring_them_back(copy, tmp_path):
    path, _, people = copy
    older = tmp_path / "older" / "older.db"
    older.parent.mkdir()
    shutil.copy(path, older)
    forget(path, people[1])
    for number, sources in enumerate(((path, older), (older, path))):
        joined, _ = merge(sources, tmp_path / f"both{number}.db")
        assert joined.forgotten == 1
        assert {
            row[0] for row in ask(tmp_path / f"both{number}.db", "SELECT id FROM participants")
        } == {people[0], people[2]}
        assert people[1].encode() not in (tmp_path / f"both{number}.db").read_bytes()
        assert verify_database(tmp_path / f"both{number}.db").findings == ()


def test_where_the_protocol_keeps_episodes_they_stay_without_a_person(tmp_path):
    study = freeze(tmp_path / "studies", keep_episodes_when_forgotten=True)
    path = tmp_path / "play.db"
    people = play_study(path, study)
    (player, session, code) = ask(
        path,
        "SELECT player_id, session_id, completion_code FROM participants WHERE id = ?",
        people[0],
    )[0]
    done = forget(path, people[0])
    assert (done.keeps, done.episodes, done.outdated) == (True, 0, ())
    after = path.read_bytes()
    for trace in (people[0], player, session, code, IDENTITIES["PROLIFIC_PID"].format(0)):
        assert trace.encode() not in after, trace
    result = verify_database(path)
    assert (result.findings, result.episodes) == ((), 18)
    assert ask(path, "SELECT count(*) FROM participants") == [(3,)]
    assert ask(path, "SELECT count(*) FROM forgotten") == [(0,)]


def test_a_kept_episode_meets_its_older_copy_in_a_merge_without_its_person(tmp_path):
    study = freeze(tmp_path / "studies", keep_episodes_when_forgotten=True)
    path = tmp_path / "play.db"
    people = play_study(path, study, ("human",))
    shutil.copy(path, tmp_path / "older.db")
    forget(path, people[0])
    for number, sources in enumerate(
        ((path, tmp_path / "older.db"), (tmp_path / "older.db", path))
    ):
        out = tmp_path / f"both{number}.db"
        joined, _ = merge(sources, out)
        assert (joined.added["episodes"], joined.forgotten) == (6, 1)
        assert people[0].encode() not in out.read_bytes()
        assert verify_database(out).findings == ()


def test_somebody_in_two_studies_is_erased_from_one(tmp_path):
    path = tmp_path / "play.db"
    first, second = freeze(tmp_path / "studies", "first"), freeze(tmp_path / "studies", "second")
    recorder = StudyRecorder(path, first)
    person = recorder.join(0, stage="ranked")
    recorder.play(person, "ranked", 0)
    recorder.close()
    recorder = StudyRecorder(path, second)
    other = recorder.join(0, stage="ranked")
    recorder.play(other, "ranked", 0)
    (player,) = recorder.conn.execute(
        "SELECT player_id FROM participants WHERE id = ?", [person]
    ).fetchone()
    recorder.conn.execute("UPDATE participants SET player_id = ? WHERE id = ?", (player, other))
    recorder.conn.execute("UPDATE sessions SET player_id = ?1, owner_id = ?1", [player])
    write_chain_anew(recorder.conn)
    recorder.close()
    with pytest.raises(ParticipantLookupError, match="studies: first, second"):
        forget(path, IDENTITIES["PROLIFIC_PID"].format(0))
    assert forget(path, IDENTITIES["PROLIFIC_PID"].format(0), "first").episodes == 1
    assert ask(path, "SELECT study FROM participants") == [("second",)]
    assert ask(path, "SELECT count(*) FROM identities") == [(2,)]
    assert (verify_database(path).findings, verify_database(path).episodes) == ((), 1)


def test_the_command_asks_and_tells(copy, capsys, monkeypatch):
    path, _, people = copy
    monkeypatch.setattr("sys.stdin", io.StringIO())
    arguments = "forget", people[0], "--database", path
    assert run(*arguments) == 130
    assert ask(path, "SELECT count(*) FROM participants") == [(3,)]
    code, output, _ = command(capsys, *arguments, "--yes")
    assert (code, "erased from" in output) == (0, True)
    open_read_only(path).close()
