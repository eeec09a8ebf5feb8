"""An environment that cannot be made again is stepped by its program."""

import shutil
import sqlite3
import time
from contextlib import contextmanager

import pytest

from humanplay import play
from humanplay.cli.pilot.errors import PilotError
from humanplay.cli.pilot.plays import Plays
from humanplay.task.registration import environment_of
from tests.app.tasks.test_gymnasium import begin
from tests.app.tasks.test_gymnasium import play as play_out
from tests.support.command import command
from tests.support.forked_server import Program
from tests.support.recorded import ask
from tests.support.stepped_in_place import Walk, WalkingProgram

RIGHT = ("right",)


@pytest.fixture
def program(tmp_path):
    """`program(...)` begins one in the test's folder, forked if it need not be fresh."""
    with programs_in(tmp_path) as start:
        yield start


@contextmanager
def programs_in(folder):
    """Yield what begins programs in a folder, or in another one; end them all."""
    programs = []

    def start(then="", options=None, folder=folder, **arguments):
        programs.append(WalkingProgram(folder, then, options, **arguments))
        return programs[-1]

    try:
        yield start
    finally:
        for running in programs:
            running.close()
            running.forget_page()


def visitor(server, name="Ada"):
    """A person with a name."""
    client = server.page()
    client.put("/api/me/name", json={"name": name}).raise_for_status()
    return client


def move(server, client, session, action="right"):
    """Make one move of a board, and return the frame after it."""
    with server.socket(session, client) as socket:
        frame = socket.receive("frame")
        socket.act(frame, action, input="key")
        return socket.frame_after(frame["step"])


def killed_after_a_move(program, **arguments):
    """Ada's episode whose program was killed: its server, her, and the board."""
    running = program(goal=3, **arguments)
    server = running.opened()
    ada = visitor(server)
    begun = begin(server, ada, player="human")
    assert move(server, ada, begun["session"])["step"] == 1
    running.close()
    return server, ada, begun


def plays_in(folder, name="plays.db"):
    ((task,),) = ask(folder / name, "SELECT DISTINCT task FROM episodes")
    return Plays(folder / name, task)


def walk(program, folder, name="Ada"):
    """Let somebody walk once in a folder."""
    running = program(folder=folder)
    server = running.opened()
    client = visitor(server, name)
    play_out(server, client, begin(server, client, player="human"), RIGHT)
    running.interrupt()
    running.ended()


def recorded(folder, name="plays.db"):
    return sorted(folder.glob(f"{name}-recordings/*/*.bin"))


@pytest.fixture(scope="module")
def walks_on_a_seed(tmp_path_factory):
    """A folder with Ada's walk, which went on after a kill, and Bob's on its seed."""
    folder = tmp_path_factory.mktemp("walks")
    with programs_in(folder) as program:
        server, ada, begun = killed_after_a_move(program)
        running = program(goal=3, options={"port": server.port})
        running.opened()
        first = play_out(server, ada, begun, RIGHT)[-1]
        bob = visitor(server, "Bob")
        taken_up = begin(server, bob, player="human", challenges=first["episode"])
        play_out(server, bob, taken_up, ("left", *RIGHT * 4))
        running.interrupt()
        running.ended()
    return folder


@pytest.fixture
def two_on_a_seed(walks_on_a_seed, tmp_path):
    """A copy of both walks, in the test's folder."""
    shutil.copytree(walks_on_a_seed, tmp_path, dirs_exist_ok=True)
    assert len(recorded(tmp_path)) == 3
    return tmp_path


def test_it_is_played_in_the_calling_thread_until_ctrl_c(program, tmp_path):
    running = program(then="print(score(plays)); print(plays)", is_fresh=True)
    server = running.opened()
    client = visitor(server)
    frames = play_out(server, client, begin(server, client, player="human"), RIGHT)
    assert [frame["score"] for frame in frames] == [0, -0.25, -0.5]
    assert frames[-1]["outcome"] == "ended"
    again = client.get(f"/api/watch/{frames[-1]['episode']}").json()
    assert [frame["picture"] for frame in again["frames"]] == [frame["picture"] for frame in frames]
    assert "random" not in client.get("/").text
    running.interrupt()
    printed = running.ended()
    assert "Walk was not made by gymnasium.make" in printed
    assert "So this program steps it itself, on one board." in printed
    assert "people −0.50, 1 person" in printed
    assert "not verified, and nothing beside it" in printed
    assert "plays of Walk" in printed


def test_its_plays_are_shown_and_exported_and_never_verified(
    program, tmp_path, monkeypatch, capsys
):
    minari = pytest.importorskip("minari")
    parquet = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    running = program()
    server = running.opened()
    client = visitor(server)
    play_out(server, client, begin(server, client, player="human"), RIGHT)
    running.interrupt()
    running.ended()
    plays = plays_in(tmp_path)
    (finding,) = plays.verify()
    assert "nothing that steps it again: it is not verified" in finding
    assert "1 of them" in plays.to_parquet(tmp_path / "tables")
    rows = parquet.read_table(tmp_path / "tables" / "episodes.parquet").to_pylist()
    assert [row["verified"] for row in rows] == [False]
    assert plays.to_minari("walk/people-v0") == "1 episode in the dataset walk/people-v0"
    (episode,) = minari.load_dataset("walk/people-v0").iterate_episodes()
    assert episode.actions.tolist() == [4, 4], "the environment's own"
    assert episode.observations[:, 0].tolist() == [0, 1, 2]
    page = plays.replay(out=tmp_path / "replay.html").read_text()
    assert page.startswith("<!doctype html>")
    code, text, _ = command(capsys, "verify", "--database", plays.database)
    assert code != 0
    assert "it is not verified" in text
    code, _, error = command(
        capsys, "study", "new", "walk", "--env", plays.task.partition(":")[2],
        "--database", tmp_path / "studies.db",
    )  # fmt: skip
    assert code != 0
    assert "move what makes it into a module" in error
    assert len(list(tmp_path.glob("plays.db-recordings/*/*.bin"))) == 1
    forget = ("forget", "Ada", "--player", "--yes", "--database", plays.database)
    assert command(capsys, *forget)[0] == 0
    assert not list(tmp_path.glob("plays.db-recordings/*/*.bin"))


def test_a_backup_takes_the_recordings_along_and_restoring_brings_them_back(
    program, tmp_path, capsys
):
    walk(program, tmp_path)
    (away := tmp_path / "away").mkdir()
    before = [path.read_bytes() for path in recorded(tmp_path)]
    options = ("--database", tmp_path / "plays.db")
    _, text, _ = command(capsys, "backup", away / "monday.db", *options)
    assert f"the recordings are in {away / 'monday.db-recordings'}" in text
    assert plays_in(away, "monday.db").replay(out=tmp_path / "replay.html").is_file()
    walk(program, tmp_path, "Bob")
    assert command(capsys, "restore", away / "monday.db", "--yes", *options)[0] == 0
    assert [path.read_bytes() for path in recorded(tmp_path)] == before
    (aside,) = tmp_path.glob("plays.db.before-*-recordings")
    assert len(list(aside.glob("*/*.bin"))) == 2, "nothing is deleted"
    assert command(capsys, "backup", away / "monday.db", *options)[0] != 0
    (away / "monday.db").unlink()
    _, _, error = command(capsys, "backup", away / "monday.db", *options)
    assert "monday.db-recordings exists already" in error


def test_a_merge_takes_the_recordings_of_all_along_once(program, tmp_path, capsys):
    walk(program, tmp_path)
    for name in ("berlin", "athens"):
        (tmp_path / name).mkdir()
        walk(program, tmp_path / name)
    sources = [tmp_path / name / "plays.db" for name in ("", "berlin", "athens")]
    assert command(capsys, "backup", tmp_path / "copy.db", "--database", sources[0])[0] == 0
    out = ("--out", tmp_path / "all.db")
    assert command(capsys, "merge", *sources, tmp_path / "copy.db", *out)[0] == 0
    plays = plays_in(tmp_path, "all.db")
    assert all("it is not verified" in finding for finding in plays.verify())
    for number in range(3):
        plays.replay(number, tmp_path / "replay.html")
    assert len(recorded(tmp_path, "all.db")) == 3
    assert "all.db-recordings is there already" in _refused_merge(capsys, tmp_path, sources)


def _refused_merge(capsys, folder, sources):
    (folder / "all.db").unlink()
    return command(capsys, "merge", *sources, "--out", folder / "all.db")[2]


def test_who_is_erased_takes_each_of_their_recordings_along_and_no_other(two_on_a_seed, capsys):
    options = ("--database", two_on_a_seed / "plays.db")
    assert command(capsys, "forget", "Ada", "--player", "--yes", *options)[0] == 0
    assert len(recorded(two_on_a_seed)) == 1
    (finding,) = plays_in(two_on_a_seed).verify()
    assert "it is not verified" in finding, "Bob's recording is there"


def _has(path, text):
    return path.is_file() and text in path.read_bytes()


KILLED = """
import os, sys
from humanplay.db import erasure
from humanplay.cli.main import main
erasure.{name} = lambda *arguments: os._exit(9)
main(sys.argv[1:])
"""


@pytest.mark.parametrize(
    ("killed_in", "left"), [("mark_for_deletion", 2), ("delete_marked", 1), ("_write_anew", 1)]
)
def test_an_erasure_that_is_killed_keeps_all_recordings_or_is_ended_by_the_next(
    two_on_a_seed, capsys, killed_in, left
):
    forget = ("forget", "Ada", "--player", "--yes", "--database", two_on_a_seed / "plays.db")
    reader = sqlite3.connect(two_on_a_seed / "plays.db")  # while it is open the log stays
    reader.execute("SELECT count(*) FROM meta").fetchone()
    (two_on_a_seed / "killed.py").write_text(KILLED.format(name=killed_in))
    killed = Program(two_on_a_seed, "killed.py", *forget)
    killed.printed()
    assert killed.returncode == 9
    assert ask(two_on_a_seed / "plays.db", "SELECT count(*) FROM episodes") == [(left,)]
    assert len(recorded(two_on_a_seed)) == (1 if killed_in == "_write_anew" else 3)
    text = "".join(command(capsys, *forget)[1:])
    assert ("no player" if left == 1 else "1 episode") in text
    assert len(recorded(two_on_a_seed)) == 1
    assert not [path for path in two_on_a_seed.glob("plays.db*") if _has(path, b"Ada")]
    reader.close()


def test_a_killed_program_goes_on_with_the_same_episode(program, tmp_path):
    server, client, begun = killed_after_a_move(program)
    running = program(goal=3, options={"port": server.port})
    running.opened()
    frames = play_out(server, client, begun, RIGHT)
    assert [frame["step"] for frame in frames] == [1, 2, 3]
    assert frames[-1]["outcome"] == "ended"


def test_an_episode_that_would_be_another_one_does_not_go_on(program, tmp_path):
    server, client, begun = killed_after_a_move(program, wanders=True)
    running = program(goal=3, wanders=True, options={"port": server.port})
    running.opened()
    answer = client.get(f"/api/sessions/{begun['session']}")
    assert answer.status_code == 404
    assert "it is another one after 1 move" in answer.text
    other = begin(server, client, player="human")
    assert play_out(server, client, other, RIGHT)[-1]["outcome"] == "ended"


def test_each_of_two_episodes_on_a_seed_has_its_own_recording(program, tmp_path):
    running = program(wanders=True)
    server = running.opened()
    client = visitor(server)
    first = play_out(server, client, begin(server, client, player="human"), RIGHT)[-1]
    again = {"player": "human", "challenges": first["episode"]}
    second = play_out(server, client, begin(server, client, **again), RIGHT)[-1]
    running.interrupt()
    running.ended()
    ((seeds, hashes),) = ask(
        tmp_path / "plays.db", "SELECT count(DISTINCT seed), count(DISTINCT trajectory_hash) FROM episodes"
    )  # fmt: skip
    assert (seeds, hashes, second["outcome"]) == (1, 2, "ended")
    findings = plays_in(tmp_path).verify()
    assert len(findings) == 2
    assert all("it is not verified" in finding for finding in findings)
    assert not any("hash" in finding for finding in findings)


def test_an_episode_whose_recording_is_gone_does_not_go_on(program, tmp_path):
    server, client, begun = killed_after_a_move(program)
    for path in tmp_path.glob("plays.db-recordings/*/*.bin"):
        path.unlink()
    running = program(goal=3, options={"port": server.port})
    running.opened()
    answer = client.get(f"/api/sessions/{begun['session']}")
    assert "no recording of it is beside the database" in answer.text


def test_who_begins_has_the_board_and_a_taken_one_is_made_again(program):
    running = program(goal=3)
    server = running.opened()
    client = visitor(server)
    first = begin(server, client, player="human")
    move(server, client, first["session"])
    stranger = server.page()
    stranger.put("/api/me/name", json={"name": "Bob"}).raise_for_status()
    second = begin(server, stranger, player="human")
    move(server, stranger, second["session"])
    assert play_out(server, client, first, RIGHT)[-1]["step"] == 3


def test_ctrl_c_waits_for_a_step_and_a_second_one_does_not(program, tmp_path):
    running = program(step_s=1000)
    server = running.opened()
    client = visitor(server)
    begun = begin(server, client, player="human")
    with server.socket(begun["session"], client) as socket:
        socket.act(socket.receive("frame"), "right", input="key")
        running.until("stepping")
        running.interrupt()
        running.until("Ending after this step; Ctrl-C again ends it at once.")
        assert running.process.poll() is None
        began = time.monotonic()
        running.interrupt()
        running.ended()
    assert time.monotonic() - began < 15
    assert ask(tmp_path / "plays.db", "SELECT outcome, steps FROM episodes") == [(None, None)]


def test_ctrl_c_ends_after_a_short_step(program, tmp_path):
    running = program(step_s=3)
    server = running.opened()
    client = visitor(server)
    begun = begin(server, client, player="human")
    with server.socket(begun["session"], client) as socket:
        socket.act(socket.receive("frame"), "right", input="key")
        running.until("stepping")
        running.interrupt()
        printed = running.ended()
    assert printed.index("stepped") < printed.index("the call has returned")
    assert ask(tmp_path / "plays.db", "SELECT outcome FROM episodes") == [(None,)]


def test_what_it_raises_reaches_the_author(program):
    running = program(fails_at=1)
    server = running.opened()
    client = visitor(server)
    begun = begin(server, client, player="human")
    with server.socket(begun["session"], client) as socket:
        socket.act(socket.receive("frame"), "right", input="key")
        running.until("the cell burns")
        assert socket.receive("frame")["outcome"] == "environment_failed"
    running.interrupt()
    assert "Traceback" in running.ended()


def test_without_room_the_figures_alone_are_recorded(program, tmp_path):
    running = program(options={"keep_mb": 0})
    server = running.opened()
    client = visitor(server)
    for _ in range(2):
        play_out(server, client, begin(server, client, player="human"), RIGHT)
    running.interrupt()
    assert running.ended().count("The recordings have reached keep_mb") == 1
    plays = plays_in(tmp_path)
    assert len(plays.verify()) == 2
    with pytest.raises(ValueError, match="its pictures were not recorded"):
        plays.replay(out=tmp_path / "replay.html")


class Blind(Walk):
    """Draws nothing."""

    def render(self):
        return None


@pytest.mark.parametrize(
    ("env", "options", "text"),
    [
        (Walk(), {"wait": False}, r"`people` and `wait` out, or write play\(lambda: Walk\("),
        (Walk(), {"people": 2}, r"one board, while the call lasts.*play\(lambda: Walk\("),
        (
            Blind(),
            {},
            r"in place it cannot be played: render returned nothing.*play\(lambda: Blind",
        ),
    ],
)
def test_what_cannot_be_stepped_in_place_is_refused_with_the_line_to_write(
    tmp_path, env, options, text
):
    with pytest.raises(PilotError, match=text):
        play(env, database=tmp_path / "plays.db", browser=False, **options)


def test_a_task_in_place_does_not_depend_on_the_object():
    from humanplay.cli.pilot.in_place import in_place_task

    task = in_place_task(Walk())
    assert in_place_task(Walk(goal=9)) == task
    assert environment_of(task).actions == ("left", "right")
    assert not environment_of(task).policies.offers()
