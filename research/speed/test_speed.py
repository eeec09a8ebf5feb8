"""The measuring code plays what it names, and the command writes every figure."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest

from humanplay.db.store import Store
from marsexplorer.config import EnvConfig
from research.speed import core, decisions, figures, floods, peers
from tests.support.recorded import play

SMALL = EnvConfig.of("random", (5, 7))


def test_recorded_moves_are_valid_and_play_back_to_the_same_worlds():
    moves = core.moves_of(SMALL, 6, 80)
    first, second = core.started(SMALL, 6), core.started(SMALL, 6)
    collided = 0
    for row in moves:
        first.step_autoreset(row)
        collided += int(np.isin(first.outcomes, (2, 3)).sum())
    core.play(second, moves)
    assert collided == 0
    assert (first.codes == second.codes).all()
    assert len(np.unique(moves)) == 4


def test_blind_moves_do_collide():
    worlds, collided = core.started(SMALL, 6), 0
    for row in core.moves_of(SMALL, 6, 80, blind=True):
        worlds.step_autoreset(row)
        collided += int(np.isin(worlds.outcomes, (2, 3)).sum())
    assert collided > 20


def test_a_stack_is_faster_than_one_world():
    one = core.steps_per_cpu_second(SMALL, 1, 3000, repeats=1)
    assert core.steps_per_cpu_second(SMALL, 256, 50_000, repeats=1) > 2 * one


def test_the_replay_through_gymnasium_meets_no_wall():
    import gymnasium

    import marsexplorer  # noqa: F401

    env = gymnasium.make("MarsExplorer-v0")
    ended = []
    step = env.step

    def watched(action):
        transition = step(action)
        ended.append(transition[4]["outcome"])
        return transition

    env.step = watched
    assert core.replay(env, core.moves_of(EnvConfig(), 1, 1000)[:, 0].tolist()) == 1000
    assert {"timed_out"} <= set(ended) <= {None, "timed_out", "explored"}


def test_verdicts_go_the_right_way():
    assert figures.Figure("core", "a", 2.0, "s", target=1.0).verdict == "reached"
    assert figures.Figure("core", "a", 2.0, "s", target=1.0, at_most=True).verdict == "missed"
    assert figures.Figure("core", "a", 2.0, "s").verdict == ""
    assert figures.Figure("core", "a", None, "s", target=1.0).verdict == ""


@pytest.mark.parametrize(
    ("module", "note"),
    [("no_such_module_at_all", "not installed: pip install it"), ("numpy", "failed: .+")],
)
def test_a_peer_that_is_absent_says_how_to_install_it_and_one_that_fails_says_why(module, note):
    figure = peers.measure(peers.Peer("No such peer", module, "it", lambda: lambda: 1), 0.1)
    assert figure.value is None
    assert re.fullmatch(note, figure.note)


def test_frozen_lake_is_always_there():
    figure = peers.measure(next(peer for peer in peers.PEERS if peer.module == "gymnasium"), 0.1)
    assert figure.value > 1000


def test_a_move_of_a_network_takes_less_in_a_stack_than_alone_and_a_rule_has_no_stack():
    alone, together = decisions.decide("ppo", 12)
    assert 0 < together.value < alone.value
    assert [figure.name for figure in decisions.decide("frontier-priced", 12)] == [
        "frontier-priced, a move alone, 12x12"
    ]


def test_json_carries_every_figure():
    some = [
        figures.Figure("core", "a", 2.0, "s", target=1.0),
        figures.Figure("peers", "b", None, "s", note="why"),
    ]
    document = json.loads(figures.to_json(some))
    assert [one["name"] for one in document["figures"]] == ["a", "b"]
    assert document["figures"][0]["verdict"] == "reached"


@pytest.mark.long
def test_the_command_prints_the_table_and_writes_it(tmp_path):
    out = tmp_path / "speed.json"
    command = [sys.executable, "-m", "research.speed", "--quick", "--json", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "Million steps per CPU second" in done.stdout
    assert "8,192" in done.stdout
    groups = {one["group"] for one in json.loads(out.read_text())["figures"]}
    assert groups == {"core", "gymnasium", "threads", "memory", "start", "peers"}


def test_the_campaign_of_floods_prints_a_row_for_each_and_says_whether_one_is_too_much(tmp_path):
    store = Store(tmp_path / "playground.db")
    for seed in range(9):
        play(store, seed, explore=True)
    store.close()
    command = [
        sys.executable,
        "-m",
        "research.speed.floods",
        "--database",
        store.path,
        "--port",
        "bare",
        "--rounds",
        "1",
        "--seconds",
        "0.5",
        "--flood",
        "ghosts and costs",
        "--flood",
        "garbage",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    rows = re.findall(
        r"^\| ([a-z ]+) \| bare \| (\w+) \| [\d.]+ \| [\d.]+ \| ([\d.]+) \|", done.stdout, re.M
    )
    kinds = [
        ("ghosts and costs", "moves"),
        ("garbage", "moves"),
        ("ghosts and costs", "ghosts"),
    ]
    assert [row[:2] for row in rows] == kinds, done.stderr
    assert done.returncode == any(float(row[2]) > floods.MOST_RATIO for row in rows)
