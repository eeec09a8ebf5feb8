"""The regret of an ended episode over HTTP: for who may see the episode, and never of an open study's ranked terrains."""

import asyncio

import pytest

from app.jobs import Jobs
from app.tasks.mars.explanation import explanation_of
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.regret import RegretEstimator
from tests.support.stored_studies import StudyRecorder, freeze

SMALL = EnvConfig("random", 9, 11, sensor_radius=3)


def ended(seed=3):
    """A short episode that ended off the grid."""
    episode = Episode.begin(SMALL, seed=seed)
    for action in (1, 3, 0) if not episode.terrain[0, 1] else (2, 0, 0):
        episode.step(action)
    return episode


def test_an_ended_episode_and_no_running_one(server):
    client = server.page()
    about = client.post("/api/sessions", json={"size": [9, 11], "seed": 3}).json()
    episode, session = about["frame"]["episode"], about["session"]
    assert client.get(f"/api/episodes/{episode}/regret").status_code == 404
    east = about["frame"]["grid"][0][1] != "#"
    actions = ("east", "west", "north") if east else ("south", "north", "north")
    for step, action in enumerate(actions):
        act = {"episode": episode, "step": step, "action": action}
        client.post(f"/api/sessions/{session}/act", json=act)
    answer = server.client().get(f"/api/episodes/{episode}/regret")
    assert answer.status_code == 200
    found = answer.json()
    assert (found["episode"], found["policy"]) == (episode, "ppo")
    worst = found["losses"][0]
    assert (worst["step"], worst["action"], worst["kind"]) == (2, "north", "ended early")
    assert found["total"] >= worst["regret"] > 50
    assert worst["previous"] == ("west" if east else "north")
    assert (len(worst["grid"]), len(worst["grid"][0])) == (9, 11)
    assert worst["grid"][worst["position"][0]][worst["position"][1]] == "@"
    assert worst["discovered"] == 99 - "".join(worst["grid"]).count("?")
    assert worst["missed"], "the better move would have shown something"
    assert all(worst["grid"][row][col] == "?" for row, col in worst["missed"])
    assert worst["seen_at"] is None, "and it was never seen"
    advice = found["expert"]
    assert [each["costs"] is None for each in advice] == [False, False, True], "the last crashed"
    for each in advice:
        assert each["shares"][ACTIONS.index(each["action"])] == max(each["shares"])
        assert 0 < each["needs"] < 99
    assert client.get("/api/episodes/none/regret").status_code == 404


def test_nothing_of_an_open_study(serve, tmp_path):
    study = freeze(tmp_path / "studies", close=False)
    recorder = StudyRecorder(tmp_path / "playground.db", study)
    person = recorder.join(0)
    episodes = [recorder.play(person, "warm_up", 0), recorder.play(person, "ranked", 0)]
    recorder.close()
    client = serve().page()
    for episode in episodes:
        assert client.get(f"/api/episodes/{episode}/regret").status_code == 404
    assert client.get("/api/studies/dunes/debrief/0/regret").status_code in (403, 404, 409)


def test_it_says_what_the_estimator_says_and_refuses_large_boards_at_once(tmp_path):
    async def ask(record):
        return await explanation_of(jobs, tmp_path / "regrets", record, "ada")

    with Jobs(1) as jobs:
        found = asyncio.run(ask(ended().record()))
        assert found["total"] == RegretEstimator().regret(ended().record()).total
        with pytest.raises(ValueError, match="up to 1764 cells"):
            asyncio.run(ask(Episode.begin(EnvConfig.of("random", 43), seed=1).record()))
