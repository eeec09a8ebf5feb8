"""What an extra leaves out is not needed by what the extra is for."""

import json
import re
import subprocess
import sys
from contextlib import contextmanager
from importlib.metadata import metadata

import pytest

from humanplay.command.extras import EXTRAS
from humanplay.db.store import Store
from humanplay.tasks.gymnasium.description import Description
from tests.app.pilot.test_score import played
from tests.support.absent import environment_without
from tests.support.command_server import command_server
from tests.support.recorded import play
from tests.support.servers import RunningServer

IN_PLAY = {*EXTRAS["play"], *EXTRAS["mars"]}
IN_EXTRAS = sorted({module for modules in EXTRAS.values() for module in modules})
MORE_THAN_PLAY = [module for module in IN_EXTRAS if module not in IN_PLAY]


@contextmanager
def serving(folder, *options):
    """A server, started by the command where [play] alone is installed."""
    command = [sys.executable, "-m", "humanplay.cli", "serve", "--port", "0", *options]
    environ = environment_without(MORE_THAN_PLAY, folder)
    with command_server(command, env=environ) as (_, address):
        server = RunningServer(int(address.rpartition(":")[2].strip("/")))
        yield server
        server.close()


def test_play_serves_marsexplorer_with_its_human_figures(tmp_path):
    database = tmp_path / "playground.db"
    store = Store(database)
    for seed in range(30):
        play(store, seed, f"player-{seed % 5}", explore=seed >= 5)
    store.close()
    with serving(tmp_path, "--database", str(database)) as server:
        client = server.page()
        begun = client.post("/api/sessions", json={"size": [9, 11], "rival": "ppo"}).json()
        episode, session = begun["frame"]["episode"], begun["session"]
        act = {"episode": episode, "step": 0, "action": "north"}
        assert client.post(f"/api/sessions/{session}/act", json=act).json()["outcome"]
        costs = client.get(f"/api/episodes/{episode}/costs", timeout=240).json()
        assert (costs["policy"], costs["reason"]) == ("ppo", None)
        (figure,) = client.get("/api/human-level").json()["figures"]
        assert figure["score"]["low"] < figure["score"]["mean"] < figure["score"]["high"]
        entries = client.get("/api/leaderboard").json()
        assert "random-21x21" in {entry["id"] for entry in entries}
        for path in ("/", "/leaderboard", "/api/people", "/api/daily", f"/replay/{episode}"):
            assert client.get(path).status_code == 200, path


def test_play_evaluates_policies(tmp_path):
    evaluate = ["-m", "humanplay.tasks.mars.cli", "evaluate", "--policy", "ppo", "--size", "9"]
    process = subprocess.run(
        [sys.executable, *evaluate, "--policy", "frontier-cost", "--episodes", "3"],
        env=environment_without(MORE_THAN_PLAY, tmp_path),
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr
    assert "frontier-cost" in process.stdout


SCORE = """
import json
from humanplay import score
moves = {0: 1, 4: 1, 8: 2, 9: 2, 10: 1, 14: 2}
shown = score("playground.db", {"straight": lambda observation: moves[int(observation)]})
random, straight = shown.policies
print(json.dumps([shown.people.mean, random.mean, straight.normalized_interval]))
"""


def test_people_are_scored_beside_a_policy_where_no_extra_is_installed(serve, tmp_path):
    """The interval of the human-normalized score too."""
    lake = Description(id="FrozenLake-v1", kwargs={"is_slippery": False}).told
    server = serve(task=f"gymnasium:{lake}")
    played(
        server, 11
    )  # of so many the interval leaves 0 out, also where random reaches the goal once
    played(server, 1, moves=("down", "right"))  # into a hole
    server.stop()
    process = subprocess.run(
        [sys.executable, "-c", SCORE],
        cwd=tmp_path,
        env=environment_without(IN_EXTRAS, tmp_path),
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr
    people, random, (low, high) = json.loads(process.stdout)
    assert people == pytest.approx(11 / 12)
    assert low < (1 - random) / (people - random) < high


def test_a_missing_pygame_is_named_with_the_line_of_the_installed_gymnasium(tmp_path):
    served = ["-m", "humanplay.cli", "serve", "--env", "FrozenLake-v1", "--port", "0"]
    process = subprocess.run(
        [sys.executable, *served, "--database", str(tmp_path / "lake.db")],
        env=environment_without(["pygame"], tmp_path),
        capture_output=True,
        text=True,
        check=False,
    )
    line = re.search(
        r"FrozenLake-v1 cannot be drawn: .*pip install .gymnasium\[(.+)\]", process.stderr
    )
    assert line, process.stderr
    assert line[1] in metadata("gymnasium").get_all("Provides-Extra")
