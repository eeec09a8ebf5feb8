"""Sweeps: each run equals a training with its seed, and a failure stays alone.

On Ray the same, and policy files travel.
"""

import importlib.util

import pytest
import torch

from humanplay.jobs import Jobs
from humanplay.tasks.mars.cli.cluster import LOCAL, Cluster
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import evaluate
from marsexplorer.training.config import RECIPES
from marsexplorer.training.network import load_net
from marsexplorer.training.ppo import TrainingRun, train
from research.sweep.sweep import SweepRun, train_all

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
    settings = (("one", whole, 3), ("broken", {**whole, "rows": 3}, 0), ("two", whole, 4))
    runs = [sweep_run(*setting) for setting in settings]
    with Cluster(address) if address else Jobs(2) as jobs:
        one, failed, two = train_all(jobs, runs, tmp_path, lambda *done: calls.append(done))
    assert calls[-1] == (3, 3)
    assert "rows must be at least 5" in failed.error
    assert failed.policy is None
    run = TrainingRun.begin(RECIPES["best"], [CONFIG], 16384, 3)
    net = train(run, lambda metrics: None)
    trained, other = (load_net(result.policy).state_dict() for result in (one, two))
    assert all(torch.equal(trained[name], tensor) for name, tensor in net.state_dict().items())
    assert any(not torch.equal(tensor, other[name]) for name, tensor in trained.items())
    again = evaluate([str(one.policy), "frontier-cost", "frontier-utility"], CONFIG, 4, 10**9)
    row = again.rows[0]
    figures = (row.steps_mean, row.completion, row.score_mean)
    assert (one.steps, one.completion, one.score) == figures
    assert one.rule_ratio == again.compared(row).ratio_mean
    written = {path.name for path in (tmp_path / "one").iterdir()}
    assert written > {"one.onnx", "log.jsonl", "curve.png"}
