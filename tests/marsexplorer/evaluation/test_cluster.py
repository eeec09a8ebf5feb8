"""On a local Ray of two workers: the same table, the same weights, and one failed run leaves the others as they are."""

import importlib.util
from dataclasses import replace

import pytest
import torch
from safetensors.torch import load_file

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import INFORMED, evaluate
from marsexplorer.evaluation.cluster import LOCAL, ClusterError, session
from marsexplorer.policies.files.weights import save_network
from marsexplorer.policies.network.model import Net
from marsexplorer.training.config import RECIPES
from marsexplorer.training.ppo import TrainingRun, train
from marsexplorer.training.sweep import SweepRun, sweep

pytestmark = [
    pytest.mark.long,
    pytest.mark.filterwarnings("ignore::DeprecationWarning:ray"),
    pytest.mark.skipif(
        importlib.util.find_spec("ray") is None,
        reason="RAY IS ABSENT: pip install 'marsexplorer-playground[ray]'",
    ),
]

CONFIG = EnvConfig("random", 7, 11, sensor_radius=3)


@pytest.fixture(scope="module")
def cluster():
    with session(LOCAL, workers=2) as ray:
        yield ray


@pytest.mark.parametrize(
    ("address", "part"),
    [
        ("ray://127.0.0.1:9", "no Ray cluster answers at ray://127.0.0.1:9"),
        ("127.0.0.1:9", "no Ray cluster answers at 127.0.0.1:9"),
        ("head", "expected a Ray address like HOST:PORT"),
    ],
)
def test_a_cluster_that_is_not_there_is_one_sentence_at_once(address, part):
    with pytest.raises(ClusterError, match=part), session(address):
        pass


def test_the_table_is_the_one_made_without_ray_and_policy_files_travel(cluster, tmp_path):
    torch.manual_seed(1)
    save_network(Net(), tmp_path / "mine.safetensors", {"summary": "Untrained."})
    names = ["frontier-cost", "random", INFORMED, str(tmp_path / "mine.safetensors")]
    configs, calls = [CONFIG, replace(CONFIG, level="1-1-1")], []
    there = evaluate(
        names, configs, 12, 5, lambda *done: calls.append(done), traces=True, ray=LOCAL
    )
    assert there == evaluate(names, configs, 12, 5, workers=1, traces=True)
    assert calls[-1] == (96, 96)
    assert cluster.is_initialized()


def test_a_sweep_trains_what_training_here_gives_and_a_failure_stays_alone(cluster, tmp_path):
    def sweep_run(name, config, seed):
        return SweepRun(name, "best", config, 16384, seed, 4, {"summary": "Little."})

    broken = {**CONFIG.to_dict(), "rows": 3}
    runs = [
        sweep_run("one", CONFIG.to_dict(), 3),
        sweep_run("broken", broken, 0),
        sweep_run("two", CONFIG.to_dict(), 4),
    ]
    calls = []
    one, failed, two = sweep(runs, tmp_path, LOCAL, lambda *done: calls.append(done))
    assert calls[-1] == (3, 3)
    assert "rows must be at least 5" in failed.error
    assert failed.policy is None
    run = TrainingRun.begin(RECIPES["best"], [CONFIG], 16384, 3)
    net = train(run, lambda metrics: None)
    weights = load_file(one.policy)
    assert all(torch.equal(weights[name], tensor) for name, tensor in net.state_dict().items())
    assert any(
        not torch.equal(tensor, load_file(two.policy)[name]) for name, tensor in weights.items()
    )
    again = evaluate(
        [str(one.policy), "frontier-cost", "frontier-utility"], CONFIG, 4, 10**9, workers=1
    )
    assert (one.steps, one.completion, one.score) == (
        again.rows[0].steps_mean,
        again.rows[0].completion,
        again.rows[0].score_mean,
    )
    assert one.rule_ratio == again.compared(again.rows[0], "rule").ratio_mean
    assert {path.name for path in (tmp_path / "one").iterdir()} > {
        "one.safetensors",
        "log.jsonl",
        "curve.png",
    }
