"""Ray: a cluster that is not there is one sentence, and on one that is a table is the same and a job's errors are its own."""

import importlib.util
from dataclasses import replace

import pytest

from humanplay.jobs import LOCAL, ClusterError, JobError, Jobs
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import evaluate
from tests.support import job_functions as functions
from tests.support.policy_files import write_network

CONFIG = EnvConfig("random", 7, 11, sensor_radius=3)
has_ray = pytest.mark.skipif(
    importlib.util.find_spec("ray") is None,
    reason="RAY IS ABSENT: pip install 'humanplay[ray]'",
)
pytestmark = [
    pytest.mark.long,
    pytest.mark.filterwarnings("ignore::DeprecationWarning:ray"),
    has_ray,
]


@pytest.mark.parametrize(
    ("address", "part"),
    [
        ("ray://127.0.0.1:9", "no Ray cluster answers at ray://127.0.0.1:9"),
        ("127.0.0.1:9", "no Ray cluster answers at 127.0.0.1:9"),
        ("head", "expected a Ray address like HOST:PORT"),
    ],
)
def test_a_cluster_that_is_not_there_is_one_sentence_at_once(address, part):
    with pytest.raises(ClusterError, match=part):
        Jobs(ray=address)


def test_the_table_is_the_one_made_without_ray_and_policy_files_travel(tmp_path):
    names = ["frontier-cost", "random", str(write_network(tmp_path / "mine.onnx"))]
    configs, calls = [CONFIG, replace(CONFIG, level="1-1-1")], []
    with Jobs(2, ray=LOCAL) as jobs:
        given = (names, configs, 12, 5, lambda *done: calls.append(done))
        there = evaluate(*given, traces=True, executor=jobs)
    assert there == evaluate(names, configs, 12, 5, traces=True)
    assert calls[-1] == (72, 72)


def test_on_a_cluster_a_job_has_a_limit_and_its_errors_are_its_own(tmp_path):
    with Jobs(2, ray=LOCAL) as jobs:
        late = jobs.submit(functions.sleep, 600, limit_s=1)
        with pytest.raises(ValueError, match="cannot be done"):
            jobs.submit(functions.fail, tmp_path / "tried").result()
        with pytest.raises(JobError, match="took longer than 1 s"):
            late.result()
        with pytest.raises(JobError, match="ended early"):
            jobs.submit(functions.die).result()
