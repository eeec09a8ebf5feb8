"""Sweeps: each run gives what training gives with the same seed, a failure stays alone; on Ray the same, and policy files
travel.
"""

import importlib.util
from dataclasses import replace

import pytest
import torch

from humanplay.jobs import LOCAL, ClusterError, JobError, Jobs
from humanplay.tasks.mars.cli.sweep import SweepRun, train_all
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import evaluate
from marsexplorer.training.config import RECIPES
from marsexplorer.training.network import load_net
from marsexplorer.training.ppo import TrainingRun, train
from tests.support import job_functions as functions
from tests.support.policy_files import write_network

CONFIG = EnvConfig("random", 7, 11, sensor_radius=3)
has_ray = pytest.mark.skipif(
    importlib.util.find_spec("ray") is None,
    reason="RAY IS ABSENT: pip install 'humanplay[ray]'",
)
pytestmark = [pytest.mark.long, pytest.mark.filterwarnings("ignore::DeprecationWarning:ray")]


@pytest.mark.parametrize("address", [None, pytest.param(LOCAL, marks=has_ray)])
def test_a_sweep_trains_what_training_here_gives_and_a_failure_stays_alone(address, tmp_path):
    def sweep_run(name, config, seed):
        return SweepRun(name, "best", config, 16384, seed, 4, {"summary": "Little."})

    whole, calls = CONFIG.to_dict(), []
    given = (("one", whole, 3), ("broken", {**whole, "rows": 3}, 0), ("two", whole, 4))
    runs = [sweep_run(*each) for each in given]
    with Jobs(2, ray=address) as jobs:
        one, failed, two = train_all(jobs, runs, tmp_path, lambda *done: calls.append(done))
    assert calls[-1] == (3, 3)
    assert "rows must be at least 5" in failed.error
    assert failed.policy is None
    run = TrainingRun.begin(RECIPES["best"], [CONFIG], 16384, 3)
    net = train(run, lambda metrics: None)
    trained, other = (load_net(each.policy).state_dict() for each in (one, two))
    assert all(torch.equal(trained[name], tensor) for name, tensor in net.state_dict().items())
    assert any(not torch.equal(tensor, other[name]) for name, tensor in trained.items())
    again = evaluate([str(one.policy), "frontier-cost", "frontier-utility"], CONFIG, 4, 10**9)
    row = again.rows[0]
    figures = (row.steps_mean, row.completion, row.score_mean)
    assert (one.steps, one.completion, one.score) == figures
    assert one.rule_ratio == again.compared(row).ratio_mean
    written = {path.name for path in (tmp_path / "one").iterdir()}
    assert written > {"one.onnx", "log.jsonl", "curve.png"}


@has_ray
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


@has_ray
def test_the_table_is_the_one_made_without_ray_and_policy_files_travel(tmp_path):
    names = ["frontier-cost", "random", str(write_network(tmp_path / "mine.onnx"))]
    configs, calls = [CONFIG, replace(CONFIG, level="1-1-1")], []
    with Jobs(2, ray=LOCAL) as jobs:
        given = (names, configs, 12, 5, lambda *done: calls.append(done))
        there = evaluate(*given, traces=True, executor=jobs)
    assert there == evaluate(names, configs, 12, 5, traces=True)
    assert calls[-1] == (72, 72)


@has_ray
def test_on_a_cluster_a_job_has_a_limit_and_its_errors_are_its_own(tmp_path):
    with Jobs(2, ray=LOCAL) as jobs:
        late = jobs.submit(functions.sleep, 600, limit_s=1)
        with pytest.raises(ValueError, match="cannot be done"):
            jobs.submit(functions.fail, tmp_path / "tried").result()
        with pytest.raises(JobError, match="took longer than 1 s"):
            late.result()
        with pytest.raises(JobError, match="ended early"):
            jobs.submit(functions.die).result()
