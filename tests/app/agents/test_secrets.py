"""Nothing tells an evaluation's terrains before it closes: no route, no command."""

import dataclasses
import json
import re
import subprocess
import sys
from itertools import combinations
from pathlib import Path

import pytest
from numpy import packbits

from humanplay.agents.cards import CardError
from humanplay.study.folder import Folder
from marsexplorer.config import EnvConfig
from marsexplorer.terrain import generate
from tests.support.agents import Agent, begun, evaluation_of, own, paths, rows_of, token_of
from tests.support.command import command, run
from tests.support.policy_files import write_onnx
from tests.support.stored_studies import freeze, play_study

PATH_ENV = "gymnasium:tests.support.environments:Path-v0"


@pytest.fixture
def root(tmp_path):
    """A closed study with its secret kept, and an open evaluation on its terrains."""
    study = freeze(tmp_path / "playground.db-studies", close=False)
    play_study(tmp_path / "playground.db", study)
    assert run("study", "close", "dunes", "--keep-secret", "--yes", *paths(tmp_path)) == 0
    begun(tmp_path / "playground.db", of="dunes")
    return tmp_path


def secrets_of(root):
    """All that would reveal an instance: secrets, seeds, packed maps."""
    study = Folder(root / "playground.db-studies").study("dunes")
    seeds = [study.seed("ranked", index) for index in range(3)]
    maps = [packbits(generate(study.protocol.env_config, seed)).tobytes().hex() for seed in seeds]
    own_secret = evaluation_of(root / "playground.db").secret.hex()
    return [study.secret.hex(), own_secret, *map(str, seeds), *maps]


def test_no_route_tells_anything_of_a_terrain_that_agents_play(serve, root):
    server = serve(admin_password="long enough 1")
    agent = Agent(server, token_of(root / "playground.db"))
    agent.play(0)
    agent.play(1, moves=3)
    rows = server.services.store.connection.execute(
        "SELECT id, session_id FROM episodes"
    ).fetchall()
    ids = {ident for row in rows for ident in row}
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
                    leaks = [secret for secret in hidden if secret in answer.text]
                    assert not leaks, (url, leaks)
                    if who is not operator:
                        assert not [
                            ident for ident in ids if ident in answer.text and ident not in url
                        ], url
    assert asked > 100
    stranger = server.client()
    for file in ("opening.json", "comparison.json", "receipts/x.json", "secret", "../dunes/secret"):
        assert stranger.get(f"/api/evaluations/agents/files/{file}").status_code == 404, file
    about = stranger.get("/api/evaluations/agents").json()
    assert (about["status"], about["secret"], about["comparison"]) == ("open", None, None)
    page = stranger.get("/evaluations/agents")
    assert "no score is told before it closes" in page.text
    for export in ("report", "release"):
        refused = operator.post(f"/api/admin/studies/dunes/exports/{export}", json={"authors": []})
        says_why = "its secret kept" in refused.json()["detail"]
        assert (refused.status_code, says_why) == (409, True)
    assert stranger.post("/api/studies/agents/join").status_code == 404
    assert [study["name"] for study in stranger.get("/api/studies").json()] == ["dunes"]


def test_no_command_tells_a_secret_of_an_open_evaluation(root, capsys):
    for words in (["agents", "show"], ["agents", "show", "agents"], ["study", "show", "dunes"]):
        code, out, errors = command(capsys, *words, *paths(root))
        assert code == 0, errors
        assert not [secret for secret in secrets_of(root) if secret in out + errors]


def alike(agent, instances, moves):
    """Yield the answers on pairs of instances that have looked the same so far."""
    answers = {}
    for index in range(instances):
        calls = [agent.call("begin", index)]
        calls += [agent.call("act", index, move) for move in moves]
        if calls[-1].done:
            continue
        calls.append(agent.call("begin", index))
        for arguments in ((index, 99), (index, 0, 77), (instances, 0)):
            with pytest.raises(CardError) as refusal:
                agent.call("act", *arguments)
            calls.append((refusal.value.status, str(refusal.value)))
        text = json.dumps(
            [
                dataclasses.asdict(answer) if dataclasses.is_dataclass(answer) else answer
                for answer in calls
            ]
        )
        answers[index] = text.replace(f'"index": {index},', '"index": 0,').replace(
            f"instance {index}:", "instance 0:"
        )
    for one, other in combinations(answers, 2):
        shown = [json.loads(answers[index])[: len(moves) + 1] for index in (one, other)]
        if [view["observation"] for view in shown[0]] == [view["observation"] for view in shown[1]]:
            yield answers[one], answers[other]


def test_two_instances_that_look_alike_so_far_answer_alike(serve, tmp_path):
    config = EnvConfig("random", 7, 9, sensor_radius=2)
    own(tmp_path / "playground.db", task="mars", config=config, instances=40)
    agent = Agent(serve(), token_of(tmp_path / "playground.db"))
    evaluation = evaluation_of(tmp_path / "playground.db")
    pairs = list(alike(agent, 40, ["east"]))
    assert len(pairs) > 3
    assert len({generate(config, evaluation.seed(i)).tobytes() for i in range(40)}) > 30
    for one, other in pairs:
        assert one == other


def test_the_same_holds_of_another_environment(serve, tmp_path, briefly_examined):
    own(tmp_path / "playground.db", task=PATH_ENV, instances=6)
    agent = Agent(serve(task=PATH_ENV), token_of(tmp_path / "playground.db"))
    pairs = list(alike(agent, 6, ["wave", "forward"]))
    assert len(pairs) > 3
    assert all(one == other for one, other in pairs)


def test_what_may_be_evaluated_and_closed_in_which_order(tmp_path, capsys):
    folder, database = Folder(tmp_path / "playground.db-studies"), tmp_path / "playground.db"
    play_study(database, freeze(tmp_path / "playground.db-studies", close=False))

    def asked(*words):
        code, out, errors = command(capsys, *words, *paths(tmp_path))
        return code, out + errors

    begin = asked("agents", "new", "agents", "--of", "dunes")  # while people may still play
    assert (begin[0], folder.study("dunes").commitment in begin[1]) == (0, True)
    second = asked("agents", "new", "second", "--of", "dunes")
    assert (second[0], "plays the terrains of 'dunes' already" in second[1]) == (2, True)
    close = "agents", "close", "agents", "--yes"
    early = asked(*close)
    assert (early[0], "people still play these terrains" in early[1]) == (2, True)
    closed = asked("study", "close", "dunes", "--keep-secret", "--yes")
    assert (closed[0], folder.status("dunes")) == (0, "secret kept"), closed
    assert asked(*close)[0] == 0
    assert folder.study("dunes").closed_ms is not None
    third = asked("agents", "new", "third", "--of", "dunes")
    assert (third[0], "without --keep-secret, and its terrains are known" in third[1]) == (2, True)
    assert asked("agents", "card", "agents", "--author", "Ann")[0] == 2
    assert asked("verify")[0] == 0


def test_an_evaluation_is_not_closed_while_an_agent_is_at_it(serve, tmp_path, capsys):
    database = tmp_path / "playground.db"
    own(database, task="mars", config=EnvConfig("random", 7, 9), instances=2)
    agent = Agent(serve(), token_of(database))
    agent.play(0, moves=1)
    close = "agents", "close", "agents", "--yes", *paths(tmp_path)
    code, _, errors = command(capsys, *close)
    assert (code, "1 agent has moved" in errors, evaluation_of(database).is_open) == (2, True, True)
    assert command(capsys, *close, "--now")[0] == 0
    sql = "SELECT json_extract(came_to, '$.outcome') FROM agents_attempts"
    assert rows_of(database, sql) == [("abandoned",)]


def test_nothing_is_closed_where_no_receipt_could_be_signed(tmp_path):
    own(tmp_path / "playground.db", task="mars", config=EnvConfig("random", 7, 9), instances=1)
    code = (
        "import sys; sys.modules['cryptography'] = None; "
        "from humanplay.cli.main import main; main()"
    )
    words = ("agents", "close", "agents", "--yes", *paths(tmp_path))
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)
    assert done.returncode
    assert "cryptography is not installed: `pip install" in done.stderr
    assert evaluation_of(tmp_path / "playground.db").is_open


def test_nothing_is_closed_where_a_policys_file_is_lost(tmp_path, capsys):
    file, database = write_onnx(tmp_path / "mine.onnx", seed=1), tmp_path / "playground.db"
    config = EnvConfig("random", 6, 7, sensor_radius=3)
    own(database, task="mars", config=config, instances=1, policies=(str(file),))
    content = file.read_bytes()
    file.unlink()
    close = "agents", "close", "agents", "--yes", *paths(tmp_path)
    code, _, errors = command(capsys, *close)
    assert (code, errors.count("\n"), evaluation_of(database).is_open) == (1, 1, True)
    file.write_bytes(content)
    assert command(capsys, *close)[0] == 0


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ("new x --task mars --hours 0", "hours must be more than 0, got 0.0"),
        ("new x --task mars --calls 0", "calls must be at least 1, got 0"),
        ("new x", "expected either --of STUDY or --task ID"),
        ("revoke nosuch 7K3M", "no evaluation 'nosuch'"),
    ],
)
def test_a_mistake_with_an_evaluation_is_one_sentence(tmp_path, capsys, words, part):
    code, _, errors = command(capsys, "agents", *words.split(), *paths(tmp_path))
    assert (code, part in errors, errors.count("\n")) == (2, True, 1)


def test_agents_enter_no_figure_of_people(serve, root, capsys):
    server = serve()
    before = [server.client().get(url).json() for url in ("/api/human-level", "/api/leaderboard")]
    Agent(server, token_of(root / "playground.db")).play_all()
    assert [
        server.client().get(url).json() for url in ("/api/human-level", "/api/leaderboard")
    ] == before
    assert server.services.store.connection.execute(
        "SELECT count(*) FROM volunteers"
    ).fetchall() == [(0,)]
    assert rows_of(root / "playground.db", "SELECT count(*) FROM agents_moves") != [(0,)]
    assert rows_of(
        root / "playground.db", "SELECT count(*) FROM episodes WHERE driver = 'script'"
    ) == rows_of(
        root / "playground.db",
        "SELECT count(*) FROM episodes WHERE driver = 'script' AND id LIKE 'episode-%'",
    )


ROOM = re.compile(
    r"[Rr]eceipt|[Ss]ealed|(?i:open_?env)|\bMCP\b|[Aa]gents?\b.{0,3} cards?\b|CardError"
)


def test_the_rooms_words_stand_in_the_room_and_its_page_alone():
    top = Path(__file__).parents[3]
    leaks = [
        f"{path.relative_to(top)}: {line.strip()}"
        for folder in ("app/humanplay", "static")
        for path in sorted((top / folder).rglob("*"))
        if path.suffix in {".py", ".txt", ".sql", ".js", ".ts", ".html", ".css", ".toml"}
        and "agents" not in path.relative_to(top).parts
        for line in path.read_text(encoding="utf-8").splitlines()
        if ROOM.search(line)
    ]
    assert leaks == []
