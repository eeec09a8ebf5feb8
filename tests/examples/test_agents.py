"""The ready-made agents play whole evaluations by OpenEnv's and MCP's clients.

They run in the environment that `make agents` makes; no model is asked, but a scripted stand-in of an OpenAI-compatible API.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from humanplay.task.registration import environment_of
from marsexplorer.config import EnvConfig
from tests.support.agents import own, rows_of, token_of
from tests.support.scripted_model import scripted_model

ROOT = Path(__file__).parents[2]
CLIENTS = ROOT / ".venv-agents" / "bin"
AGENTS = ROOT / "examples" / "agents"
MARS, ROOMS = "mars", "gymnasium:minigrid:MiniGrid-FourRooms-v0"
TURNS = ("left", "right", "forward")

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        not (CLIENTS.parent / ".done").is_file(), reason="needs .venv-agents: make agents"
    ),
]


def run(program, *arguments, **variables):
    """Return what a program prints; its last words are shown when it fails."""
    path = f"{CLIENTS}{os.pathsep}{os.environ['PATH']}"
    environ = {**os.environ, "PATH": path, "OPENAI_API_KEY": "none", **variables}
    if program == CLIENTS / "python":
        environ.pop("PYTHONPATH", None)  # what is installed there is all that it has
    command = [str(word) for word in (program, *arguments)]
    done = subprocess.run(command, env=environ, capture_output=True, text=True, timeout=3000)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
    return done.stdout


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """`begun(task)` is a database with an evaluation of two short instances.

    The environment is examined once.
    """
    root, done = tmp_path_factory.mktemp("begun"), set()

    def begin(task):
        database = root / f"{task.replace(':', '-')}.db"
        if task not in done:
            config = (
                EnvConfig("random", 7, 9, sensor_radius=4)
                if task == MARS
                else environment_of(task).configuration({"max_steps": 12})
            )
            own(database, task=task, config=config, instances=2)
            done.add(task)
        return database

    return begin


@pytest.fixture
def card(serve, begun, tmp_path):
    """`card(task)` serves an evaluation of its own: the server, and a card's address."""

    def begin(task):
        database = shutil.copy(begun(task), tmp_path / "playground.db")
        server = serve(task=task)
        return server, f"{server.url}/agents/{token_of(Path(database))}"

    return begin


def ends(server):
    """Return outcome and moves of every attempt as it is stored."""
    sql = """SELECT json_extract(came_to, '$.outcome'), (SELECT count(*) FROM agents_moves WHERE attempt = id)
        FROM agents_attempts ORDER BY id"""
    return rows_of(server.services.store.path, sql)


@pytest.mark.parametrize("task", [MARS, ROOMS])
def test_openenvs_command_finds_its_protocol_there(card, task):
    _, address = card(task)
    assert "Verdict: PASS" in run(CLIENTS / "openenv", "validate", "--url", address)


@pytest.mark.parametrize("task", [MARS, ROOMS])
def test_random_moves_play_a_series_by_openenvs_client(card, task):
    server, address = card(task)
    output = run(CLIENTS / "python", AGENTS / "random_moves.py", address)
    assert output.count("moves\n") == 2
    assert output.endswith("the card is closed\n")
    assert len(ends(server)) == 2
    assert all(outcome for outcome, _ in ends(server))
    assert httpx.get(address).status_code == 404


def test_a_policy_plays_a_series_by_a_plain_websocket(card):
    server, address = card(MARS)
    run(sys.executable, AGENTS / "policy_file.py", address, "--policy", "frontier-cost")
    assert [outcome for outcome, _ in ends(server)] == ["explored", "explored"]


def test_a_policy_of_marsexplorer_refuses_the_card_of_another_environment(card):
    _, address = card(ROOMS)
    command = [sys.executable, AGENTS / "policy_file.py", address, "--policy", "ppo"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("expected a card of MarsExplorer, got one of ")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("task", [MARS, ROOMS])
def test_a_model_of_language_plays_a_series_by_text_frames(card, task):
    server, address = card(task)
    with scripted_model(TURNS) as (model, api):
        arguments = (AGENTS / "language_model.py", address, "--model", "scripted")
        run(CLIENTS / "python", *arguments, OPENAI_BASE_URL=api)
    assert len(model.asked) == sum(moves for _, moves in ends(server))
    if task == MARS:
        assert [outcome for outcome, _ in ends(server)] == ["explored", "explored"]


def test_a_model_of_vision_plays_a_series_by_pictures(card):
    server, address = card(ROOMS)
    with scripted_model(TURNS) as (model, api):
        options = ("--model", "scripted", "--frames", "picture")
        run(
            CLIENTS / "python", AGENTS / "language_model.py", address, *options, OPENAI_BASE_URL=api
        )
    assert len(model.asked) == sum(moves for _, moves in ends(server)) > 2
    assert "image_url" in json.dumps(model.asked[-1])


@pytest.mark.parametrize("task", [MARS, ROOMS])
def test_a_model_plays_a_series_by_the_mcp_client(card, task):
    server, address = card(task)
    with scripted_model(TURNS) as (_, api):
        arguments = (AGENTS / "mcp_tools.py", address, "--model", "scripted")
        output = run(CLIENTS / "python", *arguments, OPENAI_BASE_URL=api)
    assert output.count("moves\n") == 2
    if task == MARS:
        assert [outcome for outcome, _ in ends(server)] == ["explored", "explored"]
