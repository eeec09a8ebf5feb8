"""An environment in its author's folder: played, recorded and verified."""

import re
import shutil
import sys
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from tests.support.command_server import address_in, command_server
from tests.support.forked_server import Program

HUMANPLAY = [
    sys.executable,
    "-P",
    "-m",
    "humanplay.cli",
]  # as the installed command: no folder comes first
SERVE = "serve", "--database", "line.db", "--port", "0", "--env"
OWN = Path(__file__).parents[2] / "support" / "own_environment.py"


@pytest.fixture
def folder(tmp_path):
    """A folder of the author's with its module `line`, and nothing else."""
    shutil.copy(OWN, tmp_path / "line.py")
    return tmp_path


def humanplay(folder, *arguments):
    """A command in the author's folder: its exit code, and its text on one line."""
    program = Program(folder, "humanplay", *arguments)
    text = program.printed()
    return program.returncode, " ".join(text.split())


@contextmanager
def served(folder, env):
    """Serve an environment from the author's folder: the server, and its address."""
    program = Program(folder, "humanplay", *SERVE, env)
    try:
        yield program, address_in(program.stdout)
    finally:
        if program.poll() is None:
            program.kill()
        program.stdout.close()


def play_to_the_end(process, address):
    """Walk to the right until the episode ends: how it did, and the server's log."""
    with httpx.Client(base_url=address, timeout=60) as client:
        board = client.post("/api/sessions", json={"seed": 3}).json()
        frame, path = board["frame"], f"/api/sessions/{board['session']}/act"
        while frame["outcome"] is None:
            move = {"episode": frame["episode"], "step": frame["step"], "action": "1"}
            client.post(path, json=move)
            frame = client.get(f"/api/sessions/{board['session']}").json()
        process.terminate()
        log = process.stdout.read()
    return frame["outcome"], log


@pytest.mark.parametrize("env", ["line:Line", "line.py", "line.py:Line", "line:make_line"])
def test_it_is_played_from_its_folder_and_verified_by_its_source(folder, env):
    with served(folder, env) as server:
        assert play_to_the_end(*server)[0] == "ended"
    verify = "verify", "--database", "line.db"
    code, text = humanplay(folder, *verify)
    assert (code, "as recorded" in text) == (0, True), text

    module = folder / "line.py"
    module.write_text(module.read_text().replace("STEP_COST = 0.1", "STEP_COST = 0.2"))
    code, text = humanplay(folder, *verify)
    assert (code, "instead of" in text, "line " in text) == (1, True, True), text


@pytest.mark.parametrize(
    ("env", "reason"),
    [
        ("lime:Line", "there is no module 'lime' in this folder, nor is it installed"),
        ("line:Nothing", "has no class of gymnasium.Env or function of that name"),
        ("line:STEP_COST", "has no class of gymnasium.Env or function of that name"),
        ("line:make_blind", "let it make the environment with render_mode='rgb_array'"),
        ("needs.py", "needs.py cannot be imported: No module named 'lime'"),
        ("needs:Line", "needs a module that is not installed: lime"),
        ("two.py", "expected one class of gymnasium.Env in two.py, found One, Two: write two.py:NAME"),
        ("json.py", "another module is called 'json'; rename the file"),
        ("nothing.py", "cannot read nothing.py: no such file"),
    ],
)  # fmt: skip
def test_what_cannot_be_played_is_said(folder, env, reason):
    (folder / "needs.py").write_text("import lime\n")
    (folder / "two.py").write_text("from line import Line\n\n\nclass One(Line): ...\n\n\nclass Two(Line): ...\n")  # fmt: skip
    (folder / "json.py").write_text("")
    code, text = humanplay(folder, "doctor", env)
    assert (code, reason in text) == (2, True), text
    assert "pip install" not in text


@pytest.mark.usefixtures("executed_preparers")
def test_a_file_that_lies_in_the_folder_stands_in_for_no_installed_module(folder):
    (folder / "numpy.py").write_text("raise SystemExit('the wrong numpy')\n")
    with command_server([*HUMANPLAY, *SERVE, "line:Line"], cwd=folder) as server:
        assert play_to_the_end(*server)[0] == "ended"
    code, text = humanplay(folder, "doctor", "line:Line", "--seeds", "1", "--steps", "50")
    assert code == 0, text


def test_what_it_raises_reaches_its_author_with_the_place_and_the_move(folder):
    module = folder / "line.py"
    text = module.read_text()
    step = "        self.cell = max(0,"
    fails = "        if self.cell == 5:\n            raise KeyError('no such room')\n"
    module.write_text(text.replace(step, fails + step))
    line = module.read_text().splitlines().index("            raise KeyError('no such room')") + 1
    with served(folder, "line.py") as server:
        log = play_to_the_end(*server)[1]
    move = r"line:Line failed, seed 3, step \d, action 1 \(1\): KeyError: 'no such room'"
    assert re.search(move, log), log
    assert re.search(rf'File ".*/line.py", line {line}, in step', log), log
    assert "failed again, and the episode is over, seed 3" in log
