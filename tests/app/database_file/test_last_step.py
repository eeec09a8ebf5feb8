"""A log that is missing after a crash: the next start notices, says so, and writes nothing that would prevent its return."""

import shutil
import sqlite3
import subprocess
import sys
import threading
import time
from contextlib import closing

import pytest

from humanplay.db.database import StoreError
from humanplay.db.store import Store
from humanplay.web.operator.health import Health
from tests.support.command import command
from tests.support.recorded import SMALL, add_session, add_steps, free_moves, open_episode, play
from tests.support.servers import eventually


@pytest.fixture
def crashed(tmp_path):
    """The files of a server that was killed after three steps, and the episode."""
    (tmp_path / "running").mkdir()
    with closing(Store(tmp_path / "running" / "play.db")) as store:
        row, episode = open_episode(store, add_session(store), seed=4, config=SMALL)
        store.connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        add_steps(store, row, episode, free_moves(episode)[:3])
        shutil.copytree(tmp_path / "running", tmp_path / "crashed")
    return tmp_path / "crashed" / "play.db", row.id


def log_of(path):
    return path.with_name(path.name + "-wal")


def test_a_log_that_is_there_is_read_and_nothing_is_said(crashed):
    path, episode = crashed
    with closing(Store(path)) as store:
        assert store.notice is None
        assert len(store.steps(episode)) == 3


def test_a_log_that_is_gone_stops_the_start_until_it_is_put_back_or_its_loss_is_accepted(crashed):
    path, episode = crashed
    log_of(path).rename(path.with_name("found-later"))
    before = path.read_bytes()
    for _ in range(2):
        with pytest.raises(
            StoreError,
            match=rf"step 2 of the episode {episode}.* play.db-wal is gone.*serve --accept-loss",
        ):
            Store(path)
    assert path.read_bytes() == before
    path.with_name("found-later").rename(log_of(path))
    with closing(Store(path)) as store:
        assert len(store.steps(episode)) == 3


def test_a_young_database_whose_log_is_gone_is_not_begun_anew(spawn, tmp_path):
    """Nothing had been written back yet when the server was killed: the file itself knows its tables all the same."""
    server = spawn()
    client = server.client()
    begun = client.post("/api/sessions", json={"size": 9, "seed": 4}).json()
    url, frame = f"/api/sessions/{begun['session']}/act", begun["frame"]
    for _ in range(2):
        body = {"kind": "act", "episode": frame["episode"], "step": frame["step"]}
        frame = client.post(url, json={**body, "action": "south"}).json()
    server.process.kill()
    server.process.wait()
    server.close()
    path = tmp_path / "playground.db"
    with closing(sqlite3.connect(path.as_uri() + "?mode=ro&immutable=1", uri=True)) as conn:
        assert conn.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] > 10
    log_of(path).unlink()
    with pytest.raises(StoreError, match=rf"of the episode {frame['episode']}.*-wal is gone"):
        Store(path)


def test_a_file_that_never_got_its_tables_and_lost_its_log_is_not_begun_anew(crashed):
    path, episode = crashed
    log_of(path).unlink()
    with closing(sqlite3.connect(path)) as conn:
        conn.execute("PRAGMA writable_schema = ON")
        conn.execute("DELETE FROM sqlite_master")
        conn.commit()
    log_of(path).unlink(missing_ok=True)
    with pytest.raises(StoreError, match=rf"step 2 of the episode {episode}"):
        Store(path)


def test_the_loss_of_a_log_can_be_accepted_once_and_for_all(crashed):
    path, episode = crashed
    log_of(path).unlink()
    with closing(Store(path, accept_loss=True)) as store:
        assert "step 2 of the episode" in store.notice
        assert store.steps(episode) == []
    with closing(Store(path)) as store:
        assert store.notice is None, "the server before this one has ended by itself"


def test_a_log_that_was_cut_short_is_noticed(crashed):
    path, _ = crashed
    log_of(path).write_bytes(log_of(path).read_bytes()[:-4200])
    with closing(Store(path)) as store:
        assert "is older than it was when its server was killed" in store.notice


def test_a_database_that_is_gone_after_a_crash_is_not_begun_anew(crashed):
    path, _ = crashed
    path.unlink()
    log_of(path).unlink()
    with pytest.raises(StoreError, match="is not in it"):
        Store(path)
    assert not path.exists()


@pytest.fixture
def root_of_steps(tmp_path):
    """Make a database with moves, and return where in its file the table of moves begins."""
    with closing(Store(tmp_path / "playground.db")) as store:
        for seed in range(40):
            play(store, seed=seed)
        sql = "SELECT rootpage FROM sqlite_master WHERE name = 'steps'"
        return 4096 * (store.connection.execute(sql).fetchone()[0] - 1)


def damage(path, at):
    """Overwrite a page; from another process, since closing a handle here would drop SQLite's locks."""
    code = "import os, sys; f = os.open(sys.argv[1], os.O_WRONLY); os.pwrite(f, bytes([119]) * 4096, int(sys.argv[2]))"
    subprocess.run([sys.executable, "-c", code, str(path), str(at)], check=True)


def test_after_a_clean_stop_the_file_is_checked_beside_play_and_damage_is_said_and_logged(
    spawn, tmp_path, root_of_steps
):
    path = tmp_path / "playground.db"
    server = spawn()
    assert server.client().get("/readyz").status_code == 200
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
    said = "".join(server.said) + server.process.stdout.read()
    server.close()
    assert said.count(f"the database {path} is damaged") == 1
    assert "Traceback" not in said


def test_after_a_kill_a_damaged_file_is_one_sentence_before_anything_is_answered(
    spawn, tmp_path, root_of_steps, capsys
):
    """Also where nobody had moved, so that no step was noted."""
    path = tmp_path / "playground.db"
    spawn().kill()
    damage(path, root_of_steps)
    code, out, err = command(capsys, "serve", "--port", "0", "--database", path)
    assert "Traceback" not in err
    assert code == 1
    assert err.count(f"the database {path} is damaged") == 1
    assert f"sqlite3 {path} .recover | sqlite3 NEW" in err
    assert "is open at" not in out


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
