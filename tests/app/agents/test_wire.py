"""A card's address speaks OpenEnv's protocol and MCP, and survives lost lines."""

import json
import logging
import threading
from contextlib import contextmanager, suppress

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from humanplay.agents.cards import NO_CARD
from humanplay.tasks.mars.run import MarsRun, text_frame
from humanplay.web.logs import log_config
from humanplay.web.settings import Limits
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load
from tests.support.agents import codes_of, own, rows_of, token_of
from tests.support.command import command
from tests.support.servers import PATIENCE_S

MARS = {"task": "mars", "config": EnvConfig("random", 7, 9, sensor_radius=3), "instances": 3}


class Wire:
    """A plain client of a card's address."""

    def __init__(self, server, token):
        self.base, self.server, self.client = f"/agents/{token}", server, server.client()
        self._ws = f"ws://127.0.0.1:{server.port}{self.base}/ws"

    def get(self, path=""):
        return self.client.get(f"{self.base}{path}")

    def post(self, path, body):
        return self.client.post(f"{self.base}{path}", json=body)

    def rpc(self, method, **params):
        body = {"jsonrpc": "2.0", "id": 7, "method": method, "params": params}
        answer = self.post("/mcp", body).raise_for_status().json()
        assert (answer["jsonrpc"], answer["id"]) == ("2.0", 7)
        return answer["result"] if "result" in answer else answer["error"]

    @contextmanager
    def socket(self):
        """Yield a function that sends a message and returns the answer."""
        with connect(self._ws, proxy=None, compression=None) as socket:

            def ask(kind, _raw=None, **data):
                message = {"type": kind, "data": data} if data else {"type": kind}
                with suppress(ConnectionClosed):  # what came before it is read all the same
                    socket.send(json.dumps(message) if _raw is None else _raw)
                return json.loads(socket.recv())

            yield ask

    def play(self, ask, index):
        """Play an instance to its end by a rule from what is seen; return every answer."""
        rule = load("frontier-cost")
        rule.reset(1)
        answers = [ask("reset", split="evaluation", index=index)]
        while not answers[-1]["data"]["done"]:
            seen = answers[-1]["data"]["observation"]["observation"]
            action = ("north", "east", "south", "west")[rule.act(codes_of(seen["grid"]))]
            answers.append(ask("step", action=action))
        return answers


def free_way(seen):
    """Return a way to a cell that is seen to be free."""
    row, col = seen["position"]
    rows, cols = len(seen["grid"]), len(seen["grid"][0])
    ways = {
        "north": (row - 1, col),
        "east": (row, col + 1),
        "south": (row + 1, col),
        "west": (row, col - 1),
    }
    return next(
        way
        for way, (down, right) in ways.items()
        if 0 <= down < rows and 0 <= right < cols and seen["grid"][down][right] == "."
    )


@pytest.fixture
def database(tmp_path):
    own(tmp_path / "playground.db", **MARS)
    return tmp_path / "playground.db"


@pytest.fixture
def wire(serve, database):
    token = token_of(database)
    return Wire(serve(), token)


def error(answer):
    assert answer["type"] == "error", answer
    return answer["data"]["code"], answer["data"]["message"]


def test_a_series_is_played_to_its_end_and_no_score_is_told(wire, database):
    with wire.socket() as ask:
        answers = [answer for index in (0, 2, 1) for answer in wire.play(ask, index)]
        state = ask("state")
    assert state["type"] == "state"
    assert state["data"]["finished"] == [0, 1, 2]
    assert sum(answer["data"]["done"] for answer in answers) == 3
    assert len(answers) > 20
    for answer in answers:
        assert (answer["type"], answer["data"]["reward"]) == ("observation", None)
        seen = answer["data"]["observation"]
        assert set(seen) == {"index", "step", "observation", "text", "picture"}
        assert len(seen["text"].encode()) <= 1000
        assert seen["picture"].startswith("data:image/png;base64,")
    text = json.dumps([answers, state, wire.get().json(), wire.get("/metadata").json()])
    assert not any(word in text for word in ('"return"', '"score"', '"outcome"', '"seed"'))
    sql = "SELECT instance, json_extract(came_to, '$.outcome') FROM agents_attempts ORDER BY id"
    assert rows_of(database, sql) == [(0, "explored"), (2, "explored"), (1, "explored")]
    assert wire.post("/close", {}).json() == {"closed": True}
    assert wire.get().status_code == 404


def test_a_lost_line_goes_on_where_the_record_stands(wire):
    with wire.socket() as ask:
        grid = ask("reset", index=0)["data"]["observation"]["observation"]["grid"]
        before = ask("step", action="east" if grid[0][1] != "#" else "south")
        stale = ask("step", action="east", step=0)
        assert error(stale)[0] == "EXECUTION_ERROR"
    with wire.socket() as ask:
        assert error(ask("step", action="east")) == (
            "EXECUTION_ERROR",
            "reset an instance before a step",
        )
        assert ask("reset", task="i0000") == before
        assert ask("step", action=1, step=1)["data"]["observation"]["step"] == 2


def test_a_kill_while_agents_act_loses_no_move_that_was_answered(spawn, database):
    server, tokens = spawn(), [token_of(database, author) for author in ("Ann", "Bob")]
    answered, enough = {}, threading.Event()

    def act(wire):
        with suppress(ConnectionClosed), wire.socket() as ask:
            while True:
                for answer in (ask("reset", index=index) for index in range(3)):
                    index = answer["data"]["observation"]["index"]
                    answered[wire.base, index] = answer
                    seen = answer["data"]["observation"]["observation"]
                    answered[wire.base, index] = ask("step", action=free_way(seen))
                    if sum(last["data"]["observation"]["step"] for last in answered.values()) > 30:
                        enough.set()

    agents = [threading.Thread(target=act, args=(Wire(server, token),)) for token in tokens]
    for thread in agents:
        thread.start()
    assert enough.wait(PATIENCE_S)
    server.kill()
    for thread in agents:
        thread.join()
    server = spawn()
    for (base, index), last in answered.items():
        with Wire(server, base.removeprefix("/agents/")).socket() as ask:
            now = ask("reset", index=index)
        moves = [message["data"]["observation"]["step"] for message in (last, now)]
        assert moves[0] <= moves[1] <= moves[0] + 1  # a move may have been kept and not answered
        assert moves[0] < moves[1] or now == last
    server.kill()


REFUSED = [
    ("reset", {"seed": 3}, "no seed"),
    ("reset", {"index": 0, "seed": 3}, "no seed"),
    ("reset", {"index": 0, "seed": None}, "no seed"),
    ("reset", {"split": "evaluation"}, "names an instance"),
    ("reset", {"index": 3}, "expected an instance 0 to 2, got 3"),
    ("reset", {"index": -1}, "expected an instance 0 to 2, got -1"),
    ("reset", {"index": "0"}, "index must be a whole number"),
    ("reset", {"index": 0, "split": "train"}, "expected the split 'evaluation', got 'train'"),
    ("reset", {"task": "seed"}, "expected the id of an instance"),
    ("step", {"action": "up"}, "expected an action"),
    ("step", {"action": 4}, "expected an action"),
    ("step", {"seed": 4}, "unknown field 'seed'"),
    ("look", {}, "expected reset, step, state or close, got 'look'"),
]


def test_what_is_no_reset_and_no_step_is_refused_in_a_sentence(wire):
    with wire.socket() as ask:
        ask("reset", index=1)
        for kind, data, reason in REFUSED:
            assert reason in error(ask(kind, **data))[1], (kind, data)
        assert ask("step", action="east")["data"]["observation"]["step"] == 1  # it goes on


def test_what_is_no_message_is_refused_and_the_socket_goes_on(wire):
    with wire.socket() as ask:
        for raw in ("", "[]", "7", "{}", '{"data": 3}', "[" * 3000, b"\x00\xff", '{"type": 3}'):
            assert error(ask("", _raw=raw))
        assert ask("reset", index=0)["type"] == "observation"


def test_a_finished_instance_is_not_reset(wire):
    with wire.socket() as ask:
        wire.play(ask, 2)
        reason = "instance 2 is finished: a card has one attempt at each instance"
        assert error(ask("reset", index=2)) == ("EXECUTION_ERROR", reason)
        reason = "instance 2 is finished: no move is made any more"  # and not how it ended
        assert error(ask("step", action="east")) == ("EXECUTION_ERROR", reason)


def test_a_guessed_token_a_closed_and_a_revoked_card_are_told_alike_on_every_route(
    serve, database, capsys
):
    issued = token_of(database, "Cyd")
    tokens = {
        "guessed": issued[:-1] + ("A" if issued[-1] != "A" else "B"),
        "closed": token_of(database, "Ann"),
        "revoked": token_of(database, "Bob"),
        "a card's number": issued[:4],
        "long": "x" * 500,
    }
    server = serve()
    assert Wire(server, tokens["revoked"]).get().status_code == 200
    assert Wire(server, tokens["closed"]).post("/close", {}).status_code == 200
    revoked = "agents", "revoke", "agents", tokens["revoked"][:4], "--database", database
    assert command(capsys, *revoked)[0] == 0
    gets = (
        "",
        "/health",
        "/metadata",
        "/schema",
        "/openapi.json",
        "/list_environments",
        "/mars/splits",
    )
    posts = (
        "",
        "/close",
        "/mcp",
        "/mars/tasks",
        "/mars/num_tasks",
        "/mars/task",
        "/mars/task_range",
    )
    for token in tokens.values():
        wire = Wire(server, token)
        answers = [wire.get(path) for path in gets]
        answers += [wire.post(path, {"split": "evaluation"}) for path in posts]
        assert {(answer.status_code, answer.text) for answer in answers} == {
            (404, json.dumps({"detail": NO_CARD}, separators=(",", ":")))
        }
        with wire.socket() as ask:
            assert error(ask("reset", index=0)) == ("SESSION_ERROR", NO_CARD)
            with pytest.raises(ConnectionClosed, match="4404"):
                ask("reset", index=0)


def test_a_card_that_is_closed_while_it_plays_plays_no_further(wire):
    with wire.socket() as ask:
        ask("reset", index=0)
        wire.post("/close", {})
        assert error(ask("step", action="east"))[1] == NO_CARD


def test_the_instances_are_listed_as_openenv_words_it(wire):
    assert wire.get("/health").json() == {"status": "healthy"}
    assert wire.get("/list_environments").json() == ["mars"]
    assert wire.get("/mars/splits").json() == [{"name": "evaluation", "type": "test"}]
    split = {"split": "evaluation"}
    listed = [{"task": f"i000{index}", "split": "evaluation", "index": index} for index in range(3)]
    assert wire.post("/mars/tasks", split).json() == {"tasks": listed, "env_name": "mars"}
    assert wire.post("/mars/num_tasks", split).json() == {"num_tasks": 3}
    assert wire.post("/mars/task", {**split, "index": 2}).json() == {"task": listed[2]}
    assert wire.post("/mars/task", {**split, "index": 3}).status_code == 400
    assert wire.post("/mars/task_range", {**split, "start": 1}).json()["tasks"] == listed[1:]
    assert wire.post("/mars/tasks", {"split": "train"}).status_code == 404
    assert wire.post("/other/tasks", split).status_code == 404
    schema = wire.get("/schema").json()
    assert schema["action"]["properties"]["action"] == {"enum": ["north", "east", "south", "west"]}
    assert schema["action"]["required"] == ["action"]
    paths = wire.get("/openapi.json").json()["paths"]
    assert {"/health", "/schema", "/metadata", "/mcp", "/{env}/splits"} <= set(paths)
    assert "/reset" not in paths  # OpenEnv: a server that plays by its socket alone


def test_the_author_says_what_the_agent_is_before_it_plays(wire):
    description = {"agent": "rule", "version": "1", "model": "none"}
    assert wire.post("", description).json() == {"agent": description}
    assert "line of sight" in wire.get().json()["instructions"]
    with wire.socket() as ask:
        ask("reset", index=0)
    late = wire.post("", {"agent": "another"})
    assert (late.status_code, wire.get().json()["agent"]) == (409, description)
    assert wire.post("", {"cost": "3 USD"}).json() == {"agent": {**description, "cost": "3 USD"}}
    for wrong in ({"score": "1"}, {"agent": 3}):
        assert wire.post("", wrong).status_code == 422


def test_mcp_has_a_handshake_and_two_tools(wire):
    begun = wire.rpc("initialize", protocolVersion="2025-06-18")
    assert begun["protocolVersion"] == "2025-06-18"
    assert "0 to 2" in begun["instructions"]
    assert wire.rpc("initialize", protocolVersion="1")["protocolVersion"] == "2025-11-25"
    assert wire.rpc("ping") == {}
    note = wire.post("/mcp", {"jsonrpc": "2.0", "method": "notifications/initialized"})
    assert (note.status_code, note.content) == (202, b"")
    tools = {tool["name"]: tool["inputSchema"] for tool in wire.rpc("tools/list")["tools"]}
    assert set(tools) == {"begin", "move"}
    assert tools["move"]["properties"]["action"]["enum"] == ["north", "east", "south", "west"]
    first = wire.rpc("tools/call", name="begin", arguments={"index": 1})
    moved = wire.rpc("tools/call", name="move", arguments={"index": 1, "action": "east"})
    assert first["content"][0]["text"].startswith("instance 1, step 0, running\n7 rows")
    assert [part["type"] for part in moved["content"]] == ["text", "image"]
    assert moved["structuredContent"]["observation"]["step"] == 1
    assert moved["structuredContent"]["reward"] is None
    for name, arguments in [
        ("move", {"index": 2, "action": "east"}),
        ("reset", {}),
        ("begin", {"seed": 1}),
    ]:
        refused = wire.rpc("tools/call", name=name, arguments=arguments)
        assert refused["isError"], (name, arguments)
    session = wire.rpc("openenv/session/create")["session_id"]
    assert wire.rpc("openenv/session/close", session_id=session)["closed"]
    assert wire.rpc("openenv/session/close", session_id="x")["code"] == -32602
    assert wire.rpc("resources/list")["code"] == -32601
    for body in ({}, [], {"method": "ping"}):
        assert wire.post("/mcp", body).json()["error"]["code"] == -32600


@pytest.mark.parametrize(
    ("sees", "shown"),
    [("picture", {"picture"}), ("observation", {"observation", "text"})],
)
def test_an_agent_sees_what_the_protocol_shows_and_nothing_else(serve, tmp_path, sees, shown):
    own(tmp_path / "playground.db", **MARS, sees=sees)
    wire = Wire(serve(), token_of(tmp_path / "playground.db"))
    with wire.socket() as ask:
        seen = ask("reset", index=0)["data"]["observation"]
    assert set(seen) == {"index", "step", *shown}
    answer = wire.rpc("tools/call", name="begin", arguments={"index": 0})
    assert ("text" in shown) == ("@ the rover" in json.dumps(answer))


def known(answer):
    """Return the known map and the rover's place: all that an instance may tell."""
    seen = answer["data"]["observation"]["observation"]
    return json.dumps([seen["grid"], seen["position"]])


def test_instances_that_look_alike_so_far_are_told_alike(serve, tmp_path):
    config = EnvConfig("random", 9, 9, sensor_radius=1)
    own(tmp_path / "playground.db", task="mars", config=config, instances=12)
    wire = Wire(serve(), token_of(tmp_path / "playground.db"))
    with wire.socket() as ask:
        firsts = {index: ask("reset", index=index) for index in range(12)}
        alike = {}
        for index, first in firsts.items():
            alike.setdefault(known(first), []).append(index)
        one, other = max(alike.values(), key=len)[:2]
        pairs = 0
        for action in ("east", "south", "west", "north") * 3:
            answers = []
            for index in (one, other):
                now = ask("reset", index=index)
                answers.append(
                    [now, wire.rpc("tools/call", name="begin", arguments={"index": index})]
                )
                answers[-1] = json.loads(
                    json.dumps(answers[-1])
                    .replace(f'"index": {index}', '"index": 0')
                    .replace(f"instance {index},", "instance 0,")
                )
            if known(answers[0][0]) != known(answers[1][0]):
                break
            assert answers[0] == answers[1]
            pairs += 1
            ends = [
                (ask("reset", index=index), ask("step", action=action))[1]["data"]["done"]
                for index in (one, other)
            ]
            if any(ends):
                break
        assert pairs


def test_a_budget_that_is_used_up_refuses_what_begins_and_nothing_else(serve, database):
    token = token_of(database)
    server = serve(limits=Limits(episodes_per_address="2+0.001/s"))
    wire = Wire(server, token)
    with wire.socket() as ask:
        ask("reset", index=0)
        ask("reset", index=1)
        assert "too many new episodes" in error(ask("reset", index=2))[1]
        assert ask("reset", index=0)["type"] == "observation"  # it goes on
        assert ask("step", action="east")["type"] == "observation"
        body = {
            "jsonrpc": "2.0",
            "id": 1,
            "method": "tools/call",
            "params": {"name": "begin", "arguments": {"index": 2}},
        }
        assert wire.post("/mcp", body).status_code == 429


def test_a_token_is_masked_in_the_log():
    filter_ = log_config("text")["filters"]["cut"]["()"]()
    record = logging.LogRecord(
        "x", logging.WARNING, __file__, 1, "GET /agents/%s/ws?x=1 failed", ("ABCDEFGH" * 3,), None
    )
    assert filter_.filter(record)
    assert record.getMessage() == "GET /agents/***/ws?x=1 failed"


@pytest.mark.parametrize("size", [(5, 5), (21, 21), (25, 60), (42, 42), (128, 128)])
def test_a_text_frame_shows_the_matrix_around_the_rover_in_one_kilobyte(size):
    run = MarsRun(Episode.begin(EnvConfig("random", *size), seed=4))
    policy = load("frontier-cost")
    policy.reset(0)
    while run.view().outcome == "running" and run.view().steps < 400:
        observation = run.agent_observation(False, True)["observation"]
        text = text_frame(observation)
        assert len(text.encode()) <= 1000
        lines = text.split("\n")[2:]
        assert sum("@" in line for line in lines) == 1
        for line in lines:
            number, cells = line[:3], line[4:]
            assert cells in observation["grid"][int(number)]
            assert len(cells) == min(size[1], 25)
        run.step(int(policy.act(codes_of(observation["grid"]))))
