"""The call `play`: from what a program holds to a page that records."""

import json
import os
import sqlite3
import subprocess
import sys
import textwrap
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

import gymnasium
import httpx
import pytest

from humanplay import play
from humanplay.cli.pilot import running
from humanplay.cli.pilot.environments import task_of
from humanplay.cli.pilot.errors import PilotError
from humanplay.web.simulate import Clock
from tests.app.tasks.test_gymnasium import begin
from tests.app.tasks.test_gymnasium import play as play_out
from tests.app.tasks.test_processes import HIDING
from tests.support.command import command
from tests.support.forked_server import Program
from tests.support.own_environment import Line, make_line
from tests.support.servers import RunningServer

START_PROCESS = running.start_process
"""Starts the server of a page in an interpreter of its own."""
SCRIPT = """
    import json, sys
    import httpx
    from humanplay import play
    import gymnasium as gym
    from mine import MyEnv

    class Mine(gym.Wrapper):
        pass

    plays = play({what}, wait=False, browser=False)
    board = httpx.Client(base_url=plays.link, headers={{"Origin": plays.link.rstrip("/")}})
    board.put("/api/me/name", json={{"name": "Ada"}}).raise_for_status()
    begun = board.post("/api/sessions", json={{"player": "human"}}).json()
    frame, path = begun["frame"], f"/api/sessions/{{begun['session']}}"
    while frame["outcome"] is None:
        move = {{"episode": frame["episode"], "step": frame["step"]}}
        board.post(f"{{path}}/act", json=move | {{"action": begun["task"]["actions"][1]}})
        frame = board.get(path).json()
    plays.close()
    findings = plays.verify()
    print(json.dumps({{"task": plays.task, "actions": begun["task"]["actions"], "findings": findings}}))
"""


@pytest.fixture
def opened(tmp_path):
    """`opened(env, ...)` calls `play` in the test folder; its page closes at the end."""
    pages = []

    def call(env, **options):
        options = {"database": tmp_path / "plays.db", "wait": False, "browser": False, **options}
        pages.append(play(env, **options))
        return pages[-1]

    yield call
    for plays in pages:
        plays.close()


@pytest.fixture
def browser_of():
    """`browser_of(plays)` is a client as a browser at the page's address."""
    with ExitStack() as clients:

        def come(plays):
            origin = plays.link.rstrip("/")
            options = {"headers": {"Origin": origin}, "follow_redirects": True, "trust_env": False}
            return clients.enter_context(httpx.Client(base_url=origin, **options))

        yield come


@pytest.mark.parametrize(
    ("env", "task"),
    [
        pytest.param("FrozenLake-v1", "FrozenLake-v1", id="id"),
        pytest.param(Line, "tests.support.own_environment:Line", id="class"),
        pytest.param(make_line, "tests.support.own_environment:make_line", id="function"),
    ],
)
def test_what_has_a_name_is_recorded_by_it(opened, browser_of, env, task):
    plays = opened(env)
    assert plays.task == f"gymnasium:{task}"
    assert browser_of(plays).get("/").status_code == 200


@pytest.mark.parametrize(
    "played",
    [
        "MyEnv",
        '"mine:MyEnv"',
        '"mine.py"',
        "lambda: MyEnv('rgb_array')",
        "Mine(gym.make('FrozenLake-v1', is_slippery=False))",
    ],
)
def test_a_script_plays_what_lies_beside_it(tmp_path, played):
    source = Path(make_line.__code__.co_filename).read_text()
    (tmp_path / "mine.py").write_text(source.replace("class Line", "class MyEnv"))
    script = tmp_path / "script.py"
    script.write_text(textwrap.dedent(SCRIPT.format(what=played)))
    program = Program(tmp_path, script)
    printed = program.printed()
    assert program.returncode == 0, printed
    answer = json.loads(printed.splitlines()[-1])
    assert answer["actions"] == (
        ["left", "down", "right", "up"] if "Lake" in played else ["0", "1"]
    )
    assert answer["findings"] == []
    is_held = "mine" not in played and played != "MyEnv"
    assert ("held:" if is_held else "gymnasium:mine:MyEnv") in answer["task"]
    assert (tmp_path / "plays.db").is_file()


def test_a_system_without_the_calls_of_linux_plays(opened, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(running, "start_process", START_PROCESS)
    (tmp_path / "sitecustomize.py").write_text(HIDING + "print('hidden', file=sys.stderr)")
    monkeypatch.syspath_prepend(tmp_path)
    plays = opened("FrozenLake-v1")
    server = RunningServer(urlsplit(plays.link).port, Clock())
    try:
        client = server.page()
        client.put("/api/me/name", json={"name": "Ada"}).raise_for_status()
        assert play_out(server, client, begin(server, client, player="human"))[-1]["outcome"]
    finally:
        server.close()
    assert plays.verify() == []
    plays.close()
    assert "hidden" in capfd.readouterr().out, "in the server's process, whose log is printed"


def test_whoever_comes_is_asked_for_a_name_before_the_first_episode(opened, browser_of):
    plays = opened("FrozenLake-v1")
    browser = browser_of(plays)
    assert "What are you called?" in browser.get("/").text
    assert browser.put("/api/me/name", json={"name": "Ada"}).json()["name"] == "Ada"
    assert "What are you called?" not in browser.get("/").text
    taken = browser_of(plays).put("/api/me/name", json={"name": "Ada"})
    assert taken.status_code == 409
    wrong = browser_of(plays).put("/api/me/name", json={"name": "?"})
    assert wrong.status_code == 422
    with closing(sqlite3.connect(plays.database)) as conn:
        assert conn.execute("SELECT count(*) FROM players").fetchone() == (1,), "Ada alone"


def test_invited_people_have_a_link_each_which_stays_theirs(opened, browser_of):
    plays = opened("FrozenLake-v1", people=2)
    tokens = [link.partition("=")[2] for link in plays.links]
    browsers = [browser_of(plays) for _ in plays.links]
    for browser, token in zip(browsers, tokens, strict=True):
        page = browser.get("/", params={"invitation": token})
        assert "What are you called?" not in page.text
    with closing(sqlite3.connect(plays.database)) as conn:
        names = [row[0] for row in conn.execute("SELECT name FROM names ORDER BY name")]
    assert names == ["Person 1", "Person 2"]
    again = opened("FrozenLake-v1", people=3)
    assert [link.partition("=")[2] for link in again.links][:2] == tokens
    assert not plays.is_open, "the page of the call before is closed"


def test_a_link_stays_its_person_s_after_a_new_name(opened, browser_of, capsys):
    plays = opened("FrozenLake-v1", people=2)
    tokens = [link.partition("=")[2] for link in plays.links]
    browser = browser_of(plays)
    browser.get("/", params={"invitation": tokens[0]})
    assert browser.put("/api/me/name", json={"name": "Ada"}).json()["name"] == "Ada"
    stranger = browser_of(plays)
    stranger.get("/")
    assert stranger.put("/api/me/name", json={"name": "Person 3"}).json()["name"] == "Person 3"
    again = opened("FrozenLake-v1", people=3)
    assert [link.partition("=")[2] for link in again.links][:2] == tokens
    third = browser_of(again)
    page = third.get("/", params={"invitation": again.links[2].partition("=")[2]})
    assert "What are you called?" in page.text, "a stranger has the name of the third"
    again.close()
    assert (
        command(capsys, "forget", "Ada", "--player", "--yes", "--database", plays.database)[0] == 0
    )
    after = opened("FrozenLake-v1", people=2)
    first, second = [link.partition("=")[2] for link in after.links]
    assert first != tokens[0]
    assert second == tokens[1]


def test_a_replay_of_what_a_program_holds_is_downloaded(serve):
    server = serve(task=task_of(lambda: Line("rgb_array")))
    client = server.page()
    frames = play_out(server, client, begin(server, client, player="human"), ["1"], input=None)
    answer = client.get(f"/replay/{frames[-1]['episode']}.html")
    assert answer.status_code == 200, answer.text
    assert answer.text.startswith("<!doctype html>")


def test_plays_are_called_by_their_title(opened):
    plays = opened(lambda: Line("rgb_array"))
    assert "held:" not in repr(plays)
    assert "plays of " in repr(plays)


@pytest.mark.parametrize("how", ["info", "observation", "method"])
def test_an_environment_is_recreated_by_actions_that_it_allows(how):
    env = gymnasium.make("tests.support.masked_environments:Doors-v0", how=how)
    assert task_of(env).startswith("gymnasium:")


def test_two_environments_that_cannot_be_compared_are_refused_with_the_line_to_write():
    gymnasium.register("Objects-v0", "tests.support.bad_habits:Objects", disable_env_checker=True)
    env = gymnasium.make("Objects-v0")
    with pytest.raises(PilotError, match=r"the two cannot be compared: .*play\(lambda: "):
        task_of(env)


def test_a_folder_called_like_an_id_is_no_world(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "FrozenLake-v1").mkdir()
    assert task_of("FrozenLake-v1") == "gymnasium:FrozenLake-v1"
    new = ("study", "new", "lake", "--env", "FrozenLake-v1", "--database", "studies.db")
    assert command(capsys, *new)[0] == 0
    assert "expected a world's environment.py" in command(capsys, *new[:-3], "./FrozenLake-v1")[2]


class Vector(gymnasium.vector.VectorEnv):
    """Steps many at once."""


@pytest.mark.parametrize(
    ("env", "text"),
    [
        pytest.param(Vector(), "Vector cannot be played: it steps many environments", id="vector"),
        pytest.param(Vector, "Vector cannot be played: it steps many environments", id="a class"),
        pytest.param(
            lambda: Vector(),
            "Vector cannot be played: it steps many environments",
            id="it makes one",
        ),
        pytest.param(
            f"{__name__}:Vector",
            "Vector cannot be played: it steps many environments",
            id="its name",
        ),
        pytest.param(object(), "expected an environment of Gymnasium", id="object"),
        pytest.param("no-such-file.py", "cannot read no-such-file.py", id="no file"),
        pytest.param("Nothing-v0", "Gymnasium knows no environment", id="no id"),
        pytest.param("nowhere:Env", "no module 'nowhere' in this folder", id="no module"),
        pytest.param(partial(int, "x"), "invalid keyword argument", id="raises"),
        pytest.param(
            lambda: gymnasium.make("CartPole-v1"), "render_mode='rgb_array'", id="no picture"
        ),
    ],
)
def test_what_cannot_be_played_is_refused_with_a_way_out(opened, env, text):
    with pytest.raises(PilotError, match=text):
        opened(env)


class Doubled(gymnasium.Wrapper):
    """Pays twice as much."""

    def step(self, action):
        observation, reward, *rest = super().step(action)
        return observation, 2 * reward, *rest


class Scaled(gymnasium.ObservationWrapper):
    """Takes an argument that nobody records."""

    def __init__(self, env, scale):
        super().__init__(env)
        self.scale = scale

    def observation(self, observation):
        return self.scale * observation


class Drifting(gymnasium.ObservationWrapper):
    """Shows something else the longer it is used."""

    steps = 0

    def observation(self, observation):
        self.steps += 1
        return observation + self.steps


def used(env, steps=3):
    """An environment after training."""
    env.reset()
    for _ in range(steps):
        env.step(env.action_space.sample())
    return env


def of_this_session(env):
    """An environment whose wrapper's class only this program has."""

    class Mine(Doubled):
        pass

    return Mine(env)


@pytest.mark.parametrize(
    ("make", "task"),
    [
        (lambda: gymnasium.make("FrozenLake-v1"), "FrozenLake-v1"),
        (
            lambda: Doubled(gymnasium.make("FrozenLake-v1", is_slippery=False)),
            '{"id":"FrozenLake-v1","kwargs":{"is_slippery":false},"wrappers":["tests.app.pilot.test_play:Doubled"]}',
        ),
        (
            lambda: gymnasium.make("CartPole-v1", max_episode_steps=7),
            '{"id":"CartPole-v1","max_steps":7}',
        ),
        (lambda: of_this_session(gymnasium.make("FrozenLake-v1")), '"held:Mine-of-FrozenLake-v1-'),
    ],
)
def test_an_environment_that_was_used_is_recreated_with_a_picture(make, task):
    assert task in task_of(used(make()))


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda: Line(),
            r"not made by gymnasium.make.*play\(lambda: Line\(render_mode='rgb_array'\)\)",
        ),
        (
            lambda: Scaled(gymnasium.make("FrozenLake-v1"), 3),
            r"cannot be made again: .*'scale'.*play\(lambda: Scaled\(gymnasium.make\('FrozenLake-v1'",
        ),
        (lambda: Drifting(gymnasium.make("FrozenLake-v1")), "its observation differs at step 0"),
    ],
)
def test_what_cannot_be_recreated_is_refused_with_the_line_to_write(make, text):
    with pytest.raises(PilotError, match=text):
        task_of(used(make()))


def other_kind(module, name):
    """A class as another package defines it."""
    return type(name, (), {"__module__": module})


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("stable_baselines3.common.vec_env.dummy_vec_env", "steps many environments at once"),
        ("pettingzoo.utils.env", "has several agents"),
        ("gym.core", "shimmy"),
    ],
)
def test_environments_of_other_kinds_are_refused_by_name(opened, module, text):
    with pytest.raises(PilotError, match=f"Other cannot be played: .*{text}"):
        opened(other_kind(module, "Other")())


def test_a_held_function_is_gone_with_its_program(tmp_path, capsys):
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent("""
        from humanplay import play
        from tests.support.own_environment import Line
        print(play(lambda: Line("rgb_array"), wait=False, browser=False).task)
    """)
    )
    environ = os.environ | {"PYTHONPATH": str(Path.cwd())}
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, cwd=tmp_path, env=environ
    )
    task = done.stdout.splitlines()[-1].removeprefix("gymnasium:")
    code, _, error = command(capsys, "study", "new", "pilot", "--env", task)
    assert code != 0
    assert "its function is gone" in error
    assert "move it into a module" in error


def test_importing_the_package_costs_little():
    code = "import time; begun = time.process_time(); import humanplay; print(time.process_time() - begun)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) <= 0.3
