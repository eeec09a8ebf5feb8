"""Breakout at 60 frames a second, and a server that is killed during play."""

import numpy as np
import pytest

from humanplay.study.verification import verify_database
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.description import Description
from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment
from tests.support.keyboard import Keyboard
from tests.support.recorded import ask

pytest.importorskip("ale_py")
BREAKOUT = "gymnasium:ale_py:ALE/Breakout-v5"
FIRE, RIGHT, LEFT = 1, 2, 3


def test_the_catalogue_knows_clock_keys_and_what_a_person_plays():
    environment = environment_of(BREAKOUT)
    assert (environment.about.title, environment.clock, environment.noop, environment.limit) == (
        "Breakout",
        60,
        0,
        18_000,
    )
    assert environment.keys["noop"] == ()
    assert environment.keys["fire"] == ("Space",)
    kwargs = {"frameskip": 1, "repeat_action_probability": 0.0}
    assert environment.default.to_dict()["kwargs"] == kwargs
    assert environment.successes == {"ended"}  # nothing is guessed


@pytest.mark.parametrize("sticky", [0.0, 0.25])
def test_an_agents_action_is_four_ticks_of_a_person_bit_for_bit(sticky):
    def at(frameskip):
        kwargs = {"frameskip": frameskip, "repeat_action_probability": sticky}
        return GymnasiumEnvironment(Description(id="ale_py:ALE/Breakout-v5", kwargs=kwargs).told)

    def observation_of(run):
        return run.agent_observation(picture=False, observation=True)["observation"]

    fast, slow = at(1), at(4)
    person, agent = fast.run(fast.default, 7), slow.run(slow.default, 7)
    for action in np.random.default_rng(1).choice([FIRE, RIGHT, LEFT, 0], 400).tolist():
        if agent.outcome != "running":
            break
        ticks = [person.step(action) for _ in range(4) if person.outcome == "running"]
        assert sum(ticks) == agent.step(action)
        assert observation_of(person) == observation_of(agent)
    assert (person.total, person.outcome) == (agent.total, agent.outcome)


@pytest.mark.long
def test_a_server_killed_in_the_middle_of_play_loses_no_tick_that_was_shown(spawn, tmp_path):
    server = spawn(task=BREAKOUT)
    client = server.client(headers={"Origin": server.url})
    board = client.post("/api/sessions", json={}).json()["session"]
    with server.socket(board, client) as socket:
        me = Keyboard(socket)
        me.go_on()
        me.hold("Space", 5)
        me.hold("ArrowLeft", 20)
        me.send(("keydown", "ArrowRight"))
        me.pass_ticks(30)
        server.kill()
    server = spawn(task=BREAKOUT)
    again = server.client(cookies=dict(client.cookies), headers={"Origin": server.url})
    with server.socket(board, again) as socket:
        me_again = Keyboard(socket)
        stored = me_again.frame["step"]
        assert stored >= me.frame["step"]  # what was committed and not shown any more is there too
        if stored == me.frame["step"]:
            assert me_again.frame == me.frame
        me_again.go_on()
        me_again.hold("ArrowLeft", 10)
    assert again.post(f"/api/sessions/{board}/episodes", json={}).status_code == 201
    server.kill()
    sql = "SELECT driver, attestation, attestation_reason, steps FROM episodes WHERE ended_ms IS NOT NULL"
    ((*level, steps),) = ask(tmp_path / "playground.db", sql)
    assert level == ["human", "attested", None]
    assert steps >= stored + 10
    assert verify_database(tmp_path / "playground.db").findings == ()
