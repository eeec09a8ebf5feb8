"""A board's environment in a process of its own: a failure ends that board alone."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from humanplay.study.verification import verify_database
from humanplay.task import Choice, RunEndedError
from humanplay.tasks import processes
from humanplay.tasks.gymnasium.description import Description
from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment
from humanplay.tasks.gymnasium.run import GymnasiumRun
from humanplay.tasks.gymnasium.task import GymnasiumTask
from humanplay.tasks.processes import NO_NETWORK, NO_OTHER_FILES
from tests.support.servers import eventually

FAILING = "tests.support.environments:Failing-v0"
WAYS = {
    "exit": "its process ended by itself",
    "raise": "KeyError: 'no such room'",
    "sleep": "it gave no answer in 1 s",
    "memory": "MB of memory, of at most",
    "nan": "its return is nan, which is no finite number",
    "-inf": "its return is -inf, which is no finite number",
}
BACK, FORWARD, WAVE = 0, 1, 2


def failing(how):
    return Description(id=FAILING, kwargs={"how": how}, max_steps=5000).told


@pytest.fixture(scope="module")
def lake():
    task = GymnasiumTask("FrozenLake-v1")
    yield task
    task.close()


@pytest.fixture(scope="module")
def broken():
    task = GymnasiumTask(failing("crash"))
    yield task
    task.close()


def begun(task, how, once=""):
    """A run of the task `broken` that fails so."""
    return task.begin(Choice(task.configuration({"kwargs": {"how": how, "once": once}}), 1))


def test_a_run_elsewhere_comes_to_what_a_run_here_comes_to(lake):
    here = GymnasiumRun(lake.default, 7)
    here.is_live = True  # its pictures are packed as a board's are
    there = lake.begin(Choice(lake.default, 7))
    while here.outcome == "running":
        assert there.view().frame("e") == here.view().frame("e")
        action = len(here.actions) % 3
        assert there.step(action) == here.step(action)
    assert there.record() == here.record()
    assert there.view().history("e") == here.view().history("e")
    again = lake.run(lake.default, 7, bytes(here.actions))
    assert (again.record(), again.rewards()) == (here.record(), here.rewards())


def test_what_fails_once_is_made_again(broken):
    run = begun(broken, "crash", "failed")  # a file in the folder of its process
    for action in (FORWARD, FORWARD, WAVE, FORWARD):
        run.step(action)
    assert (broken._boards.preparer.folder / "failed").exists()
    assert (run.outcome, bytes(run.actions)) == ("running", bytes([1, 1, 2, 1]))


@pytest.mark.parametrize("how", WAYS)
def test_what_fails_twice_ends_the_episode(broken, how, monkeypatch):
    monkeypatch.setattr(processes, "WAIT_S", 1 if how == "sleep" else 30)
    run = begun(broken, how)
    run.step(FORWARD)
    before = run.view().frame("e")
    with pytest.raises(RunEndedError, match=WAYS[how]):
        run.step(WAVE)
    assert (run.outcome, bytes(run.actions), len(run.rewards())) == ("environment_failed", b"\1", 1)
    shown = json.loads(run.view().frame("e"))
    assert shown == json.loads(before) | {"outcome": "environment_failed"}


def test_the_process_of_a_board_that_has_ended_ends_also_when_it_is_resumed(lake):
    run = GymnasiumEnvironment("FrozenLake-v1").run(lake.default, 7)
    while run.outcome == "running":
        run.step(len(run.actions) % 3)
    again = lake.run(lake.default, 7, bytes(run.actions))
    assert again.outcome == run.outcome
    eventually(lambda: not alive(again._board.pid))


def test_a_board_ends_with_its_run_and_all_end_with_the_server():
    code = (
        "import sys, time; from humanplay.task import Choice; from humanplay.tasks.gymnasium.task import GymnasiumTask\n"
        "task = GymnasiumTask('FrozenLake-v1'); runs = [task.begin(Choice(task.default, 1)) for _ in range(2)]\n"
        "print(*(run._board.pid for run in runs), flush=True); sys.stdin.readline(); runs.pop()\n"
        "print('dropped', flush=True); time.sleep(1e6)"
    )
    command = [sys.executable, "-c", code]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as server:
        remaining, dropped = map(int, server.stdout.readline().split())
        try:
            assert alive(remaining)
            assert alive(dropped)
            server.stdin.write("\n")
            server.stdin.flush()
            assert server.stdout.readline() == "dropped\n"
            eventually(lambda: not alive(dropped))
            assert alive(remaining)
        finally:
            server.kill()
        eventually(lambda: not alive(remaining))


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.usefixtures("executed_preparers")
def test_its_process_holds_nothing_of_the_server_s(monkeypatch, tmp_path):
    monkeypatch.setenv("HUMANPLAY_ADMIN_PASSWORD", "red-planet-4")
    secret = (tmp_path / "secret").open("w")
    os.set_inheritable(secret.fileno(), True)
    task = GymnasiumTask("FrozenLake-v1")
    run = task.begin(Choice(task.default, 1))
    process = Path(f"/proc/{run._board.pid}")
    assert b"HUMANPLAY_ADMIN_PASSWORD" not in (process / "environ").read_bytes()
    opened = [str(path.readlink()) for path in (process / "fd").iterdir()]
    assert [path for path in opened if "secret" in path or ".db" in path] == []
    assert len(list((process / "task").iterdir())) == 1, "it has started no threads"
    loaded = (process / "maps").read_text()
    assert [name for name in ("torch", "numba", "llvmlite") if name in loaded] == []
    secret.close()
    task.close()


@pytest.mark.usefixtures("executed_preparers")
def test_a_board_reads_no_database_and_reaches_no_port(serve, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        kwargs = {"path": str(tmp_path / "playground.db"), "port": other.getsockname()[1]}
        text = Description(id="tests.support.environments:Nosy-v0", kwargs=kwargs).told
        here = GymnasiumEnvironment(text)
        task = serve(task=f"gymnasium:{text}").app.state.services.lobby.task
        confined = task._boards.preparer.guards()
        if confined[NO_NETWORK] or confined[NO_OTHER_FILES]:
            pytest.skip(task.guards())
        assert here.run(here.default, 1).view().text == "done, done", "without a guard it does"
        run = task.begin(Choice(task.default, 1))
        assert "done" not in run.view().text


def test_a_task_s_process_that_is_gone_is_started_again(lake):
    first = lake.begin(Choice(lake.default, 1))
    lake._boards.preparer._process.send_signal(signal.SIGKILL)
    eventually(lambda: not alive(first._board.pid))
    second = lake.begin(Choice(lake.default, 1))
    assert second.view().frame("e") == first.view().frame("e")
    assert first.step(0) == second.step(0), "its board is made again"


def test_no_board_begins_where_all_take_too_much_memory(serve, monkeypatch):
    server = serve(task="gymnasium:FrozenLake-v1")
    client = server.page()
    assert client.post("/api/sessions", json={}).status_code == 201
    task = server.app.state.services.lobby.task
    board = task.begin(Choice(task.default, 1))
    task._boards._most = -1
    board._board.connection.close()
    assert board.step(0) is not None, "what runs goes on, and is made again"
    answer = server.page().post("/api/sessions", json={})
    assert (answer.status_code, "MB of memory" in answer.text) == (503, True)


def test_boards_that_do_not_begin_keep_nobody_else_waiting(serve, monkeypatch):
    """As many of them as the event loop has threads of its own, and more."""
    monkeypatch.setattr(processes, "WAIT_S", 20)
    server = serve(task="gymnasium:tests.support.environments:Sleeper-v0")

    def begin(_):
        return server.page().post("/api/sessions", json={"seed": 7})

    with ThreadPoolExecutor(40) as people:
        answers = [people.submit(begin, number) for number in range(40)]
        time.sleep(1)
        assert server.page().post("/api/sessions", json={"seed": 1}).status_code == 201
        assert not any(answer.done() for answer in answers)
        refused = [answer.result() for answer in answers]
    assert [answer.status_code for answer in refused] == [422] * 40
    assert "it gave no answer in 20 s" in refused[0].text


def test_an_episode_that_its_environment_ended_is_kept_shown_and_verified(serve, tmp_path):
    server = serve(task=f"gymnasium:{failing('crash')}")
    client = server.page()
    begun = client.post("/api/sessions", json={}).json()
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        socket.act(frame, "forward")
        frame = socket.frame_after(frame["step"])
        socket.act(frame, "wave")
        assert "failed at this move, and again" in socket.receive("refused")["reason"]
    ended = client.get(f"/api/sessions/{begun['session']}").json()
    assert (ended["step"], ended["outcome"]) == (1, "environment_failed")
    shown = client.get(f"/api/episodes/{ended['episode']}").json()
    assert (shown["outcome"], shown["score"]) == ("environment_failed", -1.0)
    assert (
        client.get(f"/api/watch/{ended['episode']}").json()["frames"][-1]["outcome"]
        == "environment_failed"
    )
    again = client.post(f"/api/sessions/{begun['session']}/episodes", json={})
    assert again.status_code == 201, again.text
    server.stop()
    assert verify_database(tmp_path / "playground.db").findings == ()


def test_a_page_is_told_how_far_its_lost_environment_has_been_made_again(serve):
    kwargs = {"how": "crash", "once": "failed", "step_s": 0.1}
    text = Description(id=FAILING, kwargs=kwargs, max_steps=5000).told
    server = serve(task=f"gymnasium:{text}")
    client = server.page()
    begun = client.post("/api/sessions", json={}).json()
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        for action in ("forward", "back", "forward", "wave"):
            socket.act(frame, action)
            if action == "wave":
                remade = socket.receive("remade")
            frame = socket.frame_after(frame["step"])
    assert (remade["episode"], remade["of"]) == (frame["episode"], 3)
    assert remade["done"] in (1, 2, 3), "it says so no more often than each PROGRESS_S"
    assert (frame["step"], frame["outcome"]) == (4, None)
    assert server.app.state.services.lobby.in_memory(begun["session"]).remade is None


def test_others_play_on_while_a_board_fails(serve):
    """The failing board takes 2 s twice; others must not wait for it."""
    server = serve(task=f"gymnasium:{failing('loop')}")
    other, fails, failed, reasons = server.page(), threading.Event(), threading.Event(), []

    def fail():
        client = server.page()
        begun = client.post("/api/sessions", json={}).json()
        with server.socket(begun["session"], client) as socket:
            socket.act(socket.receive("frame"), "wave")
            fails.set()
            reasons.append(socket.receive("refused")["reason"])
        failed.set()

    begun = other.post("/api/sessions", json={}).json()
    thread = threading.Thread(target=fail)
    thread.start()
    meanwhile = 0
    with server.socket(begun["session"], other) as socket:
        frame = socket.receive("frame")
        while not failed.is_set():
            socket.act(frame, ("back", "forward")[frame["step"] % 2])
            frame = socket.frame_after(frame["step"])
            meanwhile += fails.is_set()
            time.sleep(0.005)
    thread.join()
    assert meanwhile > 20
    assert "after 2 s of processor" in reasons[0]
