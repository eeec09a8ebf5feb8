"""Ray: the table is the same on a cluster, and a missing one is one sentence."""

import importlib.util
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from humanplay.jobs import JobError
from humanplay.tasks.mars.cli.cluster import LOCAL, Cluster, ClusterError
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import evaluate
from tests.support import job_functions as functions
from tests.support.fresh_machine import children
from tests.support.policy_files import write_network
from tests.support.servers import PATIENCE_S, eventually

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
        Cluster(address)


def test_the_table_is_the_one_made_without_ray_and_policy_files_travel(tmp_path):
    names = ["frontier-cost", "random", str(write_network(tmp_path / "mine.onnx"))]
    configs, calls = [CONFIG, replace(CONFIG, level="1-1-1")], []
    with Cluster(LOCAL) as cluster:
        arguments = (names, configs, 12, 5, lambda *done: calls.append(done))
        there = evaluate(*arguments, traces=True, executor=cluster)
    assert there == evaluate(names, configs, 12, 5, traces=True)
    assert calls[-1] == (72, 72)


def test_on_a_cluster_the_error_of_a_call_is_its_own(tmp_path):
    with Cluster(LOCAL) as cluster:
        failed = cluster.submit(functions.fail, tmp_path / "tried")
        died = cluster.submit(functions.die)
        assert cluster.submit(functions.add, 1, 2).result() == 3
        with pytest.raises(ValueError, match="cannot be done"):
            failed.result()
        with pytest.raises(JobError, match="ended early"):
            died.result()


def runs_a_call(node):
    """Whether a machine of a cluster plays."""
    from ray._private.ray_constants import PROCESS_TYPE_RAYLET

    (raylet,) = node.all_processes[PROCESS_TYPE_RAYLET]
    names = [Path(f"/proc/{pid}/cmdline") for pid in children(raylet.process.pid)]
    return any(name.read_text().startswith("ray::_call_there") for name in names if name.exists())


@pytest.mark.timeout(600)
def test_the_table_is_the_same_where_one_of_three_machines_dies(tmp_path):
    """The calls that ran there are made again by the other two."""
    from ray.cluster_utils import Cluster as Machines

    evaluate = ["-m", "humanplay.tasks.mars.cli", "evaluate", "--policy", "frontier-cost"]
    evaluate += ["--size", "42", "--episodes", "200", "--json"]
    machines = Machines(initialize_head=True, head_node_args={"num_cpus": 1})
    try:
        others = [machines.add_node(num_cpus=1) for _ in range(2)]
        there = [*evaluate, tmp_path / "there.json", "--ray", machines.address]
        with subprocess.Popen([sys.executable, *there]) as process:
            eventually(lambda: process.poll() is not None or runs_a_call(others[0]), 2 * PATIENCE_S)
            assert process.poll() is None, "it has ended before"
            machines.remove_node(others[0], allow_graceful=False)
            assert process.wait(8 * PATIENCE_S) == 0
    finally:
        machines.shutdown()
    subprocess.run([sys.executable, *evaluate, tmp_path / "here.json"], check=True)
    assert (tmp_path / "there.json").read_bytes() == (tmp_path / "here.json").read_bytes()
