"""Worker processes: their guards are on where the system permits it."""

import json
import os
import pwd
import re
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from humanplay.tasks import processes
from humanplay.tasks.processes import (
    NO_NETWORK,
    NO_OTHER_FILES,
    OTHER_USER,
    LostError,
    Preparer,
    guards_of,
)

pytestmark = pytest.mark.usefixtures("executed_preparers")
CONFINED = "tests.support.confined"


@pytest.fixture
def begun(tmp_path):
    preparers = []

    def begin(argument="ready", **further):
        preparers.append(Preparer(CONFINED, argument, **further))
        guards = preparers[-1].guards()
        worker = preparers[-1].begin({"steps": 3})
        assert worker.answer() == argument
        return guards, worker, preparers[-1]

    yield begin
    for preparer in preparers:
        preparer.close()


def needs(guards, name):
    if guards[name]:
        pytest.skip(f"{name} is not on here: {guards[name]}")


def test_it_reads_neither_the_database_nor_what_lies_beside_it_nor_writes(begun, tmp_path):
    """The database lies beside its packages, as in a checkout, readable by anybody."""
    beside = Path(__file__).parents[3] / "tests" / "new.txt"
    hidden = tmp_path / "playground.db"
    guards, worker, preparer = begun(readable=[tmp_path], hidden=[hidden])
    needs(guards, NO_OTHER_FILES)
    for path in (hidden, tmp_path / "playground.db-wal", tmp_path / "later.txt"):
        path.write_text("secret")
        assert worker.ask(["read", str(path)]).startswith("PermissionError"), path
    assert worker.ask(["write", str(tmp_path / "new")]).startswith("PermissionError")
    assert worker.ask(["write", str(beside)]).startswith("PermissionError")
    assert worker.ask(["write", "/dev/null"]) == "1"
    with tempfile.NamedTemporaryFile("w", dir="/dev/shm") as shared:
        assert worker.ask(["read", shared.name]).startswith("PermissionError")
    assert worker.ask(["write", str(preparer.folder / "own")]) == "1"
    assert worker.ask(["read", __file__]).startswith('"""Worker processes'), "its packages it reads"


def test_what_is_made_before_it_and_not_hidden_is_read(begun, tmp_path):
    (tmp_path / "policy.onnx").write_text("weights")
    (tmp_path / "playground.db").write_text("secret")
    _, worker, _ = begun(readable=[tmp_path], hidden=[tmp_path / "playground.db"])
    assert worker.ask(["read", str(tmp_path / "policy.onnx")]) == "weights"


def test_it_reaches_no_network(begun):
    with socket.create_server(("127.0.0.1", 0)) as server:
        guards, worker, _ = begun()
        needs(guards, NO_NETWORK)
        port = server.getsockname()[1]
        assert "Error" in worker.ask(["connect", port])
        assert "Error" in worker.ask(["send", port])


def test_it_ends_nobody_else(begun):
    guards, worker, _ = begun()
    needs(guards, NO_OTHER_FILES)
    with subprocess.Popen(["sleep", "60"]) as other:
        assert worker.ask(["end", other.pid]).startswith("PermissionError")
        other.kill()


def test_it_has_none_of_root_s_rights(begun):
    _, worker, _ = begun()
    status = worker.ask(["read", "/proc/self/status"])
    assert re.findall(r"Cap(?:Inh|Prm|Eff):\s*(\w+)", status) == ["0" * 16] * 3


@pytest.mark.skipif(not Path("/proc/self/autogroup").exists(), reason="Linux groups no sessions")
def test_it_gives_way_with_its_session(begun):
    _, worker, _ = begun()
    assert worker.ask(["read", "/proc/self/autogroup"]).endswith(f"nice {os.nice(0) + 5}\n")


def test_it_is_another_user_s_where_that_one_can_read_its_packages(tmp_path):
    """By the system's Python where this one lies in a folder of root's own."""
    if os.getuid() != 0:
        pytest.skip("these tests do not run as root")
    pythons = [sys.executable, "/usr/bin/python3"]
    code = (
        "import json, os, sys; from pathlib import Path; from humanplay.tasks.processes import confine\n"
        "sys.path[:] = [each for each in sys.path if 'root' not in each]\n"
        "print(json.dumps([confine([], [], Path.cwd()), os.getresuid(), os.getgroups()]))"
    )
    for python in filter(os.path.exists, pythons):
        done = subprocess.run(
            [python, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True,
            env={"PYTHONPATH": str(Path(__file__).parents[3] / "app")},
        )  # fmt: skip
        guards, users, groups = json.loads(done.stdout)
        if not guards[OTHER_USER]:
            assert (users, groups) == ([pwd.getpwnam("nobody").pw_uid] * 3, [])
            return
    pytest.skip(guards[OTHER_USER])


def test_a_program_that_ends_without_closing_it_leaves_nothing_behind(tmp_path):
    code = (
        "import sys; from humanplay.tasks.processes import Preparer; "
        f"sys.last = Preparer({CONFINED!r}, 'ready'); sys.last.guards()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "TMPDIR": str(tmp_path)},
        capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    assert (done.stderr, list(tmp_path.iterdir())) == ("", [])


def test_what_cannot_be_prepared_says_why():
    preparer = Preparer(CONFINED, "cannot")
    for ask in (preparer.guards, lambda: preparer.begin({})):
        with pytest.raises(ValueError, match="there is nothing to prepare"):
            ask()


def test_how_much_is_done_is_told_on_the_way(begun, monkeypatch):
    _, _, preparer = begun()
    progress = []
    worker = preparer.begin({"steps": 2_000_000})
    assert worker.answer(progress.append) == "ready"
    assert progress == sorted(progress) != []


def test_a_message_beyond_the_limit_loses_the_worker(begun, monkeypatch):
    _, worker, _ = begun()
    monkeypatch.setattr(processes, "MESSAGE_BYTES", 100)
    with pytest.raises(LostError):
        worker.ask(["read", __file__])


def test_what_guards_and_what_does_not_is_said():
    guards = {NO_NETWORK: "", OTHER_USER: "the server is not root's", NO_OTHER_FILES: ""}
    sentence = guards_of(guards)
    assert "with no network, no other files; not with another user (the server is not" in sentence
    assert "against faults, not against malice" in sentence
    assert "malice" not in guards_of(guards | {OTHER_USER: ""})


HIDING = """
import ctypes, sys, sysconfig

class Elsewhere(ctypes.CDLL):
    def __getattr__(self, name):
        if name in ("prctl", "unshare", "capset", "syscall"):
            raise AttributeError(name)
        return super().__getattr__(name)

ctypes.CDLL = Elsewhere
sysconfig.get_config_vars()  # by the name that the system has here
sys.platform = "another"
"""
"""Hides what Linux alone has from each process that starts."""


def test_a_system_without_these_calls_runs_boards_without_guards_and_says_so(
    begun, tmp_path, monkeypatch
):
    (tmp_path / "sitecustomize.py").write_text(HIDING)
    monkeypatch.syspath_prepend(tmp_path)
    guards, worker, _ = begun()
    assert "this system has none" in guards[NO_NETWORK]
    assert guards[NO_OTHER_FILES] == "this system has no Landlock"
    assert f"not with {NO_NETWORK} (this system has none" in guards_of(guards)
    worker.close()


def test_what_is_not_confined_does_what_its_user_may(begun):
    guards, _, _ = begun(confined=False)
    assert guards_of(guards) == "boards run in processes of their own, which may do what you may"
