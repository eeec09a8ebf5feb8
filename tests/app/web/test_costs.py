"""The costs of an ended episode over HTTP, for who may see the episode."""

from dataclasses import replace

import pytest

from humanplay.task import PolicyError
from humanplay.tasks.mars.explanation import explain, explain_without_costs
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.cost import CostEstimator
from marsexplorer.evaluation.episodes import play_out
from marsexplorer.policies import load
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
    assert client.get(f"/api/episodes/{episode}/costs").status_code == 404
    east = about["frame"]["grid"][0][1] != "#"
    actions = ("east", "west", "north") if east else ("south", "north", "north")
    for step, action in enumerate(actions):
        act = {"episode": episode, "step": step, "action": action}
        client.post(f"/api/sessions/{session}/act", json=act)
    answer = server.client().get(f"/api/episodes/{episode}/costs")
    assert answer.status_code == 200
    costs = answer.json()
    assert (costs["episode"], costs["policy"], costs["reason"]) == (episode, "ppo", None)
    worst = costs["mistakes"][0]
    assert (worst["step"], worst["action"], worst["kind"]) == (2, "north", "ended early")
    assert worst["cost"] > 50
    assert costs["counts"] == 99
    gap = costs["counts"] - costs["expert_moves"]
    assert costs["total"] == gap == sum(move["cost"] for move in costs["expert"])
    assert sum(costs["by_kind"].values()) + costs["gained"] == gap
    assert worst["previous"] == ("west" if east else "north")
    assert (len(worst["grid"]), len(worst["grid"][0])) == (9, 11)
    assert worst["grid"][worst["position"][0]][worst["position"][1]] == "@"
    assert worst["discovered"] == 99 - "".join(worst["grid"]).count("?")
    assert worst["missed"], "Expert's move would have shown something"
    assert all(worst["grid"][row][col] == "?" for row, col in worst["missed"])
    assert worst["seen_at"] is None, "and it was never seen"
    for move in costs["expert"]:
        assert move["shares"][ACTIONS.index(move["action"])] == max(move["shares"])
        assert 0 < move["needs"] < 99
    assert client.get("/api/episodes/none/costs").status_code == 404


def test_nothing_of_an_open_study(serve, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", close=False)
    recorder = StudyRecorder(tmp_path / "playground.db", study)
    person = recorder.join(0)
    episodes = [recorder.play(person, "warm_up", 0), recorder.play(person, "ranked", 0)]
    recorder.close()
    client = serve().page()
    for episode in episodes:
        assert client.get(f"/api/episodes/{episode}/costs").status_code == 404
    assert client.get("/api/studies/dunes/debrief/0/costs").status_code in (403, 404, 409)


def test_it_says_what_the_estimator_says(tmp_path):
    costs = explain(tmp_path / "costs", ended().record(), "ppo")
    assert costs["total"] == CostEstimator().costs(ended().record()).total
    assert costs == explain(tmp_path / "costs", ended().record(), "ppo"), "as kept in the folder"


def test_where_no_move_is_judged_the_answer_has_experts_episode_and_the_reason(server):
    client = server.page()
    about = client.post("/api/sessions", json={"size": [43, 42], "seed": 3}).json()
    episode, session = about["frame"]["episode"], about["session"]
    act = {"episode": episode, "step": 0, "action": "north"}
    client.post(f"/api/sessions/{session}/act", json=act)
    answer = client.get(f"/api/episodes/{episode}/costs")
    assert answer.status_code == 200
    costs = answer.json()
    assert costs["reason"].endswith("this board has 43x42, so none of its moves is judged")
    config = EnvConfig.of("random", (43, 42))
    expert = play_out(load("ppo"), Episode.begin(config, seed=3), 0)
    assert (costs["counts"], costs["expert_moves"]) == (config.limit, expert.steps)
    assert costs["total"] == config.limit - expert.steps
    assert (costs["mistakes"], costs["expert"]) == ([], [])


def test_a_study_without_a_file_of_expert_has_none_of_another_version(tmp_path):
    study = freeze(tmp_path / "playground.db-studies")
    assert study.policy_files.expert("ppo") == "ppo"
    with pytest.raises(PolicyError, match="no file of ppo was kept when the study was frozen"):
        replace(study.policy_files, hashes={}).expert("ppo")
    record = ended().record()
    costs = explain_without_costs(record, "no file of ppo was kept")
    assert (costs["counts"], costs["expert_moves"], costs["total"]) == (99, None, None)
