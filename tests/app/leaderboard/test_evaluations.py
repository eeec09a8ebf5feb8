"""Policies' evaluations in the background: what is kept, what fails, and what a figure belongs to."""

import asyncio
import json

import pytest

from app.leaderboard.evaluations import PolicyEvaluations
from app.leaderboard.jobs import EvaluationJob, policy_hash
from marsexplorer.config import CORE_VERSION, EnvConfig

TINY = EnvConfig("random", 5, 7)
IDLE_WORK_S = 600
"""Evaluations have the lowest priority: they take long while other jobs run."""
pytestmark = pytest.mark.timeout(900)


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
        jobs = [
            EvaluationJob("planner", EnvConfig.of("random", 21), tuple(range(500))),
            EvaluationJob("random", TINY, (1, 2)),
        ]
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
    assert (
        len(
            {
                policy_hash(str(one)),
                policy_hash(str(two)),
                policy_hash("ppo"),
                policy_hash("random"),
            }
        )
        == 4
    )
