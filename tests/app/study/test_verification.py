"""`verify`: what is as it was passes; whatever was changed is found and named."""

import shutil
import sqlite3

import pytest

from app.cli.main import main
from app.study import verification
from app.study.verification import verify_database
from tests.support.stored_studies import StudyRecorder, freeze, play_study, write_chain_anew


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A closed study's database, and its participants."""
    folder = tmp_path_factory.mktemp("played")
    study = freeze(folder / "studies")
    return folder / "play.db", study, play_study(folder / "play.db", study)


@pytest.fixture
def copy(played, tmp_path):
    """A copy of the database that may be harmed, open for it."""
    shutil.copy(played[0], tmp_path / "copy.db")
    conn = sqlite3.connect(tmp_path / "copy.db", isolation_level=None)
    conn.execute("PRAGMA ignore_check_constraints = ON")
    yield conn, tmp_path / "copy.db"
    conn.close()


def test_a_study_as_it_was_played_passes(played):
    result = verify_database(played[0])
    assert result.findings == ()
    assert result.episodes == 3 * (1 + 2 + 3)
    assert result.moves > 100
    assert result.still_open == 0


def changed(value):
    """Return a value of the same storage class that differs."""
    if value is None:
        return 1
    if isinstance(value, bytes):
        return bytes([value[0] ^ 1]) + value[1:]
    if isinstance(value, str):
        return value[:-1] + ("0" if value[-1] != "0" else "1")
    return value + 1_000_003


def columns():
    conn = sqlite3.connect(":memory:", isolation_level=None)
    from app.storage.migrations import MIGRATIONS

    for migration in MIGRATIONS:
        migration(conn)
    tables = ("episodes", "steps", "study_episodes", "input_events", "participants", "stage_events")
    found = [(table, row[1], row[2]) for table in tables for row in conn.execute(f"PRAGMA table_info({table})")]
    conn.close()
    return found


@pytest.mark.parametrize(("table", "column", "kind"), columns(), ids=lambda value: str(value))
def test_a_change_to_any_stored_field_is_found(copy, table, column, kind):
    conn, path = copy
    where = "" if table in ("participants", "stage_events") else " AND x.phase = 'ranked' AND x.trial = 1"
    person = "id = x.participant_id"
    own = {"episodes": "id = x.episode_id", "participants": person, "stage_events": f"participant_{person}"}
    key = f"t.{own.get(table, 'episode_id = x.episode_id')}"
    names = [row[1] for row in conn.execute(f"PRAGMA table_info({table})")]
    row = conn.execute(f"SELECT t.* FROM {table} t JOIN study_episodes x ON {key} WHERE 1{where} LIMIT 1").fetchone()
    old = dict(zip(names, row, strict=True))
    match = " AND ".join(f"{name} IS ?" for name in names)
    new = "x" if old[column] is None and kind == "TEXT" else changed(old[column])
    count = conn.execute(f"UPDATE {table} SET {column} = ? WHERE {match}", (new, *row)).rowcount
    assert count == 1
    result = verify_database(path)
    assert result.findings, f"{table}.{column} was {old[column]!r}, became {new!r}"
    assert result.failed >= 1


@pytest.mark.parametrize(
    "harm",
    [
        "DELETE FROM input_events WHERE number = 1000",
        "DELETE FROM input_events",
        "DELETE FROM steps WHERE step = (SELECT max(step) FROM steps)",
        "DELETE FROM stage_events WHERE number = 2",
        "DELETE FROM study_episodes WHERE phase = 'tutorial'",
        "DELETE FROM chain_salts WHERE kind = 'episode'",
        "DELETE FROM episodes WHERE outcome = 'out_of_bounds'",
        "INSERT INTO input_events SELECT episode_id, 5000, kind, code, repeat, trusted, client_ms, step, round_trip_ms, "
        "server_ms FROM input_events WHERE number = 0",
        "UPDATE episodes SET ended_ms = NULL, outcome = NULL, trajectory_hash = NULL WHERE outcome = 'out_of_bounds'",
        "UPDATE studies SET secret = CASE WHEN secret LIKE '0%' THEN '1' ELSE '0' END || substr(secret, 2)",
        "UPDATE studies SET protocol = replace(protocol, 'dunes', 'duned')",
    ],
)
def test_what_was_taken_away_or_added_is_found(copy, harm):
    conn, path = copy
    conn.execute("PRAGMA foreign_keys = OFF")
    assert conn.execute(harm).rowcount > 0
    assert verify_database(path).findings


def test_a_forged_reward_is_named_with_what_is_stored_and_what_is_right(copy):
    conn, path = copy
    (ident,) = conn.execute("SELECT episode_id FROM study_episodes WHERE phase = 'ranked' AND trial = 2 LIMIT 1").fetchone()
    (right,) = conn.execute("SELECT reward FROM steps WHERE episode_id = ? AND step = 3", [ident]).fetchone()
    conn.execute("UPDATE steps SET reward = 99.5 WHERE episode_id = ? AND step = 3", [ident])
    said = [str(finding) for finding in verify_database(path).findings]
    assert f"episode {ident}: reward of step 3 is 99.5, found {right!r}" in said


RANKED = "(SELECT episode_id FROM study_episodes WHERE phase = 'ranked' AND trial = {})"


@pytest.mark.parametrize(
    ("harm", "found"),
    [
        ("UPDATE steps SET reward = reward + 0.5 WHERE step = 2", "reward of step 2"),
        ("UPDATE steps SET discovered = discovered + 1 WHERE step = 2", "discovered of step 2"),
        ("UPDATE steps SET driver = 'script' WHERE step = 1", "driver"),
        (f"UPDATE episodes SET total = total + 1, score = score + 1 WHERE id IN {RANKED.format(1)}", "score"),
        (f"UPDATE episodes SET trajectory_hash = 'x' WHERE id IN {RANKED.format(1)}", "trajectory_hash"),
        (f"UPDATE episodes SET seed = 77 WHERE id IN {RANKED.format(1)}", "terrain"),
        (f"UPDATE episodes SET seed = NULL WHERE id IN {RANKED.format(1)}", "seed of ranked terrain"),
        (f"UPDATE episodes SET terrain = zeroblob(8) WHERE id IN {RANKED.format(1)}", "terrain_hash"),
        (f"UPDATE episodes SET outcome = 'timed_out' WHERE id IN {RANKED.format(1)}", "outcome"),
        (f"UPDATE episodes SET seed_chosen = 1 WHERE id IN {RANKED.format(1)}", "seed_chosen, assisted"),
        ("UPDATE study_episodes SET terrain = 2 - terrain WHERE phase = 'ranked'", "order of ranked terrains"),
        ("UPDATE study_episodes SET terrain = 0 WHERE phase = 'ranked'", "ranked terrains"),
        ("UPDATE study_episodes SET trial = trial + 5 WHERE phase = 'warm_up'", "warm_up trials"),
        ("DELETE FROM study_episodes WHERE phase = 'ranked' AND trial = 0", "ranked trials"),
    ],
)
def test_a_forger_who_makes_the_chain_anew_is_found_by_what_follows_from_the_causes(copy, harm, found):
    conn, path = copy
    assert conn.execute(harm).rowcount > 0
    write_chain_anew(conn)
    said = {finding.what for finding in verify_database(path).findings}
    assert not any("digest" in what for what in said)
    assert any(what.startswith(found) for what in said), said


def test_a_damaged_file_is_a_sentence(played, tmp_path, capsys):
    data = bytearray(played[0].read_bytes())
    data[8192:-4096] = b"\xff" * (len(data) - 12288)
    (tmp_path / "bad.db").write_bytes(data)
    with pytest.raises(SystemExit) as left:
        main(["verify", "--database", str(tmp_path / "bad.db"), "--studies", str(tmp_path)])
    said = capsys.readouterr()
    assert (left.value.code, said.err.count("\n")) == (1, 1)
    assert "is damaged" in said.err


def test_open_episodes_are_counted_and_open_studies_checked_where_their_secret_is_known(tmp_path):
    study = freeze(tmp_path / "studies", close=False)
    recorder = StudyRecorder(tmp_path / "play.db", study)
    person = recorder.join(0)
    recorder.play(person, "warm_up", 0)
    recorder.play(person, "ranked", 0, "open")
    recorder.close()
    result = verify_database(tmp_path / "play.db", secrets={study.name: study.secret})
    assert (result.findings, result.episodes, result.still_open) == ((), 1, 1)
    wrong = verify_database(tmp_path / "play.db", secrets={study.name: b"\0" * 32})
    assert "commitment" in {finding.what for finding in wrong.findings}
    assert any(finding.what.startswith("seed of warm_up") for finding in wrong.findings)


@pytest.mark.long
def test_several_processes_find_what_one_finds(copy, monkeypatch):
    conn, path = copy
    conn.execute("UPDATE steps SET reward = reward + 1 WHERE step = 1")
    alone = verify_database(path)
    monkeypatch.setattr(verification, "PARALLEL_FROM", 2)
    monkeypatch.setattr(verification, "EPISODES_PER_TASK", 9)
    monkeypatch.setattr(verification, "cores", lambda: 2)
    progress = []
    together = verify_database(path, lambda done, total: progress.append((done, total)))
    assert together.findings == alone.findings
    assert together.findings
    assert progress == [(9, 18), (18, 18)]
