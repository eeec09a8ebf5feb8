"""An environment in a folder of its author's, which no package brings: played, recorded and verified by the commands."""

import shutil
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from tests.support.command_server import command_server

HUMANPLAY = [
    sys.executable,
    "-P",
    "-m",
    "humanplay.cli",
]  # as the installed command: no folder comes first
OWN = Path(__file__).parents[2] / "support" / "own_environment.py"


@pytest.fixture
def folder(tmp_path):
    """A folder of the author's with its module `line`, and nothing else."""
    shutil.copy(OWN, tmp_path / "line.py")
    return tmp_path


def humanplay(folder, *arguments):
    """Run a command in the author's folder; return its exit code and what it says on one line."""
    done = subprocess.run(
        [*HUMANPLAY, *arguments], cwd=folder, capture_output=True, text=True, timeout=120
    )
    return done.returncode, " ".join((done.stdout + done.stderr).split())


def play_to_the_end(folder, env):
    """Serve an environment from the author's folder, and walk to the right until the episode ends."""
    command = [*HUMANPLAY, "serve", "--env", env, "--database", "line.db", "--port", "0"]
    with (
        command_server(command, cwd=folder) as (_, address),
        httpx.Client(base_url=address, timeout=60) as client,
    ):
        board = client.post("/api/sessions", json={"seed": 3}).json()
        frame, path = board["frame"], f"/api/sessions/{board['session']}/act"
        while frame["outcome"] is None:
            move = {"episode": frame["episode"], "step": frame["step"], "action": "1"}
            frame = client.post(path, json=move).json()
    return frame


@pytest.mark.parametrize("env", ["line:Line", "line.py", "line.py:Line", "line:make_line"])
def test_it_is_played_from_its_folder_and_verified_by_its_source(folder, env):
    assert play_to_the_end(folder, env)["outcome"] == "ended"
    verify = "verify", "--database", "line.db"
    code, text = humanplay(folder, *verify)
    assert (code, "as recorded" in text) == (0, True), text

    module = folder / "line.py"
    module.write_text(module.read_text().replace("STEP_COST = 0.1", "STEP_COST = 0.2"))
    code, text = humanplay(folder, *verify)
    assert (code, "instead of" in text, "line " in text) == (1, True, True), text


@pytest.mark.parametrize(
    ("env", "said"),
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
def test_what_cannot_be_played_is_said(folder, env, said):
    (folder / "needs.py").write_text("import lime\n")
    (folder / "two.py").write_text("from line import Line\n\n\nclass One(Line): ...\n\n\nclass Two(Line): ...\n")  # fmt: skip
    (folder / "json.py").write_text("")
    code, text = humanplay(folder, "doctor", env)
    assert (code, said in text) == (2, True), text
    assert "pip install" not in text


def test_a_file_that_lies_in_the_folder_stands_in_for_no_installed_module(folder):
    (folder / "numpy.py").write_text("raise SystemExit('the wrong numpy')\n")
    assert humanplay(folder, "doctor", "line:Line", "--steps", "5", "--seeds", "1")[0] == 0
