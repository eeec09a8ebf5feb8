"""A participant goes on where they stopped, after a reload, a lost link or a kill."""

import itertools
import random
import threading

import pytest

from humanplay.board.sources import Sources
from humanplay.tasks.mars.run import occupancy_codes
from marsexplorer.config import ACTIONS
from marsexplorer.policies import load
from tests.support.recorded import ask
from tests.support.servers import eventually
from tests.support.study import Person, freeze


@pytest.fixture(autouse=True)
def study(tmp_path):
    return freeze(tmp_path / "playground.db-studies")


def in_ranked(server):
    """A participant with one ranked episode begun and two moves made in it."""
    person = Person(server)
    person.to_warm_up()
    person.play_on(until=("ranked",))
    person.call("next")
    person.play(moves=2)
    person.me()
    return person


def test_a_reload_finds_the_same_frame_and_reveals_nothing_more(server):
    person = in_ranked(server)
    again = Person(server, client=server.client(cookies=dict(person.client.cookies)), joins=False)
    assert again.me() == person.where
    assert (again.frame["step"], again.frame["score"]) == (2, None)
    again.call("next")
    assert again.where == person.where


def test_a_lost_connection_goes_on_with_the_newest_frame_and_a_doubled_act_changes_nothing(server):
    person = in_ranked(server)
    with person.socket() as socket:
        before = socket.receive("frame")
        socket.act(
            before, "south", input="key"
        )  # and the connection is gone before the answer is read
    with person.socket() as socket:
        frame = eventually(lambda: (now := person.me()["about"]["frame"])["step"] == 3 and now)
        assert (
            socket.frame_after(2) == frame
        )  # the one before comes first, where the move was still being recorded
        socket.act(before, "south", input="key")
        refused = socket.receive("refused")
        assert refused["frame"] == frame
        assert frame["return"] is None


def test_a_second_tab_sees_every_move_and_can_make_the_next(server):
    person = in_ranked(server)
    with person.socket() as one, person.socket() as other:
        frame = one.receive("frame")
        assert other.receive("frame") == frame
        action = ACTIONS[load("frontier-cost").act(occupancy_codes(frame))]
        one.act(frame, action, input="key")
        here, there = one.frame_after(2), other.frame_after(2)
        assert here == there
        assert here["reward"] is None


def test_two_tabs_that_ask_for_the_next_episode_at_once_get_the_same_one(server):
    person = Person(server)
    person.to_warm_up()
    answers = []
    tabs = [server.client(cookies=dict(person.client.cookies)) for _ in range(6)]
    threads = [
        threading.Thread(target=lambda tab=tab: answers.append(tab.post(f"{person.url}/next")))
        for tab in tabs
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {answer.status_code for answer in answers} == {200}
    assert len({answer.json()["about"]["frame"]["episode"] for answer in answers}) == 1
    assert ask(
        server.services.store.path, "SELECT count(*) FROM series_episodes WHERE phase = 'warm_up'"
    ) == [(1,)]


def test_a_board_that_was_unloaded_comes_back_with_scores_hidden_and_closed_to_others(serve):
    server = serve(idle_s=0.2)
    person = in_ranked(server)
    session, lobby = person.where["session"], server.services.lobby
    eventually(lambda: len(lobby) == 0)
    assert server.client().get(f"/api/sessions/{session}").status_code == 404
    frame = person.client.get(f"/api/sessions/{session}").json()
    assert (frame["step"], frame["reward"], frame["return"], frame["score"]) == (
        2,
        None,
        None,
        None,
    )
    assert person.client.get(f"/api/sessions/{session}/about").json()["frame"] == frame


def test_a_participant_who_comes_back_after_a_week_goes_on(serve):
    now = itertools.count(1_700_000_000_000)
    late = [0]
    server = serve(Sources(clock_ms=lambda: next(now) + late[0]), idle_s=0.2)
    person = Person(server)
    person.to_warm_up()
    person.call("next")
    person.play()
    eventually(lambda: len(server.services.lobby) == 0)
    late[0] = 7 * 86_400_000
    assert person.me()["warm_up"] == {"done": 1, "of": 2}
    person.play_on()
    assert person.where["debrief"]["mean_score"] > 0


def go_on(person, acts, dice):
    """Begin the next episode, or make some moves by hand, for some acts.

    Returns the last frame that the participant saw.
    """
    seen = None
    for _ in range(acts):
        if person.me()["stage"] not in ("warm_up", "ranked"):
            return seen
        if person.frame["outcome"] is not None:
            person.call("next")
            seen = person.frame
        if dice.random() < 0.9:
            seen = person.play(moves=dice.randrange(1, 9))[-1]
    return seen


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "batch", [0, *(pytest.param(number, marks=pytest.mark.long) for number in range(1, 9))]
)
def test_a_killed_server_goes_on_with_the_same_episode_and_loses_and_doubles_no_step(
    spawn, tmp_path, batch
):
    dice = random.Random(batch)
    server, kills = spawn(), 0
    person = Person(server)
    person.to_warm_up()
    path = tmp_path / "playground.db"
    while person.me()["stage"] in ("warm_up", "ranked"):
        seen = go_on(person, dice.randrange(2, 6) if kills < 2 else 99, dice)
        state = person.me()
        server.kill()
        kills += 1
        server = spawn()
        person = Person(
            server, client=server.client(cookies=dict(person.client.cookies)), joins=False
        )
        assert person.me() == state
        assert seen is None or person.frame["episode"] == seen["episode"]
        counts = ask(path, "SELECT count(*), max(step) + 1 FROM steps GROUP BY episode_id")
        assert all(count == highest for count, highest in counts)
    assert (
        kills >= 2
    )  # the last of them after the last move: the debrief was reached in its transaction
    assert person.where["stage"] == "debrief"
    trials = ask(
        path,
        "SELECT phase, trial FROM series_episodes WHERE phase <> 'tutorial' ORDER BY phase, trial",
    )
    assert trials == [("ranked", 0), ("ranked", 1), ("ranked", 2), ("warm_up", 0), ("warm_up", 1)]
    assert ask(
        path, "SELECT count(DISTINCT terrain) FROM series_episodes WHERE phase = 'ranked'"
    ) == [(3,)]
    assert ask(path, "SELECT count(*) FROM episodes") == [(6,)]
    assert len(person.where["ending"]["code"]) == 8
    server.close()


def test_every_stage_before_the_first_episode_survives_a_kill(spawn):
    server = spawn()
    person = Person(server, outside_ids={"PROLIFIC_PID": "p"})
    person.call("consent", {"version": "1", "agree": True})
    person.call("settings", {"palette": "colour-blind"})
    before = person.me()
    server.kill()
    server = spawn()
    again = Person(server, client=server.client(cookies=dict(person.client.cookies)), joins=False)
    assert again.me() == before
    assert (before["stage"], before["settings"]["palette"]) == ("instructions", "colour-blind")
    again.call("advance", {"from": "instructions"})
    server.close()
