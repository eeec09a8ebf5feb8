"""FrozenLake as a task on a real server: played, killed, verified, exported."""

import base64
import csv
import io
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from humanplay.study.verification import verify_database
from humanplay.task import Choice, describe
from humanplay.task.registration import environment_of
from humanplay.tasks import courses
from humanplay.tasks.courses import FrameCourses
from humanplay.tasks.gymnasium.description import Description
from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment
from humanplay.tasks.gymnasium.task import GymnasiumTask
from humanplay.web.settings import Settings
from tests.support.command import command, run
from tests.support.recorded import alter

LAKE, ROOMS = "gymnasium:FrozenLake-v1", "gymnasium:minigrid:MiniGrid-FourRooms-v0"
DOWN, RIGHT = "down", "right"


@pytest.fixture
def lake(serve):
    return serve(task=LAKE)


def begin(server, client, **body):
    begun = client.post("/api/sessions", json=body)
    assert begun.status_code == 201, begun.text
    return begun.json()


def play(server, client, begun, moves=("down", "right", "left"), input="key"):
    """Play to the end by the moves, again and again, with a person's `input`."""
    frames = []
    with server.socket(begun["session"], client) as socket:
        frames.append(socket.receive("frame"))
        while frames[-1]["outcome"] is None:
            socket.act(frames[-1], moves[frames[-1]["step"] % len(moves)], input=input)
            frames.append(socket.frame_after(frames[-1]["step"]))
    return frames


def pixels(frame):
    """The picture of a frame: uint8[height, width, 3]."""
    kind, data = frame["picture"].split(",")
    assert kind == "data:image/png;base64"
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))


def test_a_page_is_told_how_it_is_called_drawn_moved_and_measured(lake):
    about = begin(lake, lake.page())["task"]
    assert about == describe(environment_of(LAKE))
    called = (about["name"], about["title"], about["assets"])
    assert called == ("gymnasium", "FrozenLake-v1", "picture")
    assert about["actions"] == ["left", "down", "right", "up"] == list(about["keys"])
    assert about["metrics"][0]["name"] == "return"


def test_an_episode_played_by_keys_is_attested_shown_and_verified(lake, tmp_path):
    client = lake.page()
    begun = begin(lake, client)
    frames = play(lake, client, begun)
    last = frames[-1]
    assert last["outcome"] in ("succeeded", "failed", "timed_out")
    assert last["return"] == last["score"] == last["headline"]
    assert last["return"] == (last["outcome"] == "succeeded")
    assert pixels(frames[0]).shape == (256, 256, 3)
    assert any((pixels(one) != pixels(two)).any() for one, two in pairwise(frames))
    episode = client.get(f"/api/episodes/{last['episode']}").json()
    assert (episode["task"], episode["level"]) == (LAKE, "FrozenLake-v1")
    assert (episode["attestation"], episode["outcome"]) == ("attested", last["outcome"])
    assert set(episode["actions"]) <= {"left", "down", "right", "up"}
    history = client.get("/api/me/history").json()
    (best,), (mine,) = history["bests"], history["episodes"]
    assert best["place"] == "FrozenLake-v1"
    assert (mine["episode"], mine["moves"]) == (last["episode"], last["step"])
    again = client.get(f"/api/watch/{last['episode']}").json()
    assert [frame["picture"] for frame in again["frames"]] == [frame["picture"] for frame in frames]
    answer = client.get(f"/watch/{last['episode']}", follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, f"../replay/{last['episode']}")
    answer = client.get(f"/api/episodes/{last['episode']}/costs")
    assert (answer.status_code, "are not judged" in answer.text) == (422, True)
    assert verify_database(tmp_path / "playground.db").findings == ()


def test_nothing_else_can_be_asked_for(lake):
    client = lake.page()
    for body, refusal in (
        ({"level": "random"}, "unknown field 'level'"),
        ({"size": 21}, "unknown field 'size'"),
        ({"player": "ppo"}, "no policy 'ppo'"),
        ({"rival": "ppo"}, "no policy 'ppo'"),
    ):
        answer = client.post("/api/sessions", json=body)
        assert (answer.status_code, refusal in answer.text) == (422, True), answer.text
    begun = begin(lake, client)
    with lake.socket(begun["session"], client) as socket:
        socket.act(socket.receive("frame"), "north")
        assert "action must be 'left', 'down', 'right' or 'up'" in socket.receive("error")["detail"]


@pytest.mark.parametrize(
    ("task", "actions"), [(LAKE, (DOWN, RIGHT)), (ROOMS, ("forward", "right", "forward"))]
)
@pytest.mark.long  # test_offers.py kills a server, too
def test_a_killed_server_goes_on_where_it_stood(spawn, tmp_path, task, actions):
    server = spawn(task=task)
    client = server.client()
    begun = begin(server, client, seed=3)
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        for action in actions:
            if frame["outcome"] is None:
                socket.act(frame, action)
                frame = socket.frame_after(frame["step"])
        server.kill()
    server = spawn(task=task)
    again = server.client(cookies=dict(client.cookies))
    assert again.get(f"/api/sessions/{begun['session']}").json() == frame
    server.kill()
    assert verify_database(tmp_path / "playground.db").findings == ()


CHANGES = {
    "UPDATE steps SET action = 3 - action WHERE step = 0": "trajectory_hash",
    "UPDATE steps SET reward = reward + 1 WHERE step = 0": "reward of step 0",
    "UPDATE episodes SET seed = seed + 1": "terrain_hash",
    "UPDATE episodes SET score = score + 1": "score",
    "UPDATE episodes SET task = 'gymnasium:FrozenLake8x8-v1'": "config",
    "UPDATE episodes SET task = 'chess'": "config",
}


def test_what_was_changed_is_found(lake, tmp_path):
    client = lake.page()
    play(lake, client, begin(lake, client, seed=5))
    lake.stop()
    for change, field in CHANGES.items():
        copy = Path(shutil.copy(tmp_path / "playground.db", tmp_path / "copy.db"))
        alter(copy, change)
        findings = verify_database(copy).findings
        assert any(field in finding.what for finding in findings), (change, *map(str, findings))


def test_it_is_exported_by_the_names_of_its_actions(lake, tmp_path):
    client = lake.page()
    frames = play(lake, client, begin(lake, client))
    lake.stop()
    options = "--database", tmp_path / "playground.db", "--out", tmp_path / "out"
    assert run("export", *options) == 0
    (row,) = csv.DictReader((tmp_path / "out/episodes.csv").read_text().splitlines())
    assert (row["task"], row["level"], row["verified"]) == (LAKE, "FrozenLake-v1", "true")
    assert (row["rows"], row["coverage"], row["outcome"]) == ("", "", frames[-1]["outcome"])
    steps = list(csv.DictReader((tmp_path / "out/steps.csv").read_text().splitlines()))
    assert " ".join(step["action"] for step in steps) == row["actions"]


def test_its_replay_is_a_page_and_files_of_what_was_shown(lake, tmp_path, capsys):
    client = lake.page()
    frames = play(lake, client, begin(lake, client))
    last = frames[-1]
    at, shown = f"/replay/{last['episode']}", [frame["picture"] for frame in frames]
    replay = client.get(f"/api{at.replace('replay', 'episodes')}/replay").json()
    assert (replay["run"]["name"], replay["ghosts"], replay["task"]) == (
        "You",
        [],
        describe(environment_of(LAKE)),
    )
    assert [frame["picture"] for frame in replay["run"]["frames"]] == shown
    assert replay["run"]["sentence"].endswith(
        f"after {last['step']} moves: return {last['return']:g}"
    )
    page = client.get(at).text
    assert replay["run"]["sentence"] in page
    assert "#challenge" not in page
    alone = client.get(f"{at}.html").text
    assert all(picture in alone for picture in shown)
    assert "A person " in alone, "a file is for everybody"
    with Image.open(io.BytesIO(client.get(f"{at}.gif").content)) as animation:
        assert animation.size == (256, 256)
        assert animation.n_frames > 1
    assert Image.open(io.BytesIO(client.get(f"{at}.png").content)).size == (1200, 630)
    assert (
        client.get(f"/api{at.replace('replay', 'episodes')}/ghost?policy=random").status_code == 422
    )
    lake.stop()
    out = tmp_path / "replay.html"
    args = ["--database", str(tmp_path / "playground.db"), "--out", str(out)]
    code, printed, _ = command(capsys, "replay", last["episode"], *args)
    assert (code, f"{last['step']} moves" in printed) == (0, True)
    assert replay["run"]["sentence"] in out.read_text()


def test_a_replay_of_texts_is_drawn_and_one_of_many_pictures_leaves_some_out(monkeypatch):
    here = GymnasiumEnvironment(Description(id="tests.support.environments:Path-v0").told)
    run = here.run(here.default, 1, bytes([1, 0] * 20))
    run.abandon()
    course = FrameCourses(here).course_of("A person", run.record())
    assert course.sentence.startswith("left after 40 moves")
    drawn = course.animation((), is_large=False)
    assert (np.asarray(drawn.at(0, 0)) != np.asarray(drawn.at(1, 0))).any(), "it has moved"
    assert (np.asarray(drawn.at(0, 0)) == np.asarray(drawn.at(2, 1))).all(), "and come back"
    size = sum(len(frame["text"]) for frame in course.frames)
    monkeypatch.setattr(courses, "MOST_BYTES", size // 3)
    fewer = FrameCourses(here).course_of("A person", run.record())
    assert len(fewer.frames) < len(course.frames) / 3
    assert (fewer.frames[0], fewer.frames[-1]) == (course.frames[0], course.frames[-1])


@pytest.mark.parametrize(
    ("level", "kwargs", "outcome"),
    [
        ("FrozenLake-v1", {"is_slippery": False}, "failed"),
        ("CartPole-v1", {"sutton_barto_reward": True}, "ended"),
        ("minigrid:MiniGrid-Dynamic-Obstacles-8x8-v0", {"agent_pov": True}, "failed"),
    ],
)
def test_a_run_is_a_function_of_configuration_seed_and_actions(level, kwargs, outcome):
    task = GymnasiumTask(level)
    moves = bytes(np.random.default_rng(0).integers(0, len(task.actions), 40))
    one = task.begin(Choice(task.default, 7))
    rewards = [one.step(move) for move in moves if one.outcome == "running"]
    record = one.record()
    again = task.replay_record(record)
    assert again.record() == record
    assert (again.rewards(), record.outcome) == (rewards, outcome)
    low, high = task.bounds(task.default)
    assert low <= record.score <= high, "of the catalogue, where it knows any"
    other = task.configuration({"kwargs": kwargs})
    assert other.hash != task.default.hash
    assert task.configuration(other.to_dict()) == other
    with pytest.raises(ValueError, match="was played under gymnasium 0"):
        task.replay_record(type(record)(**{**record.__dict__, "core_version": "gymnasium 0"}))


@pytest.mark.parametrize(
    ("name", "refusal"),
    [
        ("gymnasium:NoSuch-v0", "knows no environment"),
        ("gymnasium:Taxi-v3", "use `Taxi-v4` instead"),
        ("chess", "expected a task of mars, gymnasium"),
        ("mars:x", "has no variants"),
        ("gymnasium:Pendulum-v1", "discrete actions"),
    ],
)
def test_what_is_no_task_is_said_at_the_start(tmp_path, capsys, name, refusal):
    from humanplay.web.server import ServerError, run

    with pytest.raises(ServerError, match=refusal):
        run(Settings(database=tmp_path / "play.db", port=0, task=name))
    assert not (tmp_path / "play.db").exists()
