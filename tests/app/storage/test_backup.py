"""Backups while people play, in rotation, and restored."""

import json
import os
import re
import shutil
import sqlite3
import subprocess
import sys
import threading
import time
from contextlib import closing, suppress
from datetime import UTC, datetime, timedelta

import click
import pytest
from click.testing import CliRunner

from humanplay.cli.main import cli
from humanplay.db import backup
from humanplay.db.backup import Backups, StoppedError, back_up, restore
from humanplay.db.checks import quick_check
from humanplay.db.database import StoreError
from humanplay.db.file import lock_path, recordings_beside
from humanplay.db.store import Store
from humanplay.study.folder import Folder
from humanplay.study.protocol import default_protocol
from humanplay.study.verification import verify_database
from tests.support.command import command
from tests.support.declared import DECLARATIONS
from tests.support.recorded import (
    SMALL,
    add_session,
    add_steps,
    ask,
    free_moves,
    open_episode,
    play,
)
from tests.support.servers import eventually
from tests.support.stored_studies import CONFIG, freeze, play_study


@pytest.fixture
def database(tmp_path):
    """A database with two finished episodes and none open."""
    with closing(Store(tmp_path / "play.db")) as store:
        play(store, seed=1)
        play(store, seed=2)
    return tmp_path / "play.db"


def steps_in(path):
    return ask(path, "SELECT count(*) FROM steps")[0][0]


def damage(path, page=None):
    """Overwrite a page in the middle of the file."""
    pages = path.stat().st_size // 4096
    with path.open("r+b") as file:
        file.seek(4096 * (pages // 2 if page is None else page))
        file.write(b"\x77" * 4096)


def test_a_backup_holds_every_step_that_was_committed_before_it(tmp_path):
    path = tmp_path / "play.db"
    with closing(Store(path)) as store:
        row, episode = open_episode(store, add_session(store), seed=4, config=SMALL)
        for number, move in enumerate(free_moves(episode)[:3]):
            add_steps(store, row, episode, [move])
            copy = tmp_path / f"copy-{number}.db"
            assert back_up(path, copy) == copy.stat().st_size
            assert steps_in(copy) == number + 1
        assert sorted(file.name for file in tmp_path.glob("copy*")) == [
            "copy-0.db",
            "copy-1.db",
            "copy-2.db",
        ]
    assert quick_check(tmp_path / "copy-2.db") == "ok"


def test_a_backup_is_of_one_moment_while_a_server_writes(tmp_path, monkeypatch):
    monkeypatch.setattr(backup, "PAGES", 1)
    path, copy = tmp_path / "play.db", tmp_path / "copy.db"
    with closing(Store(path)) as store:
        for seed in range(12):
            play(store, seed=seed)
        before = steps_in(path)
        seeds = iter(range(100, 10_000))
        back_up(
            path, copy, lambda done, total: play(store, seed=next(seeds)) if done < total else None
        )
        assert steps_in(path) > before
    assert steps_in(copy) == before


def test_a_backup_that_is_not_whole_gets_no_name(database, tmp_path):
    damage(database)
    with pytest.raises(StoreError, match="damaged"):
        back_up(database, tmp_path / "copy.db")
    assert not list(tmp_path.glob("copy*"))


def test_a_backup_overwrites_nothing_and_leaves_nothing_when_it_is_ended(database, tmp_path):
    with pytest.raises(StoreError, match="exists already"):
        back_up(database, database)

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        back_up(database, tmp_path / "copy.db", stop)
    assert not list(tmp_path.glob("copy*"))


LIMITED = """import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (8 * 4096, 8 * 4096))
from humanplay.cli.main import main
main(sys.argv[1:])
"""


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["backup", "copy.db"], "cannot copy play.db"),
        (["export", "--out", "copy"], "cannot write to copy, choose another --out: file too large"),
    ],
)
def test_a_full_disk_ends_a_backup_and_an_export_in_one_sentence(
    database, tmp_path, words, sentence
):
    with closing(Store(database)) as store:
        for seed in range(60):
            play(store, seed=seed, explore=True)
    (tmp_path / "copy").mkdir()
    # without -B Python would keep compiled modules that are cut off, and everything after it would read them
    command = [sys.executable, "-B", "-c", LIMITED, *words, "--database", "play.db"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith(f"humanplay: {sentence}")
    assert done.stderr.count("\n") == 1
    assert [*tmp_path.glob("copy*"), *tmp_path.glob("copy/*")] == [tmp_path / "copy"]


def test_the_last_backups_of_hours_days_and_weeks_stay_and_other_files_are_left_alone(
    database, tmp_path
):
    """Of three months' half hours there stay 12 hours', 7 days' and 4 weeks' backups.

    Some of these are the same.
    """
    folder = tmp_path / "backups"
    folder.mkdir()
    others = ["play-notes.db", "other-20200101T000000Z.db", "play-20200101T000000Z.db.notes"]
    last = datetime(2020, 4, 1, 23, 40, tzinfo=UTC)  # a Wednesday
    times = [last - timedelta(minutes=30 * number) for number in range(24 * 2 * 90)]
    names = [f"play-{time:%Y%m%dT%H%M%S}Z.db" for time in times]
    for name in [*others, *names]:
        (folder / name).write_bytes(b"")
    backups = Backups(database, folder, 60)
    newest = backups.make()
    hours = [f"play-20200401T{hour:02}4000Z.db" for hour in range(13, 24)]
    days = [f"play-202003{day}T234000Z.db" for day in range(27, 32)]
    weeks = ["play-20200322T234000Z.db", "play-20200329T234000Z.db"]  # Sundays
    assert [backup_file.name for backup_file in backups.existing()] == sorted(
        {*hours, *days, *weeks, newest.name}
    )
    assert all((folder / name).exists() for name in others)
    assert 0 <= backups.age_s() < 60


def test_what_a_killed_server_left_of_a_backup_is_deleted_with_the_next(database, tmp_path):
    folder = tmp_path / "backups"
    backups = Backups(database, folder, 60)
    back_up(database, folder / "play-20200101T000000Z.db")
    left = ["play-20200102T000000Z.db", "play-20200103T000000Z.db.partial"]
    others = [
        "play-20200101T000000Z.db",
        "other-20200102T000000Z.db.partial",
        "play.db",
        "play-mine.db",
    ]
    for name in (*left, *others):
        recordings_beside(folder / name).mkdir()
    for name in (left[1], f"{left[1]}-journal", others[1]):
        (folder / name).write_bytes(b"")
    newest = backups.make()
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        [others[0], others[1], newest.name, *(f"{name}-recordings" for name in others)]
    )


def test_a_backup_that_does_not_fit_is_refused_with_both_sizes_and_leaves_nothing(
    serve, database, tmp_path, monkeypatch, caplog
):
    monkeypatch.setattr(backup, "SPARE_BYTES", 2**60)
    reason = r"needs 1,152,\d{3},\d{3},\d{3},\d{3},\d{3} bytes .*, [\d,]+ are available: make room"
    with pytest.raises(StoreError, match=reason):
        back_up(database, tmp_path / "copy.db")
    assert not list(tmp_path.glob("copy*"))
    server = serve(backup_every=60, backup_to=tmp_path / "kept")
    eventually(lambda: re.search("no backup was made: .*" + reason, caplog.text))
    metrics = server.services.store.metrics.registry
    assert metrics.get_sample_value("humanplay_backup_failures") == 1
    assert list((tmp_path / "kept").iterdir()) == []


def test_a_backup_under_way_is_given_up_when_the_server_ends(database, tmp_path):
    backups = Backups(database, tmp_path / "backups", 60)
    backups._stopped.set()
    with pytest.raises(StoppedError):
        backups.make()
    assert backups.existing() == []


def test_a_server_makes_backups_by_itself_and_says_how_old_the_newest_is(serve, tmp_path):
    server = serve(backup_every=0.002, backup_to=tmp_path / "kept")
    client = server.client()
    begun = client.post("/api/sessions", json={"size": [9, 13], "seed": 5}).json()
    act = {"kind": "act", "episode": begun["frame"]["episode"], "step": 0, "action": "south"}
    client.post(f"/api/sessions/{begun['session']}/act", json=act).raise_for_status()

    def is_kept():
        for path in (tmp_path / "kept").glob("playground-*Z.db"):
            # the next backup may take its place meanwhile
            with (
                suppress(sqlite3.OperationalError),
                closing(sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)) as db,
            ):
                (steps,) = db.execute("SELECT count(*) FROM steps").fetchone()
                if steps == 1 and db.execute("PRAGMA quick_check").fetchone() == ("ok",):
                    return True
        return False

    eventually(is_kept)


def test_a_restored_backup_is_the_database_and_what_stood_there_stays(database, tmp_path):
    copy = tmp_path / "copy.db"
    back_up(database, copy)
    with closing(Store(database)) as store:
        play(store, seed=3)
        shutil.copytree(
            tmp_path, tmp_path / "crashed"
        )  # as a kill would leave it: the newest steps are in the log
    crashed = tmp_path / "crashed" / "play.db"
    after, before = steps_in(database), steps_in(copy)
    replaced = restore(copy, crashed, "now")
    assert steps_in(crashed) == before, (
        "the log of the former database must not meet the restored one"
    )
    assert replaced == crashed.with_name("play.db.before-now")
    assert steps_in(replaced) == after > before
    assert not verify_database(crashed).findings


def test_a_restoring_that_fails_leaves_the_database_and_its_recordings(database, tmp_path):
    copy = tmp_path / "copy.db"
    back_up(database, copy)
    recording = recordings_beside(database) / "Walk" / "0-0.bin"
    recording.parent.mkdir(parents=True)
    recording.write_bytes(b"a recording")
    note = lock_path(tmp_path / "play.db.before-now")
    note.symlink_to(tmp_path / "nowhere" / "note")  # it cannot be written
    before = database.read_bytes()
    with pytest.raises(StoreError, match="cannot restore"):
        restore(copy, database, "now")
    assert (database.read_bytes(), recording.read_bytes()) == (before, b"a recording")
    note.unlink()
    restore(copy, database, "later")
    assert not recording.exists()
    aside = recordings_beside(tmp_path / "play.db.before-later")
    assert (aside / "Walk" / "0-0.bin").read_bytes() == b"a recording"


def test_a_backup_is_restored_through_a_link_by_the_command(database, tmp_path, capsys):
    copy, link = tmp_path / "monday.db", tmp_path / "link.db"
    back_up(database, copy)
    link.symlink_to(database)
    code, _, error = command(capsys, "restore", copy, "--database", link, "--yes")
    assert code == 0, error
    assert link.is_symlink()
    assert not verify_database(link).findings
    (before,) = database.parent.glob(f"{database.name}.before-*Z")
    assert steps_in(before) == steps_in(database)


def test_the_log_of_a_database_that_was_lost_does_not_meet_the_restored_one(database, tmp_path):
    copy, crashed = tmp_path / "copy.db", tmp_path / "crashed" / "play.db"
    back_up(database, copy)
    with closing(Store(database)) as store:
        play(store, seed=3)
        store.connection.execute(
            "PRAGMA wal_checkpoint(RESTART)"
        )  # these pages were in the file that is lost
        play(store, seed=4)
        shutil.copytree(tmp_path, tmp_path / "crashed")
    crashed.unlink()
    left = crashed.with_name("play.db-wal").read_bytes()
    before = steps_in(copy)
    assert restore(copy, crashed, "now") is None
    assert steps_in(crashed) == before
    assert not verify_database(crashed).findings
    assert crashed.with_name("play.db.before-now-wal").read_bytes() == left


def test_a_backup_is_verified_before_it_replaces_anything_and_not_while_a_server_runs(
    database, tmp_path
):
    copy = tmp_path / "copy.db"
    back_up(database, copy)
    with closing(Store(database)), pytest.raises(StoreError, match="in use by another server"):
        restore(copy, database, "now")
    before = database.read_bytes()
    damage(copy)
    with pytest.raises(StoreError, match="damaged"):
        restore(copy, database, "now")
    with closing(sqlite3.connect(database)) as db:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    assert database.read_bytes() == before
    assert not list(tmp_path.glob("*before-now*"))
    for wrong, sentence in (
        (tmp_path / "none.db", "no backup at"),
        (database, "is the database itself"),
    ):
        with pytest.raises(StoreError, match=sentence):
            restore(wrong, database, "now")


HARM = {
    "trigger": "CREATE TRIGGER evil AFTER INSERT ON steps BEGIN DELETE FROM episodes; END",
    "view": "CREATE VIEW evil AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n",
}


@pytest.mark.parametrize(
    ("harm", "named"),
    [
        ("CREATE INDEX evil ON steps (abs(step))", "the index evil"),
        ("DROP TABLE forgotten; CREATE TABLE forgotten (trajectory_hash TEXT, forgotten_ms INTEGER)", "the table forgotten"),
        ("DROP TABLE forgotten", "no table forgotten"),
    ],
    ids=["index", "table", "missing"],
)  # fmt: skip
def test_a_file_whose_schema_could_act_is_opened_by_nothing(database, tmp_path, harm, named):
    """The schema is compared word for word before a read; a further table is harmless."""
    hostile = tmp_path / "hostile.db"
    back_up(database, hostile)
    with closing(sqlite3.connect(hostile)) as db:
        db.execute("CREATE TABLE theirs (a)")
    assert verify_database(hostile).findings == ()
    with closing(sqlite3.connect(hostile)) as db:
        db.executescript(harm)
    with pytest.raises(StoreError, match=f"holds {named}, which is not as"):
        Store(hostile)
    with pytest.raises(StoreError, match=f"holds {named}, which is not as"):
        verify_database(hostile)


OPENING = {
    "serve": "--database FILE --port 0",
    "play": "--no-browser --database FILE",
    "export": "--database FILE --out new",
    "agents new": "rooms --task mars --instances 1 --database FILE",
    "agents card": "rooms --author Ann --database FILE",
    "agents show": "--database FILE",
    "agents revoke": "rooms 7K3M --database FILE",
    "agents forget": "rooms 7K3M --yes --database FILE",
    "agents close": "rooms --yes --database FILE",
    "replay": "a1b2 --database FILE --out new.html",
    "study unlink": "closed --yes --database FILE",
    "study close": "open --yes --database FILE",
    "study freeze": "draft --underpowered --database FILE",
    "study invite": "open --list --database FILE",
    "study outcomes": "open left=Thanks --database FILE",
    "study payments": "open --database FILE",
    "study power": "draft --pilot open --database FILE",
    "report": "--study closed --database FILE",
    "costs": "--study closed --database FILE",
    "verify": "--database FILE",
    "release": "--study closed --out new --author Ada --database FILE",
    "import": "bundle --database FILE",
    "merge": "play.db FILE --out new.db",
    "forget": "ada --yes --database FILE",
    "backup": "new.db --database FILE",
    "restore": "FILE --yes --database play.db",
}
"""Each command that opens a database, and words with which it does."""


def commands(group, name=""):
    """Yield (name, command) of each command in a group."""
    context = click.Context(group)
    for part in group.list_commands(context):
        command = group.get_command(context, part)
        if isinstance(command, click.Group):
            yield from commands(command, f"{name}{part} ")
        else:
            yield name + part, command


def test_every_command_refuses_a_trigger_a_view_and_a_pipe_at_once(database, tmp_path, monkeypatch):
    opening = {
        name
        for name, command in commands(cli)
        if {"database", "databases", "backup"} & {option.name for option in command.params}
    }
    assert opening == OPENING.keys()
    monkeypatch.chdir(tmp_path)
    studies = Folder("study.db-studies")
    freeze(studies.root, "open", close=False)
    play_study(tmp_path / "study.db", freeze(studies.root, "closed"))
    studies.create(default_protocol("draft", CONFIG, policies=(), declarations=DECLARATIONS))

    def run(name, words):
        answers = "a long password\n" * 2
        return CliRunner().invoke(cli, [*name.split(), *words.split()], input=answers)

    bundled = "--study closed --out bundle --author Ada --database study.db"
    assert run("release", bundled).exit_code == 0
    for kind, harm in HARM.items():
        back_up(database, tmp_path / f"{kind}.db")
        with closing(sqlite3.connect(f"{kind}.db")) as db:
            db.executescript(harm)
    os.mkfifo("pipe.db")
    for kind in (*HARM, "pipe"):
        shutil.copytree(studies.root, f"{kind}.db-studies")
    before = {path.name for path in tmp_path.iterdir()}
    for kind in (*HARM, "pipe"):
        refused = f"{kind}.db holds the {kind} evil|must be a file, pipe.db is|no backup at pipe.db"
        for name, words in OPENING.items():
            done = run(name, words.replace("FILE", f"{kind}.db"))
            assert done.exit_code == 1, (name, done.output)
            assert re.search(refused, done.output), (name, done.output)
    new_files = {path.name for path in tmp_path.iterdir()} - before
    assert {name for name in new_files if not name.endswith("-lock")} == set()
    assert verify_database(database).findings == ()


def leaf_pages(path, table):
    """Return a table's leaf pages in their order, as SQLite's shell names them."""
    sql = f"SELECT pageno FROM dbstat WHERE name = '{table}' AND pagetype = 'leaf' ORDER BY path"
    return [int(number) for number in run_sqlite(path, sql).split()]


def run_sqlite(path, command, text=None):
    """Return what SQLite's shell prints on a database; skip if no shell can do it."""
    shell = shutil.which("sqlite3")
    if shell is None:
        pytest.skip("sqlite3 is not installed: no damaged file is read out here")
    words = [shell, str(path), *([command] if command else [])]
    done = subprocess.run(words, input=text, capture_output=True, text=True, timeout=60)
    if (
        done.returncode and "logic error" in done.stderr
    ) or "no such table: sqlite_dbpage" in done.stderr:
        pytest.skip(
            "this sqlite3 was built without .recover, as that of Debian 12: no damaged file is read out here"
        )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_sqlite_reads_out_a_damaged_file_and_verify_names_what_is_missing(tmp_path):
    path, new = tmp_path / "play.db", tmp_path / "new.db"
    with closing(Store(path)) as store:
        played = [play(store, seed=seed, explore=True).id for seed in range(60)]
    pages = leaf_pages(path, "steps")
    run_sqlite(new, None, run_sqlite(path, ".recover"))
    assert verify_database(new).findings == (), "a whole file comes out as it is"
    new.unlink()
    damage(path, pages[len(pages) // 2] - 1)
    assert quick_check(path) != "ok"
    run_sqlite(new, None, run_sqlite(path, ".recover"))
    assert quick_check(new) == "ok"
    verification = verify_database(new)
    harmed = {finding.where.removeprefix("episode ") for finding in verification.findings}
    assert verification.episodes == 60
    assert harmed <= set(played)
    assert 0 < len(harmed) <= 60 * 2 / len(pages)
    with closing(Store(new)) as store:
        play(store, seed=5_000)


def test_the_commands_say_what_they_did(database, tmp_path, capsys):
    arguments = tmp_path / "b.db", "--database", database
    code, output, _ = command(capsys, "backup", *arguments)
    assert (code, "verified" in output) == (0, True)
    code, output, _ = command(capsys, "restore", *arguments, "--yes")
    assert (code, f"what stood there is {database}.before-" in output) == (0, True)


@pytest.mark.long
def test_a_restore_drill(spawn, tmp_path):
    """Play, back up, kill, lose the database, restore the newest backup, verify."""
    path, folder = tmp_path / "playground.db", tmp_path / "kept"
    server = spawn(backup_every=0.02, backup_to=str(folder))
    client, stop, acknowledged = server.client(), threading.Event(), []

    def keep_playing():
        while not stop.is_set():
            begun = client.post("/api/sessions", json={"size": [9, 13]}).json()
            for step in range(20):
                act = {
                    "kind": "act",
                    "episode": begun["frame"]["episode"],
                    "step": step,
                    "action": ("south", "north")[step % 2],
                }
                answer = client.post(f"/api/sessions/{begun['session']}/act", json=act)
                if answer.status_code != 200 or answer.json()["outcome"]:
                    break
                acknowledged.append((time.time(), act["episode"], step, begun["session"]))
                time.sleep(0.01)

    player = threading.Thread(target=keep_playing)
    player.start()
    time.sleep(8)
    stop.set()
    player.join()
    server.kill()
    os.unlink(path)  # noqa: PTH108
    newest = sorted(folder.glob("playground-*Z.db"))[-1]
    stamp = newest.stem.removeprefix("playground-")  # of its beginning, in whole seconds
    made_at = datetime.strptime(stamp, "%Y%m%dT%H%M%S%z").timestamp()
    command = [
        sys.executable,
        "-m",
        "humanplay.cli",
        "restore",
        str(newest),
        "--database",
        str(path),
        "--yes",
    ]
    subprocess.run(command, check=True)
    with closing(sqlite3.connect(path)) as db:
        there = {tuple(row) for row in db.execute("SELECT episode_id, step FROM steps")}
    before = [move for move in acknowledged if move[0] < made_at]
    assert len(before) > 100
    assert all((episode, step) in there for _, episode, step, _ in before)
    assert not verify_database(path).findings
    server = spawn()
    frame = server.client().get(f"/api/sessions/{before[-1][3]}").json()
    assert frame["step"] > before[-1][2], json.dumps(frame)
    server.close()
    made_moves, stored_moves, due = len(acknowledged), len(there), len(before)
    print(
        f"\n{made_moves} moves acknowledged, {stored_moves} in the newest backup, all {due} that were made before it was begun"
    )
