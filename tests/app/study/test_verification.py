"""`verify`: what is as it was passes; whatever was changed is found and named."""

import json
import re
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from humanplay.board.attestation import COPIED
from humanplay.db import chain
from humanplay.db.checks import CheckedEpisode
from humanplay.db.columns import TABLES
from humanplay.study import verification
from humanplay.study.verification import check_attestation, verify_database
from tests.app.play.test_attestation import STARTED, burst
from tests.support.command import command
from tests.support.recorded import ask
from tests.support.stored_studies import (
    StudyRecorder,
    freeze,
    play_study,
    write_chain_anew,
)
from tests.support.study import Person
from tests.support.study import freeze as freeze_small


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A closed study's database, and its participants."""
    folder = tmp_path_factory.mktemp("played")
    study = freeze(folder / "play.db-studies")
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


ROWS = {
    **{table: f"SELECT * FROM {table} LIMIT 1" for table in ("participants", "stage_events", "identities", "series")},
    **{table: f"SELECT * FROM {table} LIMIT 1" for table in ("players", "sessions")},
    **{table: f"SELECT * FROM {table} WHERE number = 7" for table in ("chain", "chain_salts")},
}  # fmt: skip
"""Table -> SQL for the row of it that is changed."""

COLUMNS = [
    (table, column)
    for table in ROWS
    for column in TABLES[table].columns("database" if table.startswith("chain") else "chain")
]


def change(conn, table, column, row):
    """Change a column of a row, and say what became of it."""
    names = TABLES[table].names()
    old = row[names.index(column.name)]
    match = " AND ".join(f"{name} IS ?" for name in names)
    new = "x" if old is None and column.type == "text" else changed(old)
    sql = f"UPDATE {table} SET {column.name} = ? WHERE {match}"
    assert conn.execute(sql, (new, *row)).rowcount == 1
    return f"{table}.{column.name} was {old!r}, became {new!r}"


@pytest.mark.parametrize(
    ("table", "column"), COLUMNS, ids=lambda parameter: getattr(parameter, "name", parameter)
)
def test_a_change_to_any_stored_field_is_found(copy, table, column):
    conn, path = copy
    harm = change(conn, table, column, conn.execute(ROWS[table]).fetchone())
    result = verify_database(path)
    assert result.findings, harm
    assert result.failed >= 1


@pytest.mark.parametrize("table", ["episodes", "series_episodes", "steps", "input_events"])
def test_a_change_to_any_stored_field_of_an_episode_is_found_and_the_episode_named(
    played, tmp_path, table
):
    """Of each episode another column is changed; all of them are found at once."""
    key = "id" if table == "episodes" else "episode_id"
    left = list(TABLES[table].columns("chain"))
    while left:
        path = Path(shutil.copy(played[0], tmp_path / "copy.db"))
        with closing(sqlite3.connect(path, isolation_level=None)) as conn:
            conn.execute("PRAGMA ignore_check_constraints = ON")
            rows = conn.execute(f"SELECT * FROM {table} GROUP BY {key} ORDER BY {key}").fetchall()
            at = TABLES[table].names().index(key)
            changes = [(row[at], change(conn, table, left.pop(), row)) for row in rows[: len(left)]]
        named = " ".join(finding.where for finding in verify_database(path).findings)
        assert [harm for episode, harm in changes if episode not in named] == []


@pytest.mark.parametrize(
    ("table", "harm", "ident_sql"),
    [
        ("players", "UPDATE players SET created_ms = created_ms + 1 WHERE id = (SELECT min(player_id) FROM participants)",
         "SELECT id FROM participants WHERE player_id = (SELECT min(player_id) FROM participants)"),
        ("sessions", "UPDATE sessions SET control = 'cookie' WHERE id = (SELECT min(id) FROM sessions)",
         "SELECT min(id) FROM sessions"),
        ("sessions", "UPDATE sessions SET owner_id = 'x' WHERE id = (SELECT min(id) FROM sessions)",
         "SELECT min(id) FROM sessions"),
        ("identities", "UPDATE identities SET value = 'other' WHERE participant_id = (SELECT min(id) FROM participants)",
         "SELECT min(id) FROM participants"),
        ("identities", "DELETE FROM identities WHERE participant_id = (SELECT min(id) FROM participants)",
         "SELECT min(id) FROM participants"),
        ("series", "UPDATE series SET frozen_ms = frozen_ms + 1", "SELECT name FROM series"),
        ("series", "UPDATE series SET closed_ms = closed_ms + 1", "SELECT name FROM series"),
        ("input_events", "UPDATE input_events SET code = 'KeyQ' WHERE episode_id = (SELECT min(id) FROM episodes)",
         "SELECT min(id) FROM episodes"),
    ],
)  # fmt: skip
def test_a_change_that_follows_from_no_cause_is_named_by_table_and_id(copy, table, harm, ident_sql):
    conn, path = copy
    conn.execute("PRAGMA foreign_keys = OFF")
    (ident,) = conn.execute(ident_sql).fetchone()
    assert conn.execute(harm).rowcount > 0
    findings = [
        (finding.where.split()[1], finding.what) for finding in verify_database(path).findings
    ]
    assert (ident, f"digest of its stored fields in the table {table}") in findings


def test_a_forger_who_makes_the_salted_hashes_of_a_row_anew_needs_the_chain_as_well(copy):
    conn, path = copy
    (ident,) = conn.execute("SELECT min(id) FROM participants").fetchone()
    conn.execute("UPDATE identities SET value = 'other' WHERE participant_id = ?", [ident])
    ((salt, stored),) = conn.execute(
        "SELECT s.salt, c.hash FROM chain_salts s JOIN chain c USING (number) WHERE s.id = ?",
        [ident],
    ).fetchall()
    parts = chain.compute(conn, chain.Thing("participant", ident), salt)
    conn.execute("UPDATE chain_salts SET parts = ? WHERE id = ?", (json.dumps(parts), ident))
    (only_finding,) = verify_database(path).findings
    assert (only_finding.where, only_finding.what, only_finding.stored) == (
        f"participant {ident}",
        "digest of its stored fields",
        stored,
    )
    conn.execute("UPDATE chain SET hash = ? WHERE hash = ?", (chain.combine(parts), stored))
    assert [finding.what for finding in verify_database(path).findings] == ["its head"]


def remove_participant(conn, person):
    """Delete a participant as `forget` does, but without an entry of the chain.

    All of their rows and the salts of their entries go.
    """
    conn.execute("PRAGMA foreign_keys = OFF")
    session, player = conn.execute(
        "SELECT session_id, player_id FROM participants WHERE id = ?", [person]
    ).fetchone()
    for table in ("steps", "input_events", "series_episodes"):
        conn.execute(
            f"DELETE FROM {table} WHERE episode_id IN (SELECT id FROM episodes WHERE session_id = ?)",
            [session],
        )
    gone = "id IN (SELECT id FROM episodes WHERE session_id = ?) OR id IN (?, ?)"
    numbers = [
        row[0]
        for row in conn.execute(
            f"SELECT number FROM chain_salts WHERE {gone}", (session, session, person)
        )
    ]
    conn.execute(f"DELETE FROM chain_salts WHERE {gone}", (session, session, person))
    conn.execute("DELETE FROM episodes WHERE session_id = ?", [session])
    conn.execute("DELETE FROM sessions WHERE id = ?", [session])
    for table in ("identities", "stage_events"):
        conn.execute(f"DELETE FROM {table} WHERE participant_id = ?", [person])
    conn.execute("DELETE FROM participants WHERE id = ?", [person])
    conn.execute("DELETE FROM players WHERE id = ?", [player])
    return numbers


def test_a_participant_removed_with_everything_but_the_chain_is_found(copy, played):
    conn, path = copy
    numbers = remove_participant(conn, played[2][1])
    assert len(numbers) > 7
    assert {finding.where for finding in verify_database(path).findings} == {
        f"chain entry {number}" for number in numbers
    }


def test_a_participant_removed_with_their_entries_leaves_a_gap(copy, played):
    conn, path = copy
    numbers = remove_participant(conn, played[2][1])
    conn.execute(f"DELETE FROM chain WHERE number IN ({','.join(map(str, numbers))})")
    findings = verify_database(path).findings
    assert {"the entry before it", "its head"} <= {finding.what for finding in findings}


@pytest.mark.parametrize(
    "makes_anew", [False, True], ids=["the end is cut off", "the whole is made anew"]
)
def test_a_chain_without_its_end_or_made_anew_is_found_by_an_earlier_head_alone(
    copy, played, makes_anew
):
    conn, path = copy
    before = verify_database(path).chain
    numbers = remove_participant(conn, played[2][2])
    if makes_anew:
        write_chain_anew(conn)
    else:
        marks = ",".join(map(str, numbers))
        (replaced,) = conn.execute(
            f"SELECT min(replaces) FROM chain WHERE number IN ({marks})"
        ).fetchone()
        conn.execute(
            "DELETE FROM chain WHERE number >= ?", [min([*numbers, replaced or before.entries])]
        )
    assert verify_database(path).findings == ()
    (finding,) = verify_database(path, head=before.head).findings
    assert (finding.where, finding.what, finding.stored) == ("chain", "the head given", before.head)


def test_an_earlier_head_says_what_was_changed_since(copy, played):
    conn, path = copy
    before = verify_database(path).chain
    person = played[2][0]
    conn.execute("UPDATE participants SET completed_ms = 7 WHERE id = ?", [person])
    chain.append(conn, "participant", person)
    result = verify_database(path, head=before.head)
    assert result.findings == ()
    assert (result.chain.entries, result.since.entry) == (before.entries + 1, before.entries)
    assert (result.since.added, result.since.replaced, result.since.forgotten) == (
        {"participant": 1},
        {"participant": 1},
        {},
    )


@pytest.mark.parametrize(
    "harm",
    [
        "DELETE FROM input_events WHERE number = 1000",
        "DELETE FROM input_events",
        "DELETE FROM steps WHERE step = (SELECT max(step) FROM steps)",
        "DELETE FROM stage_events WHERE number = 2",
        "DELETE FROM series_episodes WHERE phase = 'tutorial'",
        "DELETE FROM chain_salts WHERE kind = 'episode'",
        "DELETE FROM episodes WHERE outcome = 'out_of_bounds'",
        "INSERT INTO input_events SELECT episode_id, 5000, tab, page_load, kind, code, repeat, trusted, client_ms, "
        "step, round_trip_ms, server_ms FROM input_events WHERE number = 0",
        "UPDATE episodes SET ended_ms = NULL, outcome = NULL, trajectory_hash = NULL WHERE outcome = 'out_of_bounds'",
        "UPDATE series SET secret = CASE WHEN secret LIKE '0%' THEN '1' ELSE '0' END || substr(secret, 2)",
        "UPDATE series SET protocol = replace(protocol, 'dunes', 'duned')",
    ],
)
def test_what_was_taken_away_or_added_is_found(copy, harm):
    conn, path = copy
    conn.execute("PRAGMA foreign_keys = OFF")
    assert conn.execute(harm).rowcount > 0
    assert verify_database(path).findings


def test_a_forged_reward_is_named_with_what_is_stored_and_what_is_right(copy):
    conn, path = copy
    (ident,) = conn.execute(
        "SELECT episode_id FROM series_episodes WHERE phase = 'ranked' AND trial = 2 LIMIT 1"
    ).fetchone()
    (right,) = conn.execute(
        "SELECT reward FROM steps WHERE episode_id = ? AND step = 3", [ident]
    ).fetchone()
    conn.execute("UPDATE steps SET reward = 99.5 WHERE episode_id = ? AND step = 3", [ident])
    findings = [str(finding) for finding in verify_database(path).findings]
    assert f"episode {ident}: reward of step 3 is 99.5, found {right!r}" in findings


RANKED = "(SELECT episode_id FROM series_episodes WHERE phase = 'ranked' AND trial = {})"


@pytest.mark.parametrize("stage", ["complete", "withdrawn"])
def test_the_newest_ranked_episode_is_missed_also_where_the_chain_is_made_anew(copy, stage):
    conn, path = copy
    conn.execute("PRAGMA foreign_keys = OFF")
    newest = "SELECT episode_id, participant_id FROM series_episodes WHERE phase = 'ranked' ORDER BY trial DESC LIMIT 1"
    episode, participant = conn.execute(newest).fetchone()
    for table in ("steps", "input_events", "series_episodes"):
        conn.execute(f"DELETE FROM {table} WHERE episode_id = ?", [episode])
    conn.execute("DELETE FROM episodes WHERE id = ?", [episode])
    conn.execute("DELETE FROM chain_salts WHERE id = ?", [episode])
    came = "INSERT INTO stage_events VALUES (?, 900, 0, 'stage', ?)"
    conn.execute(came, (participant, '{"stage": "debrief"}'))
    conn.execute("UPDATE participants SET stage = ? WHERE id = ?", (stage, participant))
    write_chain_anew(conn)
    (finding,) = verify_database(path).findings
    assert (finding.where, finding.what, finding.stored) == (
        f"participant {participant}",
        "ranked episodes that ended",
        2,
    )


def test_the_documents_name_the_tables_outside_the_chain():
    page = Path(__file__).parents[3] / "docs" / "release.md"
    listed = (
        page.read_text(encoding="utf-8").split("|tables outside the chain|", 1)[1].split("\n\n")[0]
    )
    names = {
        name
        for line in listed.splitlines()[2:]
        for name in re.findall(r"`(\w+)`", line.split("|")[1])
    }
    outside = {
        table.name for table in TABLES.values() if table.names() and not table.columns("chain")
    }
    assert names == outside


ASKED = {"answers", "free_texts"}
"""Tables of a study that asks questions, whose rows `test_questions.py` deletes."""
CHAINED = [
    table.name for table in TABLES.values() if table.columns("chain") and table.name not in ASKED
]


@pytest.mark.parametrize("place", ["ASC", "DESC"])
@pytest.mark.parametrize("table", CHAINED)
def test_a_chained_row_that_is_deleted_from_a_closed_study_is_found(copy, table, place):
    conn, path = copy
    conn.execute("PRAGMA foreign_keys = OFF")
    key = TABLES[table].names("chain")[0]
    (row,) = conn.execute(f"SELECT {key} FROM {table} ORDER BY {key} {place} LIMIT 1").fetchone()
    assert conn.execute(f"DELETE FROM {table} WHERE {key} = ?", [row]).rowcount > 0
    assert verify_database(path).findings


@pytest.mark.parametrize(
    ("harm", "beginning"),
    [
        ("UPDATE steps SET reward = reward + 0.5 WHERE step = 2", "reward of step 2"),
        ("UPDATE steps SET discovered = discovered + 1 WHERE step = 2", "discovered of step 2"),
        ("UPDATE steps SET driver = 'script' WHERE step = 1", "driver"),
        (
            f"UPDATE episodes SET total = total + 1, score = score + 1 WHERE id IN {RANKED.format(1)}",
            "score",
        ),
        (
            f"UPDATE episodes SET trajectory_hash = 'x' WHERE id IN {RANKED.format(1)}",
            "trajectory_hash",
        ),
        (f"UPDATE episodes SET seed = 77 WHERE id IN {RANKED.format(1)}", "terrain"),
        (
            f"UPDATE episodes SET seed = NULL WHERE id IN {RANKED.format(1)}",
            "seed of ranked instance",
        ),
        (
            f"UPDATE episodes SET terrain = zeroblob(8) WHERE id IN {RANKED.format(1)}",
            "terrain_hash",
        ),
        (f"UPDATE episodes SET outcome = 'timed_out' WHERE id IN {RANKED.format(1)}", "outcome"),
        (
            f"UPDATE episodes SET seed_chosen = 1 WHERE id IN {RANKED.format(1)}",
            "seed_chosen, assisted",
        ),
        (
            "UPDATE series_episodes SET terrain = 2 - terrain WHERE phase = 'ranked'",
            "order of ranked instances",
        ),
        (
            "UPDATE series_episodes SET terrain = terrain + 9 WHERE phase = 'ranked'",
            "ranked instances",
        ),
        ("UPDATE series_episodes SET trial = trial + 5 WHERE phase = 'warm_up'", "warm_up trials"),
        (
            "UPDATE participants SET joined_ms = (SELECT frozen_ms FROM series) - 1",
            "time of joining",
        ),
        ("DELETE FROM series_episodes WHERE phase = 'ranked' AND trial = 0", "ranked trials"),
        (
            f"UPDATE episodes SET attestation = 'supervised' WHERE id IN {RANKED.format(1)}",
            "attestation",
        ),
        (f"UPDATE episodes SET attestation = NULL WHERE id IN {RANKED.format(1)}", "attestation"),
        ("UPDATE episodes SET attestation = 'attested' WHERE driver = 'script'", "attestation"),
        (
            "UPDATE episodes SET attestation = 'unattested', attestation_reason = 'slow'",
            "attestation",
        ),
        ("UPDATE input_events SET trusted = 0", "attestation"),
        ("UPDATE steps SET key_down_ms = key_down_ms + 3.5", "attestation"),
        ("DELETE FROM input_events WHERE number = 4", "attestation"),
        ("UPDATE stage_events SET kind = 'supervised' WHERE number = 2", "attestation"),
        ("UPDATE stage_events SET kind = 'settings', detail = 'x' WHERE number = 2", "attestation"),
    ],
)
def test_a_forger_who_makes_the_chain_anew_is_found_by_what_follows_from_the_causes(
    copy, harm, beginning
):
    conn, path = copy
    of_terrains = "FROM sqlite_schema WHERE name = 'series_episodes_by_terrain'"
    (index,) = conn.execute(f"SELECT sql {of_terrains}").fetchone()
    conn.execute("DROP INDEX series_episodes_by_terrain")
    assert conn.execute(harm).rowcount > 0
    conn.execute(index)
    write_chain_anew(conn)
    fields = {finding.what for finding in verify_database(path).findings}
    assert not any("digest" in field for field in fields)
    assert any(field.startswith(beginning) for field in fields), fields


def test_what_comes_after_the_end_changes_no_level(copy):
    conn, path = copy
    conn.execute("DELETE FROM input_events WHERE number >= 1000")
    write_chain_anew(conn)
    assert verify_database(path).findings == ()


def test_an_episode_with_copied_timing_is_spoilt_for_that_alone(copy):
    conn, path = copy
    conn.execute(
        f"UPDATE episodes SET attestation = 'spoilt', attestation_reason = '{COPIED}' WHERE driver = 'human'"
    )
    write_chain_anew(conn)
    assert verify_database(path).findings == ()
    conn.execute("UPDATE input_events SET trusted = 0")
    write_chain_anew(conn)
    assert {finding.what for finding in verify_database(path).findings} == {"attestation"}


def test_a_burst_is_attested_on_the_playground_alone(copy):
    conn, _ = copy
    typed = burst(40)
    (ident,) = conn.execute("SELECT episode_id FROM series_episodes").fetchone()

    def is_right(level, reason=None):
        row = {"id": ident, "task": "mars",
               "driver": "human", "attestation": level, "attestation_reason": reason, "control": "cookie",
               "started_ms": STARTED, "ended_ms": STARTED + 3_600_000}  # fmt: skip
        return not list(
            check_attestation(conn, CheckedEpisode(row, typed.moves, typed.events, [], None))
        )

    of_a_study = ("spoilt", "step 15: the press answers the frame of step 6")
    assert (is_right("attested"), is_right(*of_a_study), is_right("unattested", "slow")) == (
        False,
        True,
        False,
    )
    conn.execute("DELETE FROM series_episodes WHERE episode_id = ?", [ident])
    assert (is_right("attested"), is_right(*of_a_study), is_right("unattested", "slow")) == (
        True,
        False,
        False,
    )


def test_a_damaged_file_is_a_sentence(played, tmp_path, capsys):
    data = bytearray(played[0].read_bytes())
    data[8192:-4096] = b"\xff" * (len(data) - 12288)
    (tmp_path / "bad.db").write_bytes(data)
    database = "--database", tmp_path / "bad.db"
    code, _, error = command(capsys, "verify", *database)
    assert (code, error.count("\n"), "is damaged" in error) == (1, 1, True)


def test_open_episodes_are_counted_and_open_studies_checked_where_their_secret_is_known(tmp_path):
    study = freeze(tmp_path / "play.db-studies", close=False)
    recorder = StudyRecorder(tmp_path / "play.db", study)
    person = recorder.join(0, stage="tutorial")
    recorder.play(person, "warm_up", 0)
    recorder.play(person, "ranked", 0, "open")
    recorder.close()
    result = verify_database(tmp_path / "play.db", secrets={study.name: study.secret})
    assert (result.findings, result.episodes, result.still_open) == ((), 1, 1)
    wrong = verify_database(tmp_path / "play.db", secrets={study.name: b"\0" * 32})
    by_field = {finding.what: str(finding) for finding in wrong.findings}
    assert (
        "in the folder beside the database, which may be another server's" in by_field["commitment"]
    )
    assert any(finding.what.startswith("seed of warm_up") for finding in wrong.findings)


def test_people_who_joined_and_began_nothing_leave_nothing_to_find(serve, tmp_path):
    """A participant without a board has no session; the database may have none at all."""
    freeze_small(tmp_path / "playground.db-studies")
    server = serve()
    Person(server)
    server.stop()
    path = tmp_path / "playground.db"
    assert ask(path, "SELECT count(*) FROM participants WHERE session_id IS NULL") == [(1,)]
    assert ask(path, "SELECT count(*) FROM sessions") == [(0,)]
    assert verify_database(tmp_path / "playground.db").findings == ()


@pytest.mark.parametrize("table", ["participants", "sessions", "series", "episodes", "players"])
def test_rows_that_belong_to_nothing_are_counted_by_table(copy, table):
    conn, path = copy
    conn.execute("PRAGMA foreign_keys = OFF")
    conn.execute(f"DELETE FROM {table}")
    keys = """SELECT m.name, k."from" FROM sqlite_master m JOIN pragma_foreign_key_list(m.name) k WHERE k."table" = ?"""
    left = {
        f"table {name}"
        for name, column in conn.execute(keys, [table]).fetchall()
        if conn.execute(f"SELECT 1 FROM {name} WHERE {column} IS NOT NULL").fetchone()
    }
    assert left
    assert left <= {finding.where for finding in verify_database(path).findings}


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
