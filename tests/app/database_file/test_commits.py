"""A database that lacks commits noted beside it is refused by whatever opens it."""

import shutil
import sqlite3
import subprocess
import sys
import threading
import time
from contextlib import closing
from itertools import chain, combinations

import pytest

from humanplay.db.file import boot_id
from humanplay.db.store import Store
from humanplay.web.operator.health import Health
from tests.support.command import command
from tests.support.recorded import ask, play
from tests.support.servers import PATIENCE_S, eventually

PASSWORD = "correct horse battery"
CANNOT_TELL = "cannot tell whether the database"
SIDE_FILES = ("-wal", "-shm", "-lock")
SUBSETS = list(chain.from_iterable(combinations(SIDE_FILES, count) for count in range(4)))


def beside(path, suffix):
    return path.with_name(path.name + suffix)


def move(server, count):
    """Begin a board and move it; return its session."""
    client = server.client()
    begun = client.post("/api/sessions", json={"size": 9, "seed": 4}).json()
    url, frame = f"/api/sessions/{begun['session']}/act", begun["frame"]
    for _ in range(count):
        body = {"kind": "act", "episode": frame["episode"], "step": frame["step"]}
        frame = client.post(url, json={**body, "action": "south"}).json()
    return begun["session"]


def commits_of(path):
    """How many commits a database holds, read without a trace."""
    with closing(sqlite3.connect(path.as_uri() + "?mode=ro&immutable=1", uri=True)) as conn:
        return int(conn.execute("SELECT value FROM meta WHERE name = 'commits'").fetchone()[0])


def noted(path):
    """How many commits the note beside a database says that it holds."""
    return int(beside(path, "-lock").read_text().split()[0])


def cut_power(path):
    """Take the newest commit, as the end of the system's power may."""
    log, note = beside(path, "-wal"), beside(path, "-lock")
    log.write_bytes(log.read_bytes()[:-4200])
    note.write_text(note.read_text().replace(boot_id(), "another-boot"))


@pytest.fixture
def killed(spawn, tmp_path):
    """The database of a server that was killed after two moves, and their session."""
    server = spawn()
    session = move(server, 2)
    server.kill()
    return tmp_path / "playground.db", session


def refusal(spawn, **settings):
    """What a server says that does not start."""
    with pytest.raises(AssertionError) as refused:
        spawn(**settings)
    return str(refused.value)


def step_of(server, session):
    return server.client().get(f"/api/sessions/{session}").json()["step"]


@pytest.mark.parametrize("gone", SUBSETS, ids=lambda gone: "".join(gone) or "none")
def test_a_killed_server_goes_on_or_the_start_says_what_is_missing(spawn, killed, gone):
    path, session = killed
    missing = noted(path) - commits_of(path)
    assert missing > 2
    contents = {suffix: beside(path, suffix).read_bytes() for suffix in gone}
    for suffix in gone:
        beside(path, suffix).unlink()
    before = path.read_bytes()
    if "-lock" in gone:
        assert CANNOT_TELL in refusal(spawn)
    elif "-wal" in gone:
        for _ in range(2):
            assert f"playground.db lacks {missing} commits" in refusal(spawn)
    assert path.read_bytes() == before
    for suffix, content in contents.items():
        beside(path, suffix).write_bytes(content)
    assert step_of(spawn(), session) == 2


@pytest.mark.parametrize("gone", [("-wal",), ("-wal", "-shm"), ("-lock",)], ids="".join)
@pytest.mark.parametrize(
    "words",
    ["verify", "export --out FOLDER", "backup FOLDER/copy.db", "replay abc --out FOLDER/x.html"],
)
def test_a_command_before_the_start_is_refused_and_hides_nothing(
    spawn, killed, tmp_path, capsys, words, gone
):
    path, _ = killed
    for suffix in gone:
        beside(path, suffix).unlink()
    words = words.replace("FOLDER", str(tmp_path / "out")).split()
    expected = CANNOT_TELL if "-lock" in gone else "playground.db lacks"
    for _ in range(2):
        code, out, err = command(capsys, *words, "--database", path)
        assert (code, out) == (1, "")
        assert expected in err
    assert expected in refusal(spawn)
    assert expected in refusal(spawn, admin_password=PASSWORD)


def test_what_was_acknowledged_is_counted_also_where_nobody_moved(spawn, tmp_path):
    server, path = spawn(), tmp_path / "playground.db"
    server.client().post("/api/sessions", json={"size": 9, "seed": 4}).raise_for_status()
    server.kill()
    beside(path, "-wal").unlink()
    assert "playground.db lacks" in refusal(spawn)


def test_a_write_beside_a_server_is_noted_at_once(spawn, tmp_path):
    """`/readyz` writes as a command does, over a connection of its own."""
    server, path = spawn(), tmp_path / "playground.db"
    for _ in range(3):
        assert server.client().get("/readyz").status_code == 200
        ((commits,),) = ask(path, "SELECT value FROM meta WHERE name = 'commits'")
        assert noted(path) >= int(commits)
    server.kill()
    beside(path, "-wal").unlink()
    assert "playground.db lacks" in refusal(spawn)


def test_the_file_alone_copied_elsewhere_cannot_be_told_to_be_whole(killed, tmp_path, capsys):
    path, _ = killed
    (tmp_path / "elsewhere").mkdir()
    copy = shutil.copy(path, tmp_path / "elsewhere")
    code, _, err = command(capsys, "verify", "--database", copy)
    assert code == 1
    assert CANNOT_TELL in err
    assert "humanplay restore" in err
    assert command(capsys, "verify", "--accept-loss", "--database", copy)[0] == 0
    assert command(capsys, "verify", "--database", copy)[0] == 0


def test_a_log_that_was_cut_short_stops_the_start(spawn, killed):
    path, _ = killed
    log = beside(path, "-wal")
    log.write_bytes(log.read_bytes()[:-4200])
    assert "playground.db lacks 1 commit" in refusal(spawn)


def test_a_database_that_is_gone_after_a_kill_is_not_begun_anew(spawn, killed):
    path, _ = killed
    for file_path in (path, beside(path, "-wal")):
        file_path.unlink()
    assert "playground.db lacks" in refusal(spawn)
    assert not path.exists()


def test_a_file_that_lacks_its_tables_and_its_log_is_not_begun_anew(spawn, killed):
    path, _ = killed
    beside(path, "-wal").unlink()
    with closing(sqlite3.connect(path)) as conn:
        conn.execute("PRAGMA writable_schema = ON")
        conn.execute("DELETE FROM sqlite_master")
        conn.commit()
    assert "playground.db holds no " in refusal(spawn)


def test_a_power_cut_takes_commits_of_a_server_that_is_not_durable_and_is_noticed(spawn, killed):
    path, session = killed
    cut_power(path)
    server = spawn()
    assert "".join(server.printed).count("lacks 1 commit that was acknowledged") == 1
    assert "a power cut can do this, which --durable prevents" in "".join(server.printed)
    assert step_of(server, session) == 1
    server.kill()
    assert "lacks" not in "".join(spawn().printed)


@pytest.mark.parametrize("reason", ["durable", "no log"])
def test_a_power_cut_is_no_excuse_for_a_durable_server_or_without_a_log(spawn, tmp_path, reason):
    path = tmp_path / "playground.db"
    server = spawn(durable=reason == "durable")
    move(server, 2)
    server.kill()
    cut_power(path)
    if reason == "no log":
        beside(path, "-wal").unlink()
    assert "playground.db lacks" in refusal(spawn)


@pytest.mark.parametrize("gone", [("-wal",), ("-lock",), ("-wal", "-lock")], ids="".join)
def test_a_loss_is_accepted_once_and_for_all(spawn, killed, capsys, gone):
    path, session = killed
    for suffix in gone:
        beside(path, suffix).unlink()
    server = spawn(accept_loss=True)
    assert server.client().get(f"/api/sessions/{session}").status_code == (
        404 if "-wal" in gone else 200
    )
    server.kill()
    assert command(capsys, "verify", "--database", path)[0] == 0
    spawn()


def test_nothing_is_said_of_a_database_that_the_shell_of_sqlite_has_opened_after_a_kill(
    spawn, killed
):
    path, session = killed
    shell = ["sqlite3", str(path), "SELECT count(*) FROM steps; VACUUM"]
    assert subprocess.run(shell, check=True, capture_output=True, text=True).stdout == "2\n"
    assert not beside(path, "-wal").exists()
    assert step_of(spawn(), session) == 2


def test_a_backup_made_beside_play_is_restored_in_the_place_of_what_lacks_commits(
    spawn, tmp_path, capsys
):
    path, copy = tmp_path / "playground.db", tmp_path / "copy.db"
    server = spawn()
    session = move(server, 1)
    assert command(capsys, "backup", copy, "--database", path)[0] == 0
    move(server, 2)
    server.kill()
    beside(path, "-wal").unlink()
    assert command(capsys, "verify", "--database", copy)[0] == 0
    assert command(capsys, "restore", copy, "--database", path, "--yes")[0] == 0
    assert command(capsys, "verify", "--database", path)[0] == 0
    assert step_of(spawn(), session) == 1


def test_what_a_restore_sets_aside_can_be_put_back(spawn, killed, tmp_path, capsys):
    path, session = killed
    copy = tmp_path / "copy.db"
    assert command(capsys, "backup", copy, "--database", path)[0] == 0
    assert command(capsys, "restore", copy, "--database", path, "--yes")[0] == 0
    (aside,) = tmp_path.glob("*.before-*[0-9Z]")
    for suffix in ("", "-wal", "-lock"):
        beside(aside, suffix).replace(beside(path, suffix))
    assert step_of(spawn(), session) == 2


def test_merging_and_forgetting_leave_nothing_to_compare(spawn, tmp_path, capsys):
    path, other, merged = (tmp_path / name for name in ("playground.db", "other.db", "merged.db"))
    Store(other).close()
    server = spawn()
    move(server, 2)
    server.kill()
    with closing(sqlite3.connect(path)) as conn:
        conn.execute("INSERT INTO names SELECT player_id, 'Ada', 'ada', 0, 0 FROM sessions")
        conn.commit()
    assert command(capsys, "merge", path, other, "--out", merged)[0] == 0
    words = ("forget", "Ada", "--player", "--yes", "--database")
    assert command(capsys, *words, path)[0] == 0
    for database in (path, merged):
        beside(database, "-lock").unlink(missing_ok=True)
        assert command(capsys, "verify", "--database", database)[0] == 0
        spawn(database=str(database))


@pytest.mark.parametrize("gone", ["-lock", ""], ids=["note", "file"])
def test_a_clean_end_leaves_nothing_to_compare(spawn, tmp_path, capsys, gone):
    path = tmp_path / "playground.db"
    server = spawn()
    move(server, 2)
    server.process.terminate()
    assert server.process.wait() == 0
    server.close()
    assert not beside(path, "-wal").exists()
    beside(path, gone).unlink()
    if gone:
        assert command(capsys, "verify", "--database", path)[0] == 0
    spawn()


def test_the_tables_of_a_young_database_are_in_the_file_itself(spawn, tmp_path):
    """Also while nothing has been written back from the log."""
    spawn().kill()
    path = tmp_path / "playground.db"
    with closing(sqlite3.connect(path.as_uri() + "?mode=ro&immutable=1", uri=True)) as conn:
        assert conn.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] > 10


@pytest.fixture
def root_of_steps(tmp_path):
    """Make a database with moves, and return where its table of moves begins."""
    with closing(Store(tmp_path / "playground.db")) as store:
        for seed in range(40):
            play(store, seed=seed)
        sql = "SELECT rootpage FROM sqlite_master WHERE name = 'steps'"
        return 4096 * (store.connection.execute(sql).fetchone()[0] - 1)


def damage(path, at):
    """Overwrite a page in another process: closing a handle drops SQLite's locks."""
    code = "import os, sys; f = os.open(sys.argv[1], os.O_WRONLY); os.pwrite(f, bytes([119]) * 4096, int(sys.argv[2]))"
    subprocess.run([sys.executable, "-c", code, str(path), str(at)], check=True)


@pytest.mark.parametrize("end", ["a clean stop", "a kill"])
def test_the_file_is_checked_beside_play_and_damage_is_said_and_logged(
    spawn, tmp_path, root_of_steps, end
):
    path = tmp_path / "playground.db"
    server = spawn()
    assert server.client().get("/readyz").status_code == 200
    if end == "a kill":
        server.kill()
    else:
        server.process.terminate()
        assert server.process.wait() == 0
        server.close()
    damage(path, root_of_steps)
    server = spawn()
    client = server.client()
    ready = eventually(lambda: (got := client.get("/readyz")).status_code == 503 and got)
    assert "playground.db is damaged" in ready.json()["detail"]
    answer = client.get("/api/episodes")
    assert answer.status_code == 503
    assert "`humanplay verify`" in answer.json()["detail"]
    server.process.terminate()
    assert server.process.wait() == 0
    log = "".join(server.printed) + server.process.stdout.read()
    server.close()
    assert log.count(f"the database {path} is damaged") == 1
    assert "Traceback" not in log


def test_after_a_power_cut_a_damaged_file_is_one_sentence_before_anything_is_answered(
    spawn, tmp_path, root_of_steps
):
    path = tmp_path / "playground.db"
    server = spawn()
    move(server, 2)
    server.kill()
    cut_power(path)
    damage(path, root_of_steps)
    serve = [sys.executable, "-m", "humanplay.cli", "serve", "--port", "0", "--database", path]
    done = subprocess.run(serve, capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.count(f"the database {path} is damaged") == 1
    assert f"sqlite3 {path} .recover | sqlite3 NEW" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_check_under_way_is_given_up_when_the_server_ends(tmp_path):
    path = tmp_path / "play.db"
    Store(path).close()
    many = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 3000000) SELECT i, 'row' FROM n"
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE theirs (a INTEGER PRIMARY KEY, b)")
        db.execute(f"INSERT INTO theirs {many}")
        db.commit()
    health = Health(path)
    whole_s, spent_s = [], []
    for spent in (whole_s, spent_s):
        thread = threading.Thread(target=health.check)
        began = time.monotonic()
        thread.start()
        if spent is spent_s:
            health.stop()
        thread.join()
        spent.append(time.monotonic() - began)
    assert spent_s[0] < whole_s[0] / 2
