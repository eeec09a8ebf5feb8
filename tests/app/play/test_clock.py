"""A board on a clock: held keys, countdown, pauses, lag, and forged rows."""

import json
import time

import pytest

from humanplay.board import attestation, clock, controls, input_log, session
from humanplay.board.controls import Controls, HeldKeys, late_share, pauses_of
from humanplay.study.active_time import active_ms, pause_share
from humanplay.study.plausibility import labels_of, plausibility_labels
from humanplay.study.protocol import default_protocol
from humanplay.study.verification import verify_database
from humanplay.task import describe
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.description import Description, read_description
from tests.support.keyboard import Keyboard
from tests.support.page_loads import LOAD
from tests.support.recorded import alter, ask
from tests.support.servers import eventually

KEYS = {"noop": (), "right": ("ArrowRight", "KeyD"), "rightfire": ("ArrowRight+Space",)}
NOOP, RIGHT, RIGHTFIRE = 0, 1, 2
TICKING = Description(
    id="tests.support.environments:Meanings-v0", kwargs={"length": 100_000}, clock=30, max_steps=3000,
    keys={"ArrowRight": "right", "KeyD": "right", "ArrowRight+Space": "rightfire"},
)  # fmt: skip
TASK = f"gymnasium:{TICKING.told}"


def held_keys(*events):
    keys = HeldKeys()
    for kind, *more in events:
        code, repeat, trusted = (*more, *(None, False, True)[len(more) :])
        keys.take(kind, code, repeat, trusted)
    return keys


@pytest.mark.parametrize(
    ("events", "action", "by"),
    [
        ([], NOOP, None),
        ([("keydown", "KeyD")], RIGHT, "key"),
        ([("keydown", "KeyD"), ("keyup", "KeyD")], NOOP, None),
        ([("keydown", "ArrowRight"), ("keydown", "Space")], RIGHTFIRE, "key"),
        ([("keydown", "Space"), ("keydown", "ArrowRight"), ("keyup", "Space")], RIGHT, "key"),
        ([("keydown", "Space")], NOOP, None),
        ([("touchdown", "right")], RIGHT, "touch"),
        ([("touchdown", "noop")], NOOP, None),
        ([("touchdown", "right"), ("touchup", "right")], NOOP, None),
        ([("keydown", "KeyD"), ("touchdown", "rightfire")], RIGHTFIRE, "touch"),
        ([("keydown", "KeyD", True)], NOOP, None),
        *[([("keydown", "KeyD"), (kind,)], NOOP, None) for kind in ("blur", "hidden", "pause", "resume")],
        ([("keydown", "KeyD"), ("focus",), ("visible",)], RIGHT, "key"),
    ],
)  # fmt: skip
def test_the_action_of_a_tick_follows_from_what_is_held(events, action, by):
    assert Controls(KEYS, NOOP).action(held_keys(*events).down, RIGHTFIRE) == (action, by)


def test_without_a_noop_the_last_action_is_repeated():
    assert Controls(KEYS, None).action([], RIGHT) == (RIGHT, None)
    two = Controls({"left": ("KeyA",), "right": ("KeyD",)}, None)
    down = held_keys(("keydown", "KeyA"), ("keydown", "KeyD"))
    assert two.action(down.down, 0) == (1, "key")
    down.take("keydown", "KeyA", False, True)  # its release was never told
    assert two.action(down.down, 0) == (0, "key")


def test_pauses_and_late_ticks_follow_from_the_times_of_the_ticks():
    times = [0, 33, 67, 100, 3200, 3233, 3266, 3400, 3433, 10_000]
    assert pauses_of(times) == [3100, 6567]
    assert late_share(times, 30) == pytest.approx(1 / 7)
    assert late_share([0], 30) == 0


@pytest.fixture
def soon(monkeypatch):
    """Countdowns of a tenth of their time, and any lateness: the test machine is busy."""
    monkeypatch.setattr(clock, "STALL_S", 60)
    monkeypatch.setattr(clock, "COUNTDOWN_S", 0.3)
    for module in (clock, session, attestation):
        monkeypatch.setattr(module, "PAUSE_MS", 300)


@pytest.fixture
def ticking(serve, soon):
    return serve(task=TASK)


def begin(server):
    client = server.page()
    begun = client.post("/api/sessions", json={})
    assert begun.status_code == 201, begun.text
    return client, begun.json()["session"]


def levels(tmp_path):
    return ask(
        tmp_path / "playground.db", "SELECT driver, attestation, attestation_reason FROM episodes"
    )


def play(server, ticks=20):
    """Play with two keys held in turn: the client, the board's id and the keyboard."""
    client, board = begin(server)
    with server.socket(board, client) as socket:
        me = Keyboard(socket)
        me.go_on()
        for code in ("ArrowRight", "KeyD"):
            me.hold(code, ticks)
            me.pass_ticks(5)
    return client, board, me


def test_a_page_is_told_that_time_runs():
    assert describe(environment_of(TASK))["clock"] == 30
    assert describe(environment_of("gymnasium:FrozenLake-v1"))["clock"] is None
    assert describe(environment_of("mars"))["clock"] is None


LAST = "(SELECT max(number) FROM input_events WHERE kind = 'keyup')"
CHANGES = {
    f"UPDATE input_events SET server_ms = server_ms - 200 WHERE number = {LAST}": "attestation",
    "UPDATE input_events SET code = 'KeyZ' WHERE code = 'KeyD'": "attestation",
    "UPDATE input_events SET trusted = 0 WHERE kind = 'keydown'": "attestation",
    "UPDATE input_events SET kind = 'focus' WHERE kind = 'resume'": "attestation",
    "UPDATE steps SET action = 2 WHERE step = 3": "trajectory_hash",
    "UPDATE steps SET reward = 0 WHERE step = 3": "reward of step 3",
    "UPDATE steps SET server_ms = server_ms + 1 WHERE step = 3": "digest of its stored fields",
    "UPDATE episodes SET seed = seed + 1": "terrain_hash",
}


def test_ticks_follow_from_held_keys_are_attested_and_whatever_is_changed_is_found(
    ticking, tmp_path
):
    client, board, me = play(ticking)
    assert me.kinds == {"frame", "clock", "kept", "history"}
    assert me.refused is None
    moves = ask(tmp_path / "playground.db", "SELECT action, input, driver FROM steps ORDER BY step")
    assert {NOOP, RIGHT} == {action for action, *_ in moves}
    assert set(moves) == {(NOOP, None, "human"), (RIGHT, "key", "human")}
    assert 35 <= sum(action == RIGHT for action, *_ in moves) <= 60
    assert client.post(f"/api/sessions/{board}/episodes", json={}).status_code == 201
    assert levels(tmp_path)[0] == ("human", "attested", None)
    assert verify_database(tmp_path / "playground.db").findings == ()
    ticking.stop()
    path = tmp_path / "playground.db"
    content = path.read_bytes()
    for change, expected in CHANGES.items():
        path.write_bytes(content)
        assert alter(path, change) > 0
        findings = [str(finding) for finding in verify_database(path).findings]
        assert any(expected in finding for finding in findings), (change, findings)


def test_a_server_s_clock_that_is_set_back_spoils_nothing(ticking, tmp_path):
    client, board = begin(ticking)
    with ticking.socket(board, client) as socket:
        me = Keyboard(socket)
        me.go_on()
        for _ in range(3):
            me.pass_ticks(5)
            ticking.clock.set_back_ms += 100
            me.pass_ticks(1)
            me.hold("KeyD", 5)
    assert client.post(f"/api/sessions/{board}/episodes", json={}).status_code == 201
    assert levels(tmp_path)[0] == ("human", "attested", None)
    assert verify_database(tmp_path / "playground.db").findings == ()


def test_no_tick_comes_while_the_board_stands_still(ticking, tmp_path):
    client, board = begin(ticking)
    with ticking.socket(board, client) as socket:
        me = Keyboard(socket)
        me.send(("keydown", "KeyD"))
        me.drain(0.5)
        assert (me.frame["step"], me.state) == (0, "standing")
        for how in ("hidden", "pause"):
            me.go_on()
            me.send(("keydown", "KeyD"))
            me.pass_ticks(3)
            me.send((how, None))
            me.until(lambda: me.state == "standing")
            me.drain(0.2)  # the tick that was under way
            stood = me.frame["step"]
            me.drain(0.4)
            assert me.frame["step"] == stood
        me.go_on()
        me.pass_ticks(3)
        actions = ask(
            tmp_path / "playground.db", "SELECT action FROM steps ORDER BY step DESC LIMIT 2"
        )
        assert actions == [(NOOP,), (NOOP,)]  # whatever was held is let go
        with ticking.socket(board, client) as other:  # a reload, or a second tab
            again = Keyboard(other)
            me.until(lambda: me.state == "standing")
            again.go_on()
            again.pass_ticks(2)
        me.until(lambda: me.state == "running")
        me.until(lambda: me.state == "standing")  # the other one has left
        me.send(("resume", None))
        me.until(lambda: me.state == "countdown")
        me.send(("hidden", None))
        me.until(lambda: me.state == "standing")
        me.drain(0.6)
        assert me.state == "standing"
    assert client.post(f"/api/sessions/{board}/episodes", json={}).status_code == 201
    assert levels(tmp_path)[0] == ("human", "attested", None)


@pytest.mark.parametrize("is_unloaded", [False, True])
def test_a_batch_that_comes_again_lets_no_time_run(ticking, is_unloaded):
    client, board = begin(ticking)
    with ticking.socket(board, client) as socket:
        me = Keyboard(socket)
        me.go_on()
        me.pass_ticks(2)
        me.send(("pause", None))
        me.until(lambda: me.state == "standing")
    if is_unloaded:
        ticking.services.lobby.forget([board])
    with ticking.socket(board, client) as socket:
        again = Keyboard(socket)
        socket.send(me.sent[0])
        again.drain(0.5)
        assert again.state == "standing"
        again.go_on()


@pytest.mark.parametrize(("allowed", "pauses"), [({"pauses": 1}, 2), ({"paused_s": 0.1}, 1)])
def test_more_pauses_than_are_allowed_end_the_episode_as_left(
    ticking, tmp_path, monkeypatch, allowed, pauses
):
    monkeypatch.setattr(session, "ClockLimits", lambda: controls.ClockLimits(**allowed))
    client, board = begin(ticking)
    with ticking.socket(board, client) as socket:
        me = Keyboard(socket)
        for _ in range(pauses):
            me.go_on()
            me.pass_ticks(2)
            me.send(("pause", None))
            me.until(lambda: me.state == "standing")
        assert me.frame["outcome"] is None
        me.send(("resume", None))
        me.until(lambda: me.frame["outcome"])
        assert me.frame["outcome"] == "abandoned"
    assert levels(tmp_path)[0] == ("human", "attested", None)
    assert verify_database(tmp_path / "playground.db").findings == ()


def test_a_person_makes_no_moves_and_a_script_does(ticking, tmp_path):
    client, board = begin(ticking)
    with ticking.socket(board, client) as socket:
        me = Keyboard(socket)
        socket.send({"kind": "act", "episode": me.frame["episode"], "step": 0, "action": "right", "input": "key"})  # fmt: skip
        assert "it takes the keys that are held" in socket.receive("refused")["reason"]
        me.go_on()
        me.send(("keydown", "KeyD"), trusted=False)
        me.pass_ticks(3)
    assert eventually(lambda: levels(tmp_path)[0][0] == "script")
    script = ticking.client()
    frame = script.post("/api/sessions", json={}).json()["frame"]
    board = script.post("/api/sessions", json={}).json()
    frame = board["frame"]
    act = {"episode": frame["episode"], "step": 0, "action": "right"}
    assert script.post(f"/api/sessions/{board['session']}/act", json=act).json()["step"] == 1


def test_nothing_but_the_picture_and_the_figures_leaves_the_server(ticking):
    client, board = begin(ticking)
    with ticking.socket(board, client) as socket:
        socket.receive("frame")
        socket.send(
            {"kind": "events", "episode": "x" * 16, "batch": "y" * 16, **LOAD, "events": []}
        )
        messages = []
        socket.send({"kind": "history"})
        while len(messages) < 4:
            messages.append(json.loads(socket.connection.recv(timeout=10)))
    seen = {key for message in messages for key in message}
    assert seen <= {
        "kind",
        "episode",
        "headlines",
        "state",
        "ms",
        "reason",
        "count",
        "ident",
        "values",
    }


def test_an_episode_is_given_up_while_time_runs(ticking):
    client, board = begin(ticking)
    with ticking.socket(board, client) as socket:
        me = Keyboard(socket)
        me.go_on()
        me.pass_ticks(5)
        session = ticking.on_loop(ticking.services.lobby.get(board))
        ticking.on_loop(session.abandon(me.frame["episode"], 1))
        me.until(lambda: me.frame["outcome"])
        me.drain(0.2)
    assert (me.frame["outcome"], me.state) == ("abandoned", "standing")


@pytest.mark.parametrize("error", [session.StoreError, session.RefusedError])
def test_keys_that_could_not_be_kept_let_the_board_stand_still(
    ticking, tmp_path, monkeypatch, error
):
    client, board = begin(ticking)
    with ticking.socket(board, client) as socket:
        me = Keyboard(socket)
        me.go_on()
        me.pass_ticks(2)
        with monkeypatch.context() as broken:

            def refuse(*_):
                time.sleep(0.1)  # ticks come meanwhile, and are written behind it
                raise error("no room")

            broken.setattr(input_log, "add_input_events", refuse)
            me.send(("keydown", "KeyD"))
            me.until(lambda: me.state == "standing")
        assert me.reason == session.NOT_STORED
        me.go_on()
        me.pass_ticks(3)
    assert client.post(f"/api/sessions/{board}/episodes", json={}).status_code == 201
    assert levels(tmp_path)[0] == ("human", "attested", None)


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("clock = 0", "clock"), ("clock = 61", "clock"), ('clock = "fast"', "clock"),
        ('keys = { "KeyA+Fire" = 0 }', "expected codes like ArrowUp"),
    ],
)  # fmt: skip
def test_a_clock_and_keys_that_are_none_are_named_with_their_line(tmp_path, line, wrong):
    file = tmp_path / "odd.toml"
    file.write_text(f'id = "FrozenLake-v1"\n{line}\n')
    with pytest.raises(ValueError, match=f"line 2: {wrong}|line 2: keys: {wrong}"):
        read_description(file)


def test_the_no_op_is_the_one_of_the_file_else_the_one_called_so():
    fields = {"id": "FrozenLake-v1", "clock": 10}
    assert environment_of(TASK).noop == 0
    assert environment_of(f"gymnasium:{Description(**fields).told}").noop is None
    assert environment_of(f"gymnasium:{Description(**fields, noop='up').told}").noop == 3


def test_a_path_whose_scores_are_hidden_tells_none():
    environment = environment_of("gymnasium:FrozenLake-v1")
    view = environment.run(environment.default, 7, bytes([1, 2])).view()
    assert json.loads(view.history("e"))["headlines"] == [0.0, 0.0, 0.0]
    assert json.loads(view.history("e", True))["headlines"] == [None, None, None]


def test_a_protocol_says_what_is_allowed_and_late_frames_are_labelled():
    config = environment_of(TASK).default
    limits = {"max_pauses": 2, "max_paused_s": 30, "max_late": 0.1}
    protocol = default_protocol("ticking", config, TASK, **limits)
    assert protocol.clock_limits == controls.ClockLimits(2, 30, 0.1)
    assert "late frames" in labels_of(protocol)
    assert "under 80 ms" not in labels_of(protocol)
    assert "late frames" not in labels_of(default_protocol("mars", environment_of("mars").configuration({})))  # fmt: skip
    times = [33 * tick + 100 * (tick > 10) + 5000 * (tick > 20) for tick in range(30)]
    moves = [{"server_ms": at, "input": None} for at in times]
    assert plausibility_labels(moves, [], 30, 0.03) == ("late frames",)
    assert plausibility_labels(moves, [], 30, 0.1) == ()
    assert pause_share(moves, [], 60_000, 30) == pytest.approx(5033 / times[-1])
    assert active_ms(moves, [], -9_000, 60_000, 30) == pytest.approx(times[-1] - 5033)
