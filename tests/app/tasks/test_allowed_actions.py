"""Allowed actions hold for people, clocks, policies and examinations."""

import json
import re

import numpy as np
import pytest

from humanplay.board import attestation, clock, session
from humanplay.study.verification import verify_database
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.description import Description
from humanplay.tasks.gymnasium.doctor import examine
from humanplay.tasks.gymnasium.task import GymnasiumTask
from humanplay.tasks.policies import chooser
from tests.app.tasks.test_policies import network
from tests.support.keyboard import Keyboard
from tests.support.recorded import alter, ask

MODULE = "tests.support.masked_environments"
WAYS = ("info", "observation", "method")


def doors(how, **rest):
    return f"gymnasium:{Description(id=f'{MODULE}:Doors-v0', kwargs={'how': how}, **rest).told}"


@pytest.fixture
def new_task():
    tasks = []

    def make(name, *policies):
        tasks.append(GymnasiumTask(name.removeprefix("gymnasium:"), policies))
        return tasks[-1]

    yield make
    for task in tasks:
        task.close()


@pytest.mark.parametrize("how", WAYS)
def test_a_forbidden_action_is_refused_without_a_step_and_the_episode_goes_on(serve, tmp_path, how):
    server = serve(task=doors(how))
    client = server.page()
    begun = client.post("/api/sessions", json={"seed": 3}).json()
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        assert (frame["step"], frame["allowed"]) == (0, ["right"])
        for name in ("left", "open"):
            socket.act(frame, name)
            refused = socket.receive("refused")
            assert refused["reason"] == f"{name} cannot be chosen now: expected right"
            assert (refused["frame"]["step"], refused["frame"]["outcome"]) == (0, None)
        while frame["outcome"] is None:
            wanted = next(name for name in ("open", "right") if name in frame["allowed"])
            socket.act(frame, wanted)
            frame = socket.frame_after(frame["step"])
    assert (frame["outcome"], frame["allowed"], frame["step"]) == ("ended", None, 6)
    assert verify_database(tmp_path / "playground.db").findings == ()


def test_a_script_over_http_is_told_what_can_be_chosen(serve):
    client = serve(task=doors("info")).client()
    begun = client.post("/api/sessions", json={}).json()
    act = {"episode": begun["frame"]["episode"], "step": 0, "action": "left"}
    answer = client.post(f"/api/sessions/{begun['session']}/act", json=act)
    assert answer.status_code == 409
    assert "left cannot be chosen now: expected right" in answer.text


def test_everything_may_be_chosen_where_the_environment_allows_nothing(new_task):
    run = environment_of(f"gymnasium:{MODULE}:Spent-v0").run(
        new_task(f"{MODULE}:Spent-v0").default, 1
    )
    run.step(1)
    assert (run.allowed(), run.view().allowed) == ([(1,), None], None)


def test_a_mask_that_does_not_fit_is_refused_before_the_page_opens():
    with pytest.raises(
        ValueError, match=re.escape("of shape (3,), a truth value for each action, got (7,)")
    ):
        environment_of(f"gymnasium:{MODULE}:Crooked-v0").prepare()


@pytest.mark.parametrize("how", WAYS)
def test_what_is_drawn_at_random_is_allowed(new_task, how):
    """An environment that raises at every other action is examined, and played."""
    examination = examine(doors(how), seeds=2, steps=30)
    assert (examination.differences, examination.steps) == ((), 60)
    task = new_task(doors(how))
    policy = task.policies.load("random")
    run = task.policies.play(policy, task.default, 3, 3)
    assert run.outcome in ("ended", "timed_out")


def test_policies_that_take_masks_are_given_them(new_task, tmp_path):
    rule = f"{MODULE}:last_allowed"
    task = new_task(doors("info"), rule)
    run = task.policies.play(task.policies.load(rule), task.default, 3, 3)
    assert (run.outcome, len(run.actions)) == ("ended", 6)
    from onnx import TensorProto, helper

    nodes = [
        helper.make_node("Cast", ["action_masks"], ["cast"], to=TensorProto.FLOAT),
        helper.make_node("ArgMax", ["cast"], ["actions"], axis=1, keepdims=0),
    ]
    path = network(
        tmp_path / "n.onnx", [3], nodes, {}, TensorProto.INT64, TensorProto.BOOL, "action_masks"
    )
    assert chooser(str(path), 0)(np.array([1]), np.array([0, 1, 1], bool)) == 1


TICKING = Description(
    id=f"{MODULE}:Belt-v0", clock=30, max_steps=3000,
    keys={"ArrowLeft": "left", "ArrowRight": "right"},
)  # fmt: skip
NOOP, LEFT, RIGHT = 0, 1, 2


def test_with_a_clock_what_is_forbidden_becomes_the_noop_or_the_lowest_allowed(
    serve, tmp_path, monkeypatch
):
    monkeypatch.setattr(clock, "STALL_S", 60)
    monkeypatch.setattr(clock, "COUNTDOWN_S", 0.3)
    for module in (clock, session, attestation):
        monkeypatch.setattr(module, "PAUSE_MS", 300)
    server = serve(task=f"gymnasium:{TICKING.told}")
    client = server.page()
    board = client.post("/api/sessions", json={}).json()["session"]
    with server.socket(board, client) as socket:
        me = Keyboard(socket)
        me.go_on()
        me.hold("ArrowLeft", 4)
        me.hold("ArrowRight", 12)
        me.pass_ticks(4)
        assert me.frame["outcome"] is None
    path = tmp_path / "playground.db"
    moves = ask(path, "SELECT action, input FROM steps ORDER BY step")
    assert moves[:3] == [(NOOP, None)] * 3  # left cannot be chosen in the first cell
    assert (RIGHT, "key") in moves
    assert {(NOOP, None), (LEFT, None), (RIGHT, "key")} == set(moves)
    assert client.post(f"/api/sessions/{board}/episodes", json={}).status_code == 201
    (level,) = ask(path, "SELECT attestation, attestation_reason FROM episodes WHERE number = 1")
    assert level == ("attested", None)
    assert verify_database(path).findings == ()
    server.stop()
    assert alter(path, "UPDATE steps SET input = 'key' WHERE action = 1") > 0
    assert any("attestation" in str(finding) for finding in verify_database(path).findings)


def test_taxi_s_own_mask_is_kept_to(serve):
    from gymnasium import registry

    taxi = max(name for name in registry if name.startswith("Taxi-v"))
    server = serve(task=f"gymnasium:{taxi}")
    client = server.page()
    begun = client.post("/api/sessions", json={"seed": 1}).json()
    allowed = begun["frame"]["allowed"]
    assert 0 < len(allowed) < 6
    (name, *_) = {"south", "north", "east", "west", "pickup", "dropoff"} - {*allowed}
    act = {"episode": begun["frame"]["episode"], "step": 0, "action": name}
    answer = client.post(f"/api/sessions/{begun['session']}/act", json=act)
    assert (answer.status_code, json.loads(answer.text)["detail"][: len(name)]) == (409, name)
