"""A world of one's own, registered by its folder: served, drawn from there, played by people and policies, and verified."""

import json
import os

import pytest

from humanplay import ROOT
from humanplay.study.verification import verify_database
from humanplay.task.registration import WORLDS, environment_of, register, static_of
from humanplay.web.simulate import NoisyPolicy, Plan, simulate
from tests.support.command import command
from tests.support.declared import DECLARATIONS_FILE

MAZE = ROOT / "examples" / "worlds" / "maze"


@pytest.fixture
def maze(monkeypatch):
    """The example, registered for this test."""
    monkeypatch.setenv(WORLDS, "")
    return register(MAZE)


def test_a_world_is_served_and_drawn_from_its_own_folder(serve, maze, tmp_path):
    server = serve(task=maze)
    client = server.page()
    about = client.post("/api/sessions", json={"seed": 3}).json()
    assert (about["task"]["title"], about["task"]["assets"]) == ("Maze", "maze")
    script = client.get("/static/000000000000/task/maze/index.js")
    assert script.text == (MAZE / "static/index.js").read_text()
    assert "script-src 'self'" in script.headers["content-security-policy"]
    for path in (
        "../environment.py",
        "%2e%2e/environment.py",
        "..%2Fenvironment.py",
        "environment.py",
    ):
        assert client.get(f"/static/000000000000/task/maze/{path}").status_code == 404, path
    assert client.get("/static/000000000000/task/picture/index.js").status_code == 200
    assert client.get("/api/daily").status_code == 404
    policy = NoisyPolicy(environment_of(maze), "far-wall", 0.0, None)
    policy.reset()
    with server.socket(about["session"], client) as socket:
        frame = socket.receive("frame")
        while frame["outcome"] is None:
            socket.act(frame, policy.choose(frame))
            frame = socket.frame_after(frame["step"])
    assert (frame["outcome"], frame["score"] > 0) == ("succeeded", True)
    replay = client.get(f"/api/episodes/{frame['episode']}/replay")
    assert replay.status_code == 200, replay.text
    server.stop()
    assert verify_database(tmp_path / "playground.db").findings == ()


def test_its_episodes_follow_from_seed_and_moves(maze):
    environment = environment_of(maze)
    config = environment.configuration({})
    policies = environment.policies
    for source, seed, moves, digest in policies.play_all(["far-wall", "random"], config, [1, 2]):
        record = environment.run(config, seed, moves).record()
        assert record.trajectory_hash == digest, source
        assert environment.replay_record(record).record() == record
    assert static_of(maze) == MAZE / "static"


@pytest.mark.parametrize(
    ("name", "files", "message"),
    [
        ("empty", (), "expected a world's environment.py and task.py"),
        ("half", ("environment.py",), "got no task.py"),
        ("Capital", ("environment.py", "task.py"), "small letters"),
        ("mars", ("environment.py", "task.py"), "the name 'mars' is taken"),
    ],
)
def test_a_folder_that_is_no_world_is_refused(tmp_path, maze, name, files, message):
    folder = tmp_path / name
    folder.mkdir()
    for file in files:
        (folder / file).touch()
    before = os.environ[WORLDS]
    with pytest.raises(ValueError, match=message):
        register(folder)
    assert os.environ[WORLDS] == before


def test_a_package_registers_its_world(tmp_path, monkeypatch):
    monkeypatch.setenv(WORLDS, "")
    (tmp_path / "mazes-1.dist-info").mkdir()
    about = "Metadata-Version: 2.1\nName: mazes\nVersion: 1\n"
    (tmp_path / "mazes-1.dist-info/METADATA").write_text(about)
    offered = "[humanplay.tasks]\nmaze = maze\n"
    (tmp_path / "mazes-1.dist-info/entry_points.txt").write_text(offered)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.syspath_prepend(MAZE.parent)
    environment_of.cache_clear()
    assert json.loads(json.dumps(environment_of("maze").configuration({}).to_dict())) == {
        "side": 9,
        "limit": 120,
    }


def test_synthetic_participants_take_part_in_a_study_of_it(serve, maze, tmp_path, capsys):
    database = ("--database", tmp_path / "playground.db")
    sizes = ("--warm-up", 0, "--ranked", 2, "--players", 2, "--recruitment", "open")
    new = ("study", "new", "way", "--env", MAZE, "--declarations", DECLARATIONS_FILE)
    assert command(capsys, *new, *sizes, *database)[0] == 0
    assert command(capsys, "study", "freeze", "way", "--underpowered", *database)[0] == 0
    server = serve(task=maze)
    outcomes = []
    simulate(Plan(server.url, "way", 2, policy="far-wall", speed=1000.0), outcomes)
    assert [(each.stage, each.ranked) for each in outcomes] == [("complete", 2)] * 2
