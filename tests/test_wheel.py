"""The wheel carries page and shipped policies, and serves them anywhere."""

import os
import re
import shutil
import site
import subprocess
import sys
import time
import venv
import zipfile
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from tests.support.command_server import command_server

ROOT = Path(__file__).parents[1]
PATIENCE_S = 240
"""Compiling the rules anew, on a busy machine."""


def pip(*args):
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of this tree."""
    folder = tmp_path_factory.mktemp("wheel")
    built = pip("wheel", ROOT, "--no-deps", "--wheel-dir", folder)
    if built.returncode and re.search(
        r"(found for|find .*) hatchling|to install build dependencies did not run", built.stderr
    ):
        pytest.skip(
            "NO HATCHLING: the package registry cannot be reached, so no wheel can be built here"
        )
    assert built.returncode == 0, built.stderr
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def home(wheel, tmp_path_factory):
    """The bin/ of an environment with the wheel, its dependencies borrowed from ours."""
    folder = tmp_path_factory.mktemp("elsewhere") / "venv"
    venv.create(folder, symlinks=True)
    installed = pip(
        "--python",
        folder / "bin" / "python",
        "install",
        "--no-deps",
        "--no-index",
        "--no-compile",
        wheel,
    )
    assert installed.returncode == 0, installed.stderr
    packages = next(folder.glob("lib/python*/site-packages"))
    (packages / "borrowed.pth").write_text("\n".join(site.getsitepackages()))
    borrow_kernels(packages)
    return folder / "bin"


def borrow_kernels(packages):
    """Give the wheel's modules the age of ours, and what was compiled of them.

    A cold start is tested with the bench.
    """
    for module in (ROOT / "marsexplorer").rglob("*.py"):
        shutil.copystat(module, packages / module.relative_to(ROOT))
    for kernel in (ROOT / "marsexplorer").rglob("__pycache__/*.nb[ci]"):
        place = packages / kernel.relative_to(ROOT)
        place.parent.mkdir(exist_ok=True)
        shutil.copy(kernel, place)


@contextmanager
def serving(folder, *command, **variables):
    """A command of that environment which serves outside of a checkout.

    Yields its address.
    """
    env = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("PYTHON", "HUMANPLAY_", "VIRTUAL_ENV"))
    } | variables
    with command_server(command, cwd=folder, env=env) as (_, address):
        yield address


def files_under(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_page_and_shipped_policies_travel_with_the_wheel(wheel):
    held = set(zipfile.ZipFile(wheel).namelist())
    assert "play/index.html" in files_under(ROOT / "static")
    assert {f"humanplay/static/{name}" for name in files_under(ROOT / "static")} <= held
    for folder in (ROOT / "app" / "humanplay", ROOT / "marsexplorer"):
        package_files = {name for name in files_under(folder) if "__pycache__" not in name}
        assert {f"{folder.name}/{name}" for name in package_files} <= held, (
            "templates and tables are there"
        )
    shipped = {path.name for path in (ROOT / "data/policies").iterdir() if path.is_file()}
    assert {f"marsexplorer/data/policies/{name}" for name in shipped} <= held
    assert not [name for name in held if "data/policies/paper" in name], "they are for a checkout"
    assert not [
        name
        for name in held
        if name.endswith((".db", ".pyc")) or name.startswith(("tests/", "docs/"))
    ]


@pytest.mark.timeout(PATIENCE_S)
def test_an_installed_wheel_serves_the_page_and_a_session(home, tmp_path):
    command = [
        str(home / "python"),
        "-c",
        "import humanplay, marsexplorer; print(humanplay.__file__, marsexplorer.__file__)",
    ]
    for path in subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout.split():
        assert path.startswith(str(home.parent)), path
    with (
        serving(
            tmp_path, home / "humanplay", "serve", "--port", "0", "--database", "away.db"
        ) as url,
        httpx.Client(base_url=url, timeout=60, trust_env=False) as client,
    ):
        assert all(
            part in client.get("/").text
            for part in ('data-testid="board-player"', "/common/theme.js")
        )
        assert (
            client.get("/static/000000000000/common/base.css").content
            == (ROOT / "static" / "common" / "base.css").read_bytes()
        )
        offered = {policy["name"] for policy in client.get("/api/policies").json()}
        assert {
            "random",
            "frontier-cost",
            *(path.stem for path in (ROOT / "data/policies").glob("*.onnx")),
        } <= offered
        begun = client.post("/api/sessions", json={"size": [9, 14], "rival": "frontier-cost"})
        assert begun.status_code == 201
        assert client.get(f"/viewer/{begun.json()['session']}/").status_code == 200
    assert (tmp_path / "away.db").is_file()
    assert not files_under(tmp_path) - {"away.db", "away.db-lock", "away.db-wal", "away.db-shm"}


@pytest.fixture
def crowded(tmp_path):
    """A folder of somebody's own project, with the names that other projects use too."""
    for name in ("app.py", "research.py", "tests.py", "static.py", "data.py"):
        (tmp_path / name).write_text("raise SystemExit('this module is not for humanplay')\n")
    (tmp_path / "static").mkdir()
    (tmp_path / "static/index.html").write_text("somebody's own page")
    return tmp_path


@pytest.mark.timeout(PATIENCE_S)
def test_the_wheel_is_used_in_a_folder_of_somebodys_own_project(home, crowded):
    environ = {**os.environ, "PYTHONPATH": "."}

    def said(*command):
        options = {"cwd": crowded, "env": environ, "capture_output": True, "text": True}
        process = subprocess.run([*map(str, command)], check=False, **options)
        assert (process.returncode, process.stderr) == (0, ""), process.stderr
        return process.stdout

    assert "serve" in said(home / "humanplay", "--help")
    assert said(home / "humanplay", "--version").startswith("humanplay")
    script = "import humanplay; print(humanplay.__file__)"
    assert said(home / "python", "-c", script).startswith(str(home.parent))
    assert "train" in said(home / "marsexplorer", "--help")
    assert "no difference in" in said(
        home / "humanplay", "doctor", "FrozenLake-v1", "--steps", "20"
    )
    served = (home / "humanplay", "serve", "--env", "FrozenLake-v1", "--port", "0")
    with (
        serving(crowded, *served, "--database", "lake.db", PYTHONPATH=".") as url,
        httpx.Client(base_url=url, timeout=60, trust_env=False) as client,
    ):
        assert "somebody's own" not in client.get("/").text
        assert client.post("/api/sessions", json={}).json()["task"]["title"] == "FrozenLake-v1"


def test_the_agents_of_the_paper_are_asked_for_in_a_checkout(home, tmp_path):
    command = [str(home / "humanplay"), "serve", "--paper", "--port", "0"]
    process = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert process.returncode == 2
    assert "Run `humanplay serve --paper` in a checkout" in process.stderr


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    "ways", [("uv", "tool", "run", "--from"), ("pipx", "run", "--spec")], ids=["uv", "pipx"]
)
def test_one_command_plays_a_shipped_network_from_the_wheel_without_torch(ways, wheel, tmp_path):
    """In an environment that the command itself makes, by whichever tool."""
    venv.create(tmp_path / "tools", with_pip=True)
    tools = tmp_path / "tools/bin"
    installed = pip("--python", tools / "python", "install", "--quiet", ways[0])
    if installed.returncode:
        pytest.skip(f"NO {ways[0].upper()}: the package registry cannot be reached")
    folders = {"UV_CACHE_DIR": f"{tmp_path}/made", "PIPX_HOME": f"{tmp_path}/made"}
    by_spec = (tools / ways[0], *ways[1:], f"{wheel}[play]", "humanplay")
    command = (*by_spec, "play", "--no-browser", "--database", "away.db")
    wanted = {"size": 9, "seed": 3, "player": "ppo"}
    with (
        serving(tmp_path, *command, PATH=f"{tools}:{os.environ['PATH']}", **folders) as url,
        httpx.Client(base_url=url, timeout=PATIENCE_S, trust_env=False) as client,
    ):
        assert client.get("/").status_code == 200
        begun = client.post("/api/sessions", json=wanted).json()
        pace = client.post(f"/api/sessions/{begun['session']}/pace", json={"moves_per_second": 50})
        assert pace.status_code == 200, pace.text
        until = time.monotonic() + PATIENCE_S
        while not (played := client.get("/api/episodes", params={"who": "all"}).json()):
            assert time.monotonic() < until, "the network ended no episode"
            time.sleep(0.5)
    assert (played[0]["outcome"], played[0]["driver"]) == ("explored", "policy:ppo")
    (runtime,) = (tmp_path / "made").rglob("site-packages/onnxruntime")
    packages = runtime.parent
    assert not (packages / "torch").exists()
    size = sum(path.stat().st_blocks for path in packages.rglob("*")) * 512
    assert size < 520e6
