"""A world of one's own, registered by its folder: served, played and verified."""

import json
import os
from contextlib import closing
from dataclasses import replace

import pytest

from humanplay import ROOT
from humanplay.db.reader import Reader
from humanplay.study.verification import verify_database
from humanplay.task.registration import WORLDS, environment_of, register, static_of
from humanplay.tasks.base import CodePolicies
from humanplay.tasks.costs import LOSS
from humanplay.tasks.text import TextConfig, TextRun
from humanplay.web.settings import Settings
from humanplay.web.simulate import NoisyPolicy, Plan, simulate
from tests.support.command import command
from tests.support.declared import DECLARATIONS_FILE
from tests.support.servers import eventually

MAZE = ROOT / "examples" / "worlds" / "maze"


class PacesRun(TextRun):
    """A world in which each move scores."""

    names, version = ("on",), "paces 1"

    def begin(self):
        """Nothing is set up."""

    def move(self, action):
        """Score half a point."""
        self.score += 0.5
        return 0.5

    def observation(self):
        """The score."""
        return str(self.score)


class LeavingRun(PacesRun):
    """A world in which giving up costs a point, with scores of its own."""

    def begin(self):
        """Set up what `observation` shows."""
        self.scores = {"Ada": 7}

    def abandon(self):
        """Lose a point."""
        super().abandon()
        self.score -= 1

    def observation(self):
        """The table of scores."""
        return json.dumps(self.scores)


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


@pytest.mark.parametrize("values", [{"width": 9}, {"side": "9"}, {"side": 8}])
def test_settings_that_are_none_of_its_are_refused(maze, values):
    with pytest.raises(ValueError, match="expected"):
        environment_of(maze).configuration(values)


def test_a_path_has_the_score_after_each_move():
    run = PacesRun(TextConfig(3), 1)
    for _ in range(3):
        run.step(0)
    assert json.loads(run.view().history("any"))["headlines"] == [0.0, 0.5, 1.0, 1.5]


def test_the_last_frame_has_the_score_that_is_stored():
    run = LeavingRun(TextConfig(3), 1)
    run.step(0)
    run.step(0)
    run.abandon()
    view = run.view()
    assert run.record().score == 0.0
    assert json.loads(view.frame("any"))["score"] == 0.0
    assert json.loads(view.history("any"))["headlines"] == [0.0, 0.5, 0.0]
    assert json.loads(view.observation()) == {"Ada": 7}


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


def test_words_for_no_column_are_refused_at_the_start(tmp_path, maze, monkeypatch):
    from humanplay.web.server import ServerError, run

    about = replace(environment_of(maze).about, columns={"episodes.retrun": "the score"})
    monkeypatch.setattr(type(environment_of(maze)), "about", about)
    with pytest.raises(ServerError, match=r"got 'episodes\.retrun'"):
        run(Settings(database=tmp_path / "play.db", port=0, task=maze))


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
    simulate(Plan(server.url, "way", 2, speed=1000.0), outcomes)
    assert [(outcome.stage, outcome.ranked) for outcome in outcomes] == [("complete", 2)] * 2
    with closing(Reader.open(tmp_path / "playground.db")) as reader:
        (script,) = reader.query("SELECT DISTINCT script FROM participants")
    assert script == {"script": "far-wall, 10% random moves"}


def by_keys(server, client, session, policy):
    """Play a maze to its end by keys, as a policy would; return the last frame."""
    policy.reset()
    with server.socket(session, client) as socket:
        frame = socket.receive("frame")
        while frame["outcome"] is None:
            socket.act(frame, policy.choose(frame), input="key")
            frame = socket.frame_after(frame["step"])
    return frame


def all_ready(client, path):
    """An answer's policies by name, once all have figures; False until then."""
    policies = client.get(path).json()["policies"]
    return all(policy["state"] == "ready" for policy in policies) and {
        policy["name"]: policy for policy in policies
    }


def with_places(people):
    """The people's board, once the expert has played what they have; until then False."""
    return not people["comparing"] and people


def far_wall(maze):
    return NoisyPolicy(environment_of(maze), "far-wall", 0.0, None)


def test_it_has_a_daily_maze_with_ranks_and_results_of_its_policies(serve, maze):
    server = serve(task=maze)
    client = server.page()
    assert client.get("/api/task").json()["has_boards"]
    today = client.get("/api/daily").json()
    assert (today["level"], today["size"], today["max_steps"]) == ("maze", [9, 9], 120)
    board = client.post("/api/daily").json()
    frame = by_keys(server, client, board["session"], far_wall(maze))
    results = eventually(lambda: client.get(f"/api/daily/{today['day']}/results").json())
    assert results["attempt"]["unranked"] is None
    mine = {"outcome": "succeeded", "moves": frame["step"], "coverage": None, "you": True}
    assert results["people"]["table"] == [{**mine, "rank": 1}]
    assert results["people"]["moves"] == [[frame["step"], 1]]
    policies = eventually(lambda: all_ready(client, f"/api/daily/{today['day']}/results"))
    assert policies["far-wall"]["moves"] == frame["step"]
    other = server.page()
    board = other.post("/api/daily").json()
    with server.socket(board["session"], other) as socket:
        frame = socket.receive("frame")
        for _ in range(120):  # up against the wall, to the limit
            socket.act(frame, "up", input="key")
            frame = socket.frame_after(frame["step"])
    people = other.get(f"/api/daily/{today['day']}/results").json()["people"]
    assert (people["players"], people["unfinished"], people["you"]["rank"]) == (2, 1, 2)


def test_its_leaderboard_shows_people_and_policies(serve, maze):
    server = serve(task=maze)
    client = server.page()
    (board,) = client.get("/api/leaderboard").json()
    assert (board["id"], board["title"], board["place"]) == ("maze", "Maze 9 × 9", "Maze 9 × 9")

    policies = eventually(lambda: all_ready(client, "/api/leaderboard/maze?evaluate=true"))
    figures = {name: policy["figure"] for name, policy in policies.items()}
    assert figures["far-wall"]["completed"] == 1
    assert figures["far-wall"]["steps"]["mean"] < figures["random"]["steps"]["mean"]
    assert figures["far-wall"].keys().isdisjoint({"curve", "visits"})
    for _ in range(5):
        session = client.post("/api/sessions", json={}).json()["session"]
        by_keys(server, client, session, far_wall(maze))
    client.put("/api/me/name", json={"name": "Ada"})
    people = eventually(lambda: with_places(client.get("/api/people").json()))
    assert people["title"] == "Maze 9 × 9"
    (ada,) = people["people"]
    assert (ada["name"], ada["terrains"], ada["behind"]) == ("Ada", 5, 0)
    bests = client.get("/api/me/history").json()["bests"]
    assert [(best["place"], best["episodes"], best["successes"]) for best in bests] == [
        ("Maze 9 × 9", 5, 5)
    ]


def test_the_figures_of_its_policies_are_made_by_the_command(maze, tmp_path, capsys):
    out = tmp_path / "figures"
    code, output, _ = command(capsys, "leaderboard", "--env", MAZE, "--out", out)
    assert (code, output.strip()) == (0, str(out / "maze.json"))
    figures = json.loads((out / "maze.json").read_text())["policies"]
    assert [figure["policy"] for figure in figures] == ["far-wall", "random"]
    assert len(figures[0]["steps"]) == 100


def test_its_moves_cost_what_its_policy_then_needs_more(serve, maze):
    server = serve(task=maze)
    client = server.page()
    environment = environment_of(maze)
    config = environment.configuration({})
    expert = environment.policies.load("far-wall")
    shortest = len(environment.policies.play(expert, config, 3, 0).record().actions)
    about = client.post("/api/sessions", json={"seed": 3}).json()
    policy = far_wall(maze)
    policy.reset()
    with server.socket(about["session"], client) as socket:
        frame = socket.receive("frame")
        choices = ["up", "up"]
        while frame["outcome"] is None:
            best = policy.choose(frame)
            socket.act(frame, choices.pop() if choices else best, input="key")
            frame = socket.frame_after(frame["step"])
    costs = client.get(f"/api/episodes/{frame['episode']}/costs").json()
    assert (costs["policy"], costs["expert_moves"]) == ("far-wall", shortest)
    assert costs["counts"] == frame["step"]
    assert costs["total"] == frame["step"] - shortest
    assert sum(move["cost"] for move in costs["expert"]) == costs["total"]
    first, names = costs["expert"][0], environment.actions
    assert first["needs"] == first["after"][names.index(first["action"])] + 1 == shortest
    assert first["after"][names.index("up")] - first["needs"] + 1 == first["cost"]
    ghost = client.get(f"/api/episodes/{frame['episode']}/ghost").json()
    assert (ghost["name"], len(ghost["actions"])) == ("far-wall", shortest)


def test_an_episode_that_was_left_costs_what_giving_up_does(maze):
    environment = environment_of(maze)
    config = environment.configuration({})
    run = environment.run(config, 3, bytes([1]))
    run.abandon()
    record = run.record()
    costs = environment.courses.estimator("far-wall", None).costs(record)
    assert len(costs.costs) == 1
    assert len(costs.advice.actions) == 2
    assert costs.without_move == config.limit - costs.lengths[-1] > 0
    assert costs.costs.sum() + costs.without_move == costs.total
    assert sum(costs.by_kind().values()) + costs.gained == costs.total
    assert costs.by_tenth().sum() == costs.costs.sum()


def test_only_a_move_that_ended_an_episode_ended_it_early(maze):
    environment = environment_of(maze)
    expert, roomy = environment.policies.load("far-wall"), environment.configuration({})
    way = environment.policies.play(expert, roomy, 3, 0).record().actions
    config = environment.configuration({"limit": len(way) + 1})
    there_and_back = bytes([way[0], (way[0] + 2) % 4])
    run = environment.run(config, 3, there_and_back)
    run.abandon()
    costs = environment.courses.estimator("far-wall", None).costs(run.record())
    assert costs.lengths[-1] == config.limit, "nobody can succeed any more"
    assert costs.kinds == (None, LOSS)


def test_a_world_without_policies_of_its_own_has_no_expert(maze):
    policies = CodePolicies(environment_of(maze), (), lambda frame: frame["text"])
    assert (policies.shown, policies.simulated, policies.compared) == (None, None, ("random",))


def test_moves_that_would_take_too_long_to_judge_are_not_judged(maze):
    environment = environment_of(maze)
    config = environment.configuration({"limit": 1000})
    with pytest.raises(ValueError, match=r"at most 1,000,000 moves .* 4 actions need 4,000,000"):
        environment.courses.check_judged(config)
