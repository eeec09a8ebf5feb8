"""The playground without MarsExplorer's files serves another world."""

import os
import shutil
import subprocess
import sys

import httpx
import pytest

from humanplay import ROOT
from tests.support.absent import environment_without
from tests.support.servers import PATIENCE_S

COPIED = ("app", "data/policies", "examples", "marsexplorer", "static", "tests")
GONE = ("app/humanplay/tasks/mars", "static/task/mars")


@pytest.fixture
def tree(tmp_path):
    """The copy, and the variables of its processes, which have no numba."""
    tree = tmp_path / "tree"
    for folder in COPIED:
        shutil.copytree(ROOT / folder, tree / folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tree)
    for folder in GONE:
        shutil.rmtree(tree / folder)
    variables = environment_without(("numba", "llvmlite"), tmp_path)
    search = (variables["PYTHONPATH"], str(tree), str(tree / "app"))
    return tree, {**variables, "PYTHONPATH": os.pathsep.join(search)}


@pytest.mark.long
def test_a_server_starts_with_another_world(tree, tmp_path):
    folder, variables = tree
    database = ("--database", str(tmp_path / "maze.db"))
    command = (sys.executable, "-m", "humanplay.cli", "serve", "--port", "0", *database)
    with subprocess.Popen(
        (*command, "--env", "examples/worlds/maze"),
        cwd=folder,
        env=variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as server:
        printed = []
        try:
            for line in server.stdout:
                printed.append(line)
                if "is open at" in line:
                    break
            assert printed, "the server said nothing"
            assert "is open at" in printed[-1], "".join(printed)
            url = f"http://127.0.0.1:{printed[-1].split('http://127.0.0.1:')[1].split()[0]}"
            with httpx.Client(base_url=url, timeout=PATIENCE_S, trust_env=False) as client:
                for path in ("", "daily", "leaderboard", "me", "study", "about", "api/task"):
                    assert client.get(path).status_code == 200, path
                assert client.get("static/task/mars/index.js").status_code == 404
        finally:
            server.terminate()


@pytest.mark.long
def test_what_the_world_can_do_it_can_do_alone(tree):
    folder, variables = tree
    tests = ("tests/examples/test_worlds.py", "tests/browser/test_maze.py")
    done = subprocess.run(
        (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests),
        cwd=folder,
        env=variables,
        capture_output=True,
        text=True,
        timeout=800,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    assert "skipped" not in done.stdout.splitlines()[-1]
