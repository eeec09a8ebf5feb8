"""People and policies on one scale: figures from the database and from real evaluation, kept, never invented."""

import asyncio
import json

import numpy as np
import pytest
from scipy import stats

from app.leaderboard import entries
from app.leaderboard.closed_studies import ClosedStudies
from app.leaderboard.evaluations import EvaluationJob, PolicyEvaluations, policy_hash
from app.statistics.summaries import EpisodeSummary, coverage_curve, summarize, trial_summaries, visit_counts
from app.storage.store import Store
from app.study.folder import Folder
from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.evaluation import evaluate
from marsexplorer.training.envs import EVALUATION_SEEDS
from tests.support.recorded import SMALL, add_session, open_episode, play
from tests.support.servers import eventually
from tests.support.study import Person, freeze

TINY = EnvConfig("random", 5, 7)
IDLE_WORK_S = 600
"""Evaluations for a board have the lowest priority: they take long while other jobs run."""
pytestmark = pytest.mark.timeout(900)


def episode(discoveries, path=((0, 0), (0, 1)), steps=9, score=0.5, outcome="explored"):
    return EpisodeSummary(outcome, score, steps, discoveries, path)


def test_a_curve_is_the_mean_over_groups_and_an_ended_episode_keeps_what_it_had():
    made = coverage_curve(TINY, [[episode([7, 14]), episode([7, 21])], [episode([7, 7, 35])]])
    assert made["steps"] == [0, 1, 2]
    first, second = np.array([7, 17.5, 17.5]) / 35, np.array([7, 7, 35]) / 35
    assert made["mean"] == pytest.approx((first + second) / 2, abs=1e-4)
    low, high = stats.t.interval(0.95, 1, loc=(first[2] + second[2]) / 2, scale=stats.sem([first[2], second[2]]))
    assert (made["low"][2], made["high"][2]) == pytest.approx((low, high), abs=1e-4)
    alone = coverage_curve(TINY, [[episode([7, 14])]])
    assert (alone["low"], alone["high"]) == ([], []), "one group gives no interval"


def test_visits_count_each_stand_and_leave_out_what_lies_off_the_grid():
    found = np.array(visit_counts(TINY, [[episode([1], [(0, 0), (0, 1), (0, 0), (-1, 0)])], [episode([1], [(0, 0), (4, 6)])]]))
    assert found.shape == (5, 7)
    assert (found[0, 0], found[0, 1], found[4, 6], found.sum()) == (1.5, 0.5, 0.5, 2.5)


def test_trials_say_on_how_many_people_each_point_rests():
    made = trial_summaries([[episode([1], steps=10), episode([1], steps=8)], [episode([1], steps=20)]])
    assert [(each["trial"], each["players"], each["steps"]["mean"]) for each in made] == [(1, 2, 15.0), (2, 1, 8.0)]
    assert made[1]["steps"]["low"] is None


def test_policies_terrains_are_those_that_training_refuses():
    assert EVALUATION_SEEDS.start == entries.FIRST_SEED
    for size, count in ((21, 100), (42, 40), (84, 10)):
        seeds = entries.held_out_seeds(EnvConfig.of("random", size))
        assert (len(seeds), set(seeds) - set(EVALUATION_SEEDS)) == (count, set())


def test_boards_that_people_have_played_stand_first_and_others_wait(tmp_path):
    store = Store(tmp_path / "play.db")
    try:
        players = [entry.to_dict()["players"] for entry in entries.list_entries(store, ClosedStudies())]
        assert players == [0] * len(entries.OFFERED)
        play(store, seed=1, explore=True)
        first, *rest = entries.list_entries(store, ClosedStudies())
    finally:
        store.close()
    assert first.config == SMALL
    assert first.id == f"random-5x7-{SMALL.hash[:8]}", "another sensor than the level's own"
    assert first.to_dict()["players"] == 1
    assert [board.id for board in rest][:2] == ["random-21x21", "1-1-1-21x21"]


@pytest.fixture
def quick(monkeypatch):
    """Boards of five terrains: the server evaluates in seconds."""
    monkeypatch.setattr(entries, "held_out_seeds", lambda config: tuple(range(entries.FIRST_SEED, entries.FIRST_SEED + 5)))


def settled(client, board):
    """The board once every policy has its figure; every answer until then is honest."""

    def ask():
        found = client.get(f"/api/leaderboard/{board}").json()
        for policy in found["policies"]:
            assert policy["state"] in ("ready", "computing", "waiting"), policy["error"]
            assert (policy["figure"] is None) == (policy["state"] != "ready")
            assert policy["done"] <= policy["of"] == 5
        return found if all(policy["figure"] for policy in found["policies"]) else None

    return eventually(ask, IDLE_WORK_S)


def test_a_board_shows_people_and_policies_and_what_is_made_is_kept(serve, quick, tmp_path):
    config = EnvConfig("random", 5, 7)
    store = Store(tmp_path / "playground.db")
    for seed in (1, 2, 3):
        play(store, seed, "ada", explore=True, config=config)
    play(store, 4, "bob", config=config)
    play(store, 5, "rob", config=config, driver="script")
    play(store, 6, "eve", explore=True, config=config, assisted=True)
    open_episode(store, add_session(store, "bob"), 7, config)
    store.close()
    server = serve()
    client = server.client()
    first = client.get("/api/leaderboard").json()[0]
    assert (first["id"], first["players"], first["episodes"]) == ("random-5x7", 2, 4)

    found = settled(client, "random-5x7")
    level = client.get("/api/human-level").json()["figures"][0]
    assert found["people"]["score"] == level["score"], "the page's one human level"
    assert [each["players"] for each in found["people"]["trials"]] == [2, 1, 1]
    assert np.shape(found["people"]["visits"]) == (5, 7)
    assert found["people"]["curve"]["mean"][0] < found["people"]["curve"]["mean"][-1] <= 1

    table = evaluate([policy["name"] for policy in found["policies"]], config, 5, entries.FIRST_SEED, workers=1)
    for policy, row in zip(found["policies"], table.rows, strict=True):
        made = policy["figure"]
        assert policy["name"] == row.policy
        assert (made["episodes"], made["completed"]) == (5, row.completion)
        assert made["steps"] == pytest.approx({"mean": row.steps_mean, "low": row.steps_low, "high": row.steps_high})
        assert made["score"] == pytest.approx({"mean": row.score_mean, "low": row.score_low, "high": row.score_high})
    server.stop()

    again = serve().client().get("/api/leaderboard/random-5x7").json()
    assert [policy["figure"] for policy in again["policies"]] == [policy["figure"] for policy in found["policies"]]


def test_nobody_has_played(serve, quick):
    client = serve().client()
    found = client.get("/api/leaderboard/random-21x21").json()
    assert found["people"] is None
    assert "Nobody has played" in found["sentence"]
    assert all(policy["figure"] is None for policy in found["policies"]), "no figure before it is made"
    missing = client.get("/api/leaderboard/random-9x9")
    assert (missing.status_code, missing.json()["detail"][:24]) == (404, "no board 'random-9x9' on")


def test_a_study_appears_when_it_is_closed_with_policies_on_its_own_terrains(serve, tmp_path):
    study = freeze(tmp_path / "studies")
    server = serve()
    person = Person(server)
    person.to_warm_up()
    frames = person.play_on()["ranked"]
    script = Person(server, script="noisy-frontier")
    script.to_warm_up()
    client = server.client()
    assert not [board for board in client.get("/api/leaderboard").json() if board["study"]], "open: scores are hidden"
    assert client.get("/api/leaderboard/study-small").status_code == 404
    assert client.get("/api/leaderboard/random-7x9").status_code == 404, "a study's episodes make no playground figure"
    Folder(tmp_path / "studies").close("small")
    first = client.get("/api/leaderboard").json()[0]
    assert (first["id"], first["study"], first["players"], first["terrains"]) == ("study-small", "small", 1, 3)

    def made():
        found = client.get("/api/leaderboard/study-small").json()
        return found if found["policies"][0]["figure"] else None

    found = eventually(made, IDLE_WORK_S)
    steps = [played[-1]["step"] if played[-1]["outcome"] == "explored" else 63 for played in frames]
    assert (found["people"]["players"], found["people"]["steps"]["mean"]) == (1, pytest.approx(np.mean(steps)))
    assert [each["steps"]["mean"] for each in found["people"]["trials"]] == steps
    assert np.shape(found["people"]["visits"]) == (7, 9)
    assert [policy["name"] for policy in found["policies"]] == ["frontier-cost"]
    own = [evaluate(["frontier-cost"], study.protocol.env_config, 2, study.seed("ranked", i), workers=1) for i in range(3)]
    mean = np.mean([table.results[0].steps_to_99 for table in own])
    assert found["policies"][0]["figure"]["steps"]["mean"] == pytest.approx(mean)


def test_a_page_for_people_that_links_back(serve):
    answer = serve().client().get("/leaderboard")
    assert answer.status_code == 200
    assert 'href="./"' in answer.text


def test_figures_of_another_core_or_a_torn_file_are_not_used(tmp_path):
    path = tmp_path / "figures.json"
    kept = {"curve": {}}
    path.write_text(json.dumps({f"{CORE_VERSION}|a": kept, "0|b": kept}))
    assert list(PolicyEvaluations(path)._done) == [f"{CORE_VERSION}|a"]
    path.write_text('{"1|a": {"cur')
    assert PolicyEvaluations(path)._done == {}


def test_a_policy_that_fails_says_so_and_the_others_go_on(tmp_path):
    async def settle():
        figures = PolicyEvaluations(tmp_path / "figures.json")
        jobs = [EvaluationJob("nope", TINY, (1, 2)), EvaluationJob("frontier-cost", TINY, (1, 2))]
        try:
            while any(each["state"] in ("waiting", "computing") for each in figures.request(jobs)):
                await asyncio.sleep(0.05)
            return figures.request(jobs)
        finally:
            await figures.close()

    failed, made = asyncio.run(asyncio.wait_for(settle(), IDLE_WORK_S))
    assert (failed["state"], failed["figure"], made["state"]) == ("failed", None, "ready")
    assert 'no policy "nope"' in failed["error"]


def test_an_evaluation_that_dies_is_said_to_have_died(tmp_path):
    async def settle():
        figures = PolicyEvaluations(tmp_path / "figures.json")
        jobs = [EvaluationJob("planner", EnvConfig.of("random", 21), tuple(range(500))), EvaluationJob("random", TINY, (1, 2))]
        try:
            while figures.request(jobs)[0]["done"] == 0:
                await asyncio.sleep(0.05)
            figures._process.kill()
            while figures.request(jobs)[0]["state"] == "computing":
                await asyncio.sleep(0.05)
            return figures.request(jobs)
        finally:
            await figures.close()

    for state in asyncio.run(asyncio.wait_for(settle(), IDLE_WORK_S)):
        assert (state["state"], state["figure"]) == ("failed", None)
        assert state["error"] == "the evaluation ended early; restart the server to try again"


def test_a_policys_hash_is_of_its_file(tmp_path):
    one, two = tmp_path / "one.safetensors", tmp_path / "two.safetensors"
    one.write_bytes(b"1")
    two.write_bytes(b"2")
    assert len({policy_hash(str(one)), policy_hash(str(two)), policy_hash("ppo"), policy_hash("random")}) == 4


def test_the_unit_of_a_figure_is_the_group():
    made = summarize(TINY, [[episode([1], steps=10), episode([1], steps=20, outcome="collided")], [episode([1], steps=30)]])
    assert (made["groups"], made["episodes"], made["steps"]["mean"], made["completed"]) == (2, 3, 22.5, 0.75)
