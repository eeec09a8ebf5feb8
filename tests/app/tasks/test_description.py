"""What is derived of an environment, and what its file may say."""

import base64
import io
import json
import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing

import numpy as np
import pytest
from PIL import Image

from humanplay.study.verification import verify_database
from humanplay.task import Choice
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.description import Description, read_description
from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment
from humanplay.tasks.gymnasium.run import GymnasiumRun
from humanplay.tasks.gymnasium.task import GymnasiumTask
from tests.support.command import command
from tests.support.servers import RunningServer, eventually

OURS = "tests.support.environments"
PATH = f"{OURS}:Path-v0"
FILE = f"""
id = "{PATH}"
title = "Home"
instructions = "Walk home."
kwargs = {{ length = 3 }}
keys = {{ ArrowUp = "forward", KeyB = 0 }}
success = "info.home"
score = "info.coins"
max_steps = 6
"""


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("CliffWalking-v1", {"up": "ArrowUp", "right": "ArrowRight", "down": "ArrowDown", "left": "ArrowLeft"}),
        ("LunarLander-v3", None),
        (PATH, {"back": "ArrowDown", "forward": "ArrowUp", "wave": "Digit1"}),
        (f"{OURS}:Meanings-v0", {"noop": "KeyN", "right": "ArrowRight", "rightfire": "Digit1"}),
        (f"{OURS}:OwnKeys-v0", {"0": "ArrowLeft", "1": "KeyJ", "2": "Digit2"}),
        (f"{OURS}:Seeded-v0", {"noop": "KeyN", "right": "ArrowRight", "rightfire": "Digit1"}),
    ],
)  # fmt: skip
def test_names_and_keys_are_derived(text, keys):
    if keys is None:
        pytest.importorskip("Box2D")
        keys = {
            "nothing": "KeyN",
            "left_engine": "ArrowRight",
            "main_engine": "ArrowUp",
            "right_engine": "ArrowLeft",
        }
    environment = environment_of(f"gymnasium:{text}")
    assert {name: codes[0] for name, codes in environment.keys.items()} == keys
    assert environment.actions == tuple(keys)


@pytest.fixture
def home(tmp_path):
    """The file of an environment."""
    path = tmp_path / "home.toml"
    path.write_text(FILE)
    return path


def test_a_file_is_all_of_the_task_s_name(home):
    text = read_description(home).told
    environment = environment_of(f"gymnasium:{text}")
    assert Description(**json.loads(text)) == read_description(home)
    assert environment.name == f"gymnasium:{text}"
    assert (environment.about.title, environment.about.instructions) == ("Home", "Walk home.")
    assert environment.keys == {"back": ("KeyB",), "forward": ("ArrowUp",), "wave": ()}
    assert (environment.metrics[0].name, environment.successes) == ("coins", {"succeeded"})
    assert environment.default.to_dict() == {"level": PATH, "kwargs": {"length": 3}, "max_steps": 6}
    assert (
        environment.default.hash
        != environment_of(f"gymnasium:{PATH}").configuration(environment.default.to_dict()).hash
    )
    assert (
        "`info.home`" in environment.texts(environment.default).design
        or "info.home" in environment.about.words.definition
    )


@pytest.mark.parametrize(
    ("success", "moves", "outcome"),
    [
        ("info.home", [1, 1, 1], "succeeded"),
        ("return > -3", [1, 1, 1], "failed"),
        ("return >= -3", [1, 1, 1], "succeeded"),
        ("return > -9", [0] * 6, "succeeded"),
        ("", [1, 1, 1], "ended"),
        ("info.home", [0] * 6, "timed_out"),
    ],
)
def test_a_success_is_what_the_file_says(home, success, moves, outcome):
    fields = {**read_description(home).model_dump(exclude_unset=True), "success": success}
    task = GymnasiumTask(Description(**fields).told)
    run = task.begin(Choice(task.default, 1))  # it starts in cell 0
    for move in moves:
        if run.outcome == "running":
            run.step(move)
    record = run.record()
    assert (record.outcome, record.score) == (outcome, 2 * sum(moves))
    assert (record.outcome in task.successes) == (outcome in ("succeeded", "ended"))
    assert task.replay_record(record).record() == record


def test_two_seeds_are_two_episodes_where_only_the_making_heeds_them():
    fields = {"id": f"{OURS}:Seeded-v0", "seeding": "kwarg"}
    task = GymnasiumTask(Description(**fields).told)
    assert len({task.begin(Choice(task.default, seed)).view().picture for seed in range(8)}) == 2


def test_the_file_that_doctor_prints_describes_the_same_environment(tmp_path, capsys):
    code, printed, _ = command(capsys, "doctor", "FrozenLake-v1", "--toml")
    (tmp_path / "lake.toml").write_text(printed)
    again = GymnasiumTask(read_description(tmp_path / "lake.toml").told)
    lake = GymnasiumTask("FrozenLake-v1")
    assert (code, again.description.model_dump(exclude={"keys", "actions", "title", "max_steps"})) == (
        0, lake.description.model_dump(exclude={"keys", "actions", "title", "max_steps"}),
    )  # fmt: skip
    assert (again.about.title, again.actions, again.keys, again.limit) == (
        lake.about.title,
        lake.actions,
        lake.keys,
        lake.limit,
    )
    code, printed, _ = command(capsys, "doctor", "--schema")
    assert (code, set(json.loads(printed)["properties"])) == (0, set(Description.model_fields))


WITHOUT = """
import sys
ABSENT = {
    "torch", "numba", "llvmlite", "viser", "onnx", "onnxruntime", "msgspec", "zstandard", "yaml", "httpx", "scipy",
    "matplotlib",
}
for name in ABSENT:
    sys.modules[name] = None
from humanplay.cli.main import main
main()
"""
"""The command where no extra is installed."""


def test_play_opens_a_browser_at_the_environment_without_what_mars_explorer_needs(tmp_path):
    arguments = ["play", "FrozenLake-v1", "--database", str(tmp_path / "x.db")]
    environ = {**os.environ, "BROWSER": f"sh -c 'echo %s > {tmp_path}/address' &"}
    ours = [sys.executable, "-c", WITHOUT, *arguments]
    with subprocess.Popen(ours, env=environ, stdout=subprocess.DEVNULL) as server:
        try:
            eventually(
                lambda: (tmp_path / "address").exists() and (tmp_path / "address").read_text()
            )
            address = (tmp_path / "address").read_text().strip()
            running = RunningServer(int(address.rsplit(":", 1)[1].strip("/")))
            client = running.page()
            assert client.get("/healthz").status_code == 200
            begun = client.post("/api/sessions", json={}).json()
            assert begun["task"]["title"] == "FrozenLake-v1"
            with running.socket(begun["session"], client) as socket:
                socket.act(socket.receive("frame"), "left", input="key")
                assert socket.frame_after(0)["step"] == 1
            assert (
                client.get("/api/leaderboard").json(),
                client.get("/api/daily").status_code,
            ) == ([], 404)
            assert client.get("/viewer/client/").status_code == 404
            running.close()
        finally:
            server.send_signal(signal.SIGINT)
        assert server.wait(20) == 0


def test_a_package_offers_an_environment_under_a_name_of_its_own(tmp_path, monkeypatch, capsys):
    (tmp_path / "rooms-1.dist-info").mkdir()
    (tmp_path / "rooms-1.dist-info/METADATA").write_text(
        "Metadata-Version: 2.1\nName: rooms\nVersion: 1\n"
    )
    offered = "[humanplay.tasks]\nhome = rooms_of_ours:HOME\nnone = rooms_of_ours:NONE\n"
    (tmp_path / "rooms-1.dist-info/entry_points.txt").write_text(offered)
    (tmp_path / "rooms_of_ours.py").write_text(
        f"HOME = {{'id': '{PATH}', 'title': 'Home', 'max_steps': 6}}\nNONE = {{'idd': 1}}\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    code, printed, _ = command(capsys, "doctor", "home", "--toml")
    assert (code, 'title = "Home"' in printed, "max_steps = 6" in printed) == (0, True, True)
    code, _, error = command(capsys, "doctor", "none", "--toml")
    assert (code, "none, which rooms_of_ours:NONE describes: " in error) == (2, True)


def test_what_is_seen_is_said_of_the_arguments_that_it_holds_for_alone():
    rooms = "minigrid:MiniGrid-FourRooms-v0"
    plain = GymnasiumEnvironment(rooms)
    assert "People see the whole grid from above" in plain.texts(plain.default).design
    pov = Description(id=rooms, kwargs={"agent_pov": True})
    environment = GymnasiumEnvironment(pov.told)
    assert environment.texts(environment.default).observations == ""
    description = Description(
        id=rooms, kwargs={"agent_pov": True}, people_see="7x7 cells", agents_see="7x7 cells"
    )
    environment = GymnasiumEnvironment(description.told)
    assert (
        environment.texts(environment.default).observations
        == "People see 7x7 cells; agents are given the same."
    )
    assert (
        environment.texts(environment.configuration({"kwargs": {"agent_pov": False}})).observations
        == ""
    )


def test_a_photograph_is_shown_as_jpeg_and_everything_else_as_it_is():
    shown = {}
    for codec in ("png", "jpeg"):
        here = GymnasiumEnvironment(Description(id="FrozenLake-v1", codec=codec).told)
        run = GymnasiumRun(here.default, 1)
        mime, _, packed = run.view().picture.partition(";base64,")
        assert mime == f"data:image/{codec}"
        shown[codec] = np.asarray(Image.open(io.BytesIO(base64.b64decode(packed)))).astype(int)
        drawn = run._env.render()
        assert shown[codec].shape == drawn.shape
    assert (shown["png"] == drawn).all()
    assert 0 < abs(shown["jpeg"] - drawn).mean() < 5


def test_a_wrapper_makes_actions_of_a_wheel():
    fields = {"id": f"{OURS}:Wheel-v0", "wrappers": [f"{OURS}:Steered"]}
    assert GymnasiumTask(Description(**fields).told).actions == ("0", "1")


def test_it_is_played_as_text_by_the_file_s_score_and_verified(home, serve, tmp_path):
    server = serve(task=f"gymnasium:{read_description(home).told}")
    client = server.page()
    begun = client.post("/api/sessions", json={}).json()
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        assert (frame["picture"], "@" in frame["text"]) == (None, True)
        while frame["outcome"] is None:
            socket.act(frame, "forward")
            frame = socket.frame_after(frame["step"])
    assert (frame["outcome"], frame["headline"], frame["return"]) == (
        "succeeded",
        2.0 * frame["step"],
        -frame["step"],
    )
    server.stop()
    database = tmp_path / "playground.db"
    assert verify_database(database).findings == ()
    with closing(sqlite3.connect(database, isolation_level=None)) as conn:
        assert conn.execute("SELECT score, outcome FROM episodes").fetchone() == (
            frame["score"],
            "succeeded",
        )
        conn.execute("UPDATE episodes SET score = score + 1")
    assert any("score" in finding.what for finding in verify_database(database).findings)


@pytest.mark.parametrize(
    ("text", "refusal"),
    [
        ('id = "X-v0"\nkeys = = 1', "(at line 2"),
        (f'id = "{PATH}"\n\nkyes = {{}}', "line 3: there is no field 'kyes'; the fields are id, kwargs"),
        ('title = "x"', "id: Field required"),
        (f'id = "{PATH}"\n[keys]\nArrowUpp = 1', "line 2: keys: expected codes like ArrowUp"),
        (f'id = "{PATH}"\nkeys = {{ ArrowUp = "jump" }}', "keys: ArrowUp = 'jump' is no action of"),
        (f'id = "{PATH}"\nactions = ["a", "b"]', f"actions: {PATH} has 3, got 2 names"),
        (f'id = "{PATH}"\nsuccess = "always"', "line 2: success: "),
        (f'id = "{PATH}"\nkwargs = {{ width = 1 }}', "cannot be made: "),
        (f'id = "{PATH}"\nwrappers = ["nosuch:Wrapper"]', "cannot be made: No module named 'nosuch'"),
        ('id = "nosuch:X-v0"', "there is no module 'nosuch' in this folder, nor is it installed"),
        ('id = "NoSuch-v0"', "write the module's name before it"),
        (f'id = "{OURS}:Wheel-v0"', 'wrappers = ["humanplay.tasks.gymnasium.adapters:OneAtATime"]'),
        (f'id = "{OURS}:Blind-v0"', "draws no picture (rgb_array) and no text (ansi), only human"),
    ],
)  # fmt: skip
def test_what_cannot_be_played_is_said_at_the_start(text, refusal, tmp_path, capsys):
    path = tmp_path / "env.toml"
    path.write_text(text)
    options = "--database", tmp_path / "play.db", "--port", 0
    code, _, err = command(capsys, "serve", "--env", path, *options)
    err = " ".join(err.split())
    assert (code in (1, 2), refusal in err) == (True, True), err
    assert "Traceback" not in err
    assert not (tmp_path / "play.db").exists()
