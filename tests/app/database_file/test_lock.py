"""One server to a database, whatever name it is given."""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from humanplay.db import file
from humanplay.db.file import StoreError
from humanplay.db.reader import Reader
from humanplay.db.store import Store
from tests.support.recorded import play

OPEN = "import sys; from humanplay.db.store import Store, StoreError\ntry: Store(sys.argv[1])\nexcept StoreError as e: print(e)"


def opened_elsewhere(path):
    """Return what a second server, in a process of its own, says of the database."""
    return subprocess.run(
        [sys.executable, "-c", OPEN, str(path)], check=True, capture_output=True, text=True
    ).stdout.strip()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "play.db"


@pytest.mark.skipif(sys.platform != "linux", reason="the lock on the database itself is Linux's")
def test_a_second_server_is_refused_through_links_and_without_the_lock_file(path, tmp_path):
    store = Store(path)
    play(store, seed=1)
    (tmp_path / "elsewhere").mkdir()
    symbolic, hard = tmp_path / "elsewhere" / "symbolic.db", tmp_path / "elsewhere" / "hard.db"
    symbolic.symlink_to(path)
    os.link(path, hard)
    path.with_name("play.db-lock").unlink()
    for name in (path, symbolic, hard):
        with pytest.raises(StoreError, match="in use by another server"):
            Store(name)
    assert "in use by another server" in opened_elsewhere(hard)
    store.close()
    Store(symbolic).close()


def test_refusing_a_second_server_keeps_the_locks_of_the_first(path, tmp_path):
    """Opening and closing another handle would drop SQLite's locks, and lose the log."""
    store = Store(path)
    play(store, seed=1)
    Reader.open(path).close()
    reader = Reader.open(path)
    other = tmp_path / "other.db"
    os.link(path, other)
    with pytest.raises(StoreError, match="in use by another server"):
        Store(other)
    log = path.with_name("play.db-wal").stat().st_ino
    code = "import sqlite3, sys; db = sqlite3.connect(sys.argv[1]); db.execute('SELECT 1 FROM steps').fetchone(); db.close()"
    subprocess.run([sys.executable, "-c", code, str(path)], check=True)
    assert path.with_name("play.db-wal").stat().st_ino == log
    store.close()
    assert reader.count() == 1
    subprocess.run([sys.executable, "-c", code, str(path)], check=True)
    assert path.with_name("play.db-wal").exists(), "the reader still has the log"
    reader.close()


def test_readers_on_many_threads_are_counted_one_by_one(path, monkeypatch):
    path.touch()
    identity, interval = file.identity_of(path), sys.getswitchinterval()
    monkeypatch.setattr(
        file, "identity_of", lambda _: identity
    )  # the system's calls take most of the time
    held, until = file.hold(path), time.monotonic() + 1

    def come_and_go():
        while time.monotonic() < until:
            for release in [file.hold(path) for _ in range(20)]:
                release()

    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(6) as readers:
            for future in [readers.submit(come_and_go) for _ in range(6)]:
                future.result()
    finally:
        sys.setswitchinterval(interval)
    assert file.is_in_use(path)
    held()
    assert not file.is_in_use(path)


def test_a_handle_of_the_lock_is_closed_with_the_last_connection(path):
    handles = len(list(Path("/proc/self/fd").iterdir())) if sys.platform == "linux" else 0
    store = Store(path)
    reader = Reader.open(path)
    store.close()
    reader.close()
    if sys.platform == "linux":
        assert len(list(Path("/proc/self/fd").iterdir())) == handles
