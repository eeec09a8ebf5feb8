"""Policies' evaluations in the background: kept, failed, and matched exactly."""

import json
import os
import signal

import pytest

from humanplay.jobs import Jobs
from humanplay.results.evaluations import OWNER, Evaluation, PolicyEvaluations, policy_hash
from marsexplorer.config import CORE_VERSION, EnvConfig
from tests.support.job_functions import pid
from tests.support.servers import eventually

TINY = EnvConfig("random", 5, 7)
pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def jobs():
    with Jobs(1) as runner:
        yield runner


def settle(evaluations, wanted):
    """The states once nothing waits or is computed any more."""

    def states():
        figures = evaluations.request(wanted)
        return figures if {figure["state"] for figure in figures} <= {"ready", "failed"} else None

    return eventually(states, 240)


def test_figures_of_another_core_or_a_torn_file_are_not_used(tmp_path, jobs):
    path = tmp_path / "figures.json"
    figure = {"curve": {}}
    path.write_text(json.dumps({f"{CORE_VERSION}|a": figure, "0|b": figure}))
    assert list(PolicyEvaluations(path, jobs)._done) == [f"{CORE_VERSION}|a"]
    path.write_text('{"1|a": {"cur')
    assert PolicyEvaluations(path, jobs)._done == {}


def test_a_policy_that_fails_says_so_and_the_others_go_on(tmp_path, jobs):
    path = tmp_path / "figures.json"
    wanted = [Evaluation("nope", TINY, (1, 2)), Evaluation("frontier-cost", TINY, (1, 2))]
    failed, ready = settle(PolicyEvaluations(path, jobs), wanted)
    assert (failed["state"], failed["figure"], ready["state"]) == ("failed", None, "ready")
    assert 'no policy "nope"' in failed["error"]
    again = eventually(lambda: PolicyEvaluations(path, jobs).request(wanted[1:])[0]["figure"])
    assert again == json.loads(json.dumps(ready["figure"])), "it is kept"


def test_an_evaluation_that_dies_is_said_to_have_died_and_the_next_one_is_made(tmp_path, jobs):
    evaluations = PolicyEvaluations(tmp_path / "figures.json", jobs)
    worker = jobs.submit(pid, owner=OWNER).result()
    long = Evaluation("random", EnvConfig.of("random", 21), tuple(range(5000)))
    wanted = [long, Evaluation("random", TINY, (1, 2))]
    eventually(lambda: evaluations.request(wanted)[0]["done"] > 0)
    assert [figure["state"] for figure in evaluations.request(wanted)] == ["computing", "waiting"]
    os.kill(worker, signal.SIGKILL)
    died, ready = settle(evaluations, wanted)
    assert (died["state"], died["figure"], ready["state"]) == ("failed", None, "ready")
    assert "ended early, with code -9" in died["error"]


def test_a_policys_hash_is_of_its_file(tmp_path):
    one, two = tmp_path / "one.onnx", tmp_path / "two.onnx"
    one.write_bytes(b"1")
    two.write_bytes(b"2")
    sources = (str(one), str(two), "ppo", "random")
    assert len({policy_hash(source) for source in sources}) == 4
