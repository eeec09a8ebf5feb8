"""Nothing tells a sealed terrain: no route, no command, no message of an attempt, until the evaluation closes."""

import dataclasses
import json
import subprocess
import sys
from itertools import combinations

import pytest
from numpy import packbits

from humanplay.db.store import Store
from humanplay.series.cards import CardError
from humanplay.series.evaluation import evaluation_of_study, evaluation_of_task
from humanplay.series.folder import Folder, StudyError
from humanplay.series.protocol import Agents, default_protocol
from humanplay.series.verification import verify_database
from marsexplorer.config import EnvConfig
from marsexplorer.terrain import generate
from tests.support.agents import Agent, own, sealed, token_of
from tests.support.command import command, run
from tests.support.policy_files import write_onnx
from tests.support.stored_studies import freeze, play_study

PATH_ENV = "gymnasium:tests.support.environments:Path-v0"


@pytest.fixture
def root(tmp_path):
    """A study that three have played and that was closed sealed, and an open evaluation on its terrains."""
    study = freeze(tmp_path / "playground.db-studies", close=False)
    play_study(tmp_path / "playground.db", study)
    assert run("study", "close", "dunes", "--sealed", "--yes", *paths(tmp_path)) == 0
    sealed(tmp_path / "playground.db-studies", of="dunes")
    return tmp_path


def paths(root, *more):
    return ["--database", root / "playground.db", *more]


def secrets_of(root):
    """All that would reveal an instance: secrets, seeds, packed maps."""
    found = []
    for name in ("dunes", "agents"):
        study = Folder(root / "playground.db-studies").study(name)
        seeds = [study.seed("ranked", index) for index in range(3)]
        maps = [
            packbits(generate(study.protocol.env_config, seed)).tobytes().hex() for seed in seeds
        ]
        found += [study.secret.hex(), *map(str, seeds), *maps]
    return list(dict.fromkeys(found))


def test_no_route_tells_anything_of_a_sealed_terrain(serve, root):
    server = serve(admin_password="long enough 1")
    agent = Agent(server, token_of(root / "playground.db-studies"))
    agent.play(0)
    agent.play(1, moves=3)
    rows = server.services.store.connection.execute(
        "SELECT id, session_id FROM episodes"
    ).fetchall()
    ids = {each for row in rows for each in row}
    operator = server.page()
    assert operator.post("/api/admin/login", json={"password": "long enough 1"}).status_code == 200
    asked, hidden, strangers = 0, secrets_of(root), server.client()
    rows = [rows[-1], rows[-2], next(row for row in rows if row[0].startswith("episode-"))]
    fixed = {
        "table": "episodes",
        "fmt": "csv",
        "index": "0",
        "date": "2026-09-22",
        "board": "dunes",
        "file": "opening.json",
    }
    for path, calls in server.app.openapi()["paths"].items():
        if "get" not in calls:
            continue
        for episode, session in rows if "_id}" in path else rows[:1]:
            filled = {**fixed, "episode_id": episode, "session_id": session, "watch_id": episode}
            for name in ("agents", "dunes"):
                url = path.replace(":path}", "}").replace("{name}", name)
                for hole, value in filled.items():
                    url = url.replace(f"{{{hole}}}", value)
                for who in (strangers, operator):
                    answer = who.get(url, params={"index": 0})
                    asked += 1
                    told = [each for each in hidden if each in answer.text]
                    assert not told, (url, told)
                    if who is not operator:
                        assert not [
                            each for each in ids if each in answer.text and each not in url
                        ], url
    assert asked > 100
    stranger = server.client()
    for file in ("opening.json", "comparison.json", "receipts/x.json", "secret", "../dunes/secret"):
        assert stranger.get(f"/api/evaluations/agents/files/{file}").status_code in (404, 409), file
    refused = stranger.get("/api/evaluations/agents/episodes?index=0")
    assert (refused.status_code, "is sealed" in refused.json()["detail"]) == (409, True)
    about = stranger.get("/api/evaluations/agents").json()
    assert (about["status"], about["secret"], about["comparison"]) == ("open", None, None)
    page = stranger.get("/evaluations/agents")
    assert "no score is told before it closes" in page.text
    for name in ("dunes", "agents"):
        for what in ("report", "release"):
            refused = operator.post(
                f"/api/admin/studies/{name}/exports/{what}", json={"authors": []}
            )
            assert (refused.status_code, "is sealed" in refused.json()["detail"]) == (409, True)
    joined = stranger.post("/api/studies/agents/join")
    assert joined.status_code == 404
    assert [each["name"] for each in stranger.get("/api/studies").json()] == ["dunes"]


def test_every_command_refuses_a_sealed_terrain_with_a_sentence(root, capsys, tmp_path):
    for words in (["report"], ["costs"], ["release", "--out", tmp_path / "bundle"]):
        for name in ("dunes", "agents"):
            code, out, said = command(capsys, words[0], "--study", name, *words[1:], *paths(root))
            if (words[0], name) != ("release", "agents"):
                assert (code != 0, "is sealed" in said) == (True, True), (words, name, said)
            assert not [each for each in secrets_of(root) if each in out + said]
            assert code != 0
    assert not (tmp_path / "bundle").exists()
    code, _, said = command(
        capsys, "export", "--database", root / "playground.db", "--out", tmp_path / "csv"
    )
    assert code == 0, said
    code, out, _ = command(
        capsys, "export", "--database", root / "playground.db", "--out", tmp_path / "csv"
    )
    assert "left out: dunes" in out
    assert "sealed until the evaluation of agents closes" in out
    for path in (tmp_path / "csv").iterdir():
        assert path.read_text().count("\n") == 1, path
    for name in ("dunes", "agents"):
        code, out, _ = command(capsys, "study", "show", name, "--database", root / "playground.db")
        assert not [each for each in secrets_of(root) if each in out]
    code, out, said = command(
        capsys, "evaluation", "show", "agents", "--database", root / "playground.db"
    )
    assert not [each for each in secrets_of(root) if each in out + said]
    code, _, said = command(
        capsys,
        "replay",
        "episode",
        "--out",
        tmp_path / "r.html",
        "--database",
        root / "playground.db",
    )
    assert (code, "no finished episode" in said) == (2, True)
    code, _, said = command(capsys, "study", "close", "dunes", "--yes", *paths(root))
    assert (code, "agents are evaluated on the terrains" in said) == (2, True)


def test_a_participant_is_shown_no_ranked_terrain_before_the_evaluation_closes(serve, tmp_path):
    from tests.support.study import Person
    from tests.support.study import freeze as freeze_small

    freeze_small(tmp_path / "playground.db-studies")
    folder = Folder(tmp_path / "playground.db-studies")
    server = serve()
    person = Person(server)
    person.to_warm_up()
    person.play_on()
    folder.close("small", seals=True)
    sealed(tmp_path / "playground.db-studies")
    for url in ("debrief/0?phase=ranked", "debrief/0/costs?phase=ranked"):
        answer = person.client.get(f"/api/studies/small/{url}")
        assert (answer.status_code, "'small' is sealed" in answer.json()["detail"]) == (409, True)
    assert person.client.get("/api/studies/small/debrief/0").status_code == 200  # warm-up
    assert person.client.get("/api/me/history").json()["episodes"] == []
    assert person.me()["debrief"]["ranked_terrains"] == 0
    folder.close("agents")
    assert person.client.get("/api/studies/small/debrief/0?phase=ranked").status_code == 200


def alike(agent, instances, moves):
    """Yield pairs of instances that have looked the same so far, with what each call on them told."""
    told = {}
    for index in range(instances):
        calls = [agent.call("begin", index)]
        calls += [agent.call("act", index, move) for move in moves]
        if calls[-1].done:
            continue
        calls.append(agent.call("begin", index))
        for given in ((index, 99), (index, 0, 77), (instances, 0)):
            with pytest.raises(CardError) as refusal:
                agent.call("act", *given)
            calls.append((refusal.value.status, str(refusal.value)))
        text = json.dumps(
            [dataclasses.asdict(each) if dataclasses.is_dataclass(each) else each for each in calls]
        )
        told[index] = text.replace(f'"index": {index},', '"index": 0,').replace(
            f"instance {index}:", "instance 0:"
        )
    for one, other in combinations(told, 2):
        shown = [json.loads(told[each])[: len(moves) + 1] for each in (one, other)]
        if [each["observation"] for each in shown[0]] == [each["observation"] for each in shown[1]]:
            yield told[one], told[other]


def test_two_instances_that_look_alike_so_far_answer_alike(serve, tmp_path):
    config = EnvConfig("random", 7, 9, sensor_radius=2)
    own(tmp_path / "playground.db-studies", task="mars", config=config, instances=40)
    agent = Agent(serve(), token_of(tmp_path / "playground.db-studies"))
    study = Folder(tmp_path / "playground.db-studies").study("agents")
    pairs = list(alike(agent, 40, ["east"]))
    assert len(pairs) > 3
    assert len({generate(config, study.seed("ranked", i)).tobytes() for i in range(40)}) > 30
    for one, other in pairs:
        assert one == other


def test_the_same_holds_of_another_environment(serve, tmp_path, briefly_examined):
    own(tmp_path / "playground.db-studies", task=PATH_ENV, instances=6)
    agent = Agent(serve(task=PATH_ENV), token_of(tmp_path / "playground.db-studies"))
    pairs = list(alike(agent, 6, ["wave", "forward"]))
    assert len(pairs) > 3
    assert all(one == other for one, other in pairs)


def test_what_may_be_sealed_evaluated_and_closed_in_which_order(tmp_path, capsys):
    folder, database = Folder(tmp_path / "playground.db-studies"), tmp_path / "playground.db"
    study = freeze(tmp_path / "playground.db-studies", close=False)
    play_study(database, study)
    sealed(tmp_path / "playground.db-studies", of="dunes")  # while people may still play
    with pytest.raises(StudyError, match="close it with --sealed"):
        folder.close("dunes")
    with pytest.raises(StudyError, match="people still play these terrains"):
        folder.close("agents")
    code, out, said = command(
        capsys, "study", "close", "dunes", "--sealed", "--yes", *paths(tmp_path)
    )
    assert (code, "is sealed" in out) == (0, True), said
    assert folder.status("dunes") == "sealed"
    with pytest.raises(StudyError, match="nothing to seal"):
        folder.close("dunes", seals=True)
    folder.create(evaluation_of_study(folder, "second", "dunes", Agents()))
    with pytest.raises(StudyError, match="plays the terrains of 'dunes' already"):
        folder.freeze("second")
    code, _, said = command(capsys, "evaluation", "close", "agents", "--yes", *paths(tmp_path))
    assert code == 0, said
    assert folder.study("dunes").closed_ms == folder.study("agents").closed_ms
    with pytest.raises(StudyError, match="its terrains are known"):
        folder.freeze("second")
    with pytest.raises(StudyError, match="its terrains are known, and it cannot be sealed"):
        folder.close("dunes", seals=True)
    code, out, _ = command(
        capsys,
        "evaluation",
        "new",
        "third",
        "--of",
        "dunes",
        "--database",
        tmp_path / "playground.db",
    )
    assert (code, "Not paired: the study 'dunes' was closed without --sealed" in out) == (0, True)
    third = folder.freeze("third")
    assert third.paired is None
    assert third.seed("ranked", 0) != folder.study("dunes").seed("ranked", 0)
    assert third.protocol.env_config == study.protocol.env_config
    assert verify_database(database).findings == ()


@pytest.mark.parametrize("verb", ["freeze", "close"])
def test_people_and_agents_are_each_frozen_and_closed_by_their_own_command(tmp_path, capsys, verb):
    folder, config = Folder(tmp_path / "playground.db-studies"), EnvConfig("random", 7, 9)
    folder.create(default_protocol("dunes", config, warm_up=1, ranked=1))
    folder.create(evaluation_of_task("agents", config, "mars", 1, Agents()))
    for asked, name, right in (
        ("evaluation", "dunes", "of people: `marsexplorer study"),
        ("study", "agents", "of agents: `marsexplorer evaluation"),
    ):
        code, _, said = command(capsys, asked, verb, name, *paths(tmp_path))
        assert (code, f"{name!r} is {right} {verb} {name}`" in said) == (2, True)
        assert folder.status(name) == "draft"


def test_nothing_is_closed_where_no_receipt_could_be_signed(tmp_path):
    own(
        tmp_path / "playground.db-studies",
        task="mars",
        config=EnvConfig("random", 7, 9),
        instances=1,
    )
    code = (
        "import sys; sys.modules['matplotlib'] = None; from humanplay.cli.main import main; main()"
    )
    words = ("evaluation", "close", "agents", "--yes", *paths(tmp_path))
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)
    assert done.returncode
    assert "needs the extra [export]" in done.stderr
    assert Folder(tmp_path / "playground.db-studies").status("agents") == "open"


def test_nothing_is_closed_where_a_policys_file_is_lost_and_receipts_wait_for_it(tmp_path, capsys):
    folder, file = (
        Folder(tmp_path / "playground.db-studies"),
        write_onnx(tmp_path / "mine.onnx", seed=1),
    )
    rest = {"policies": (str(file),), "debrief_policy": None}
    config = EnvConfig("random", 6, 7, sensor_radius=3)
    folder.create(evaluation_of_task("agents", config, "mars", 1, Agents(), **rest))
    folder.freeze("agents")
    kept = folder.study("agents").policy_files.place(str(file))
    content = kept.read_bytes()
    file.unlink(), kept.unlink()
    Store(tmp_path / "playground.db").close()
    close = "evaluation", "close", "agents", "--yes", *paths(tmp_path)
    lost = "that file is not here; no other one is played in its place"
    code, _, said = command(capsys, *close)
    assert (code, lost in said, folder.status("agents")) == (1, True, "open")
    folder.close("agents")
    code, _, said = command(capsys, *close)
    assert (code, lost in said, said.count("\n")) == (1, True, 1)
    kept.write_bytes(content)
    assert command(capsys, *close)[0] == 0


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ("new x --task mars --hours 0", "hours must be more than 0, got 0.0"),
        ("new x --task mars --calls 0", "calls must be at least 1, got 0"),
        ("revoke nosuch 7K3M", "no study 'nosuch'"),
    ],
)
def test_a_mistake_with_an_evaluation_is_one_sentence(tmp_path, capsys, words, part):
    code, _, said = command(
        capsys, "evaluation", *words.split(), "--database", tmp_path / "play.db"
    )
    assert (code, part in said, said.count("\n")) == (2, True, 1)


def test_agents_enter_no_figure_of_people(serve, root, capsys):
    server = serve()
    before = [server.client().get(url).json() for url in ("/api/human-level", "/api/leaderboard")]
    Agent(server, token_of(root / "playground.db-studies")).play_all()
    assert [
        server.client().get(url).json() for url in ("/api/human-level", "/api/leaderboard")
    ] == before
    assert server.services.store.connection.execute(
        "SELECT count(*) FROM volunteers"
    ).fetchall() == [(0,)]
    Folder(root / "playground.db-studies").close("agents")
    server.stop()
    found = root / "report.json"
    code, _, said = command(
        capsys,
        "report",
        "--study",
        "dunes",
        "--no-policies",
        "--no-moves",
        "--json",
        found,
        *paths(root),
    )
    assert code == 0, said
    report = json.loads(found.read_text())
    assert report["groups"][0]["joined"] == 2
    assert report["scripts"] == {"noisy-frontier": 1}
