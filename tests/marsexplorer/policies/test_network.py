"""Networks from files: what they decide, what they are shown, and what is refused."""

import os
import subprocess
import sys
from itertools import product

import numpy as np
import onnx
import pytest
import torch
from onnx import numpy_helper

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies.files.card import FORMAT
from marsexplorer.policies.network.features import PLANES, SCALES, FeatureExtractor
from marsexplorer.training.network import Net, load_net, save_network


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """An untrained network: it wanders, which is what the guard is for."""
    torch.manual_seed(5)
    path = tmp_path_factory.mktemp("policies") / "wanderer.onnx"
    save_network(Net(), path, {"summary": "Wanders."})
    return path


@pytest.mark.parametrize(("size", "radius"), [((5, 6), 6), ((9, 31), 3), ((12, 33), 6)])
def test_even_an_untrained_network_finishes_every_size_thanks_to_the_guard(file, size, radius):
    config = EnvConfig("random", *size, sensor_radius=radius, max_steps=100_000)
    policy = policies.load(file, radius)
    for seed in range(2):
        assert play_episode(policy, config, seed).outcome == "explored"


def test_thoughts_are_probabilities_that_leave_invalid_moves_out(file):
    policy = policies.load(file)
    policy.reset(0)
    policy.act(Episode.begin(EnvConfig("random", 9, 14), seed=1).codes)
    probabilities, value = policy.thought()
    assert probabilities.sum() == pytest.approx(1)
    assert probabilities[0] == probabilities[3] == 0  # north and west of the corner lies nothing
    assert np.isfinite(value)


def features(episode, place, visited=None):
    """The pictures of a board, [PLANES, side, side], and the numbers of its moves."""
    rows, cols = episode.codes.shape
    visited = np.zeros((1, rows * cols), np.uint8) if visited is None else visited
    board = episode.codes[None], np.array([place]), visited, np.array([1])
    planes, moves = FeatureExtractor(1, rows, cols, 6)(*board)
    sides = [side for side, _ in SCALES]
    parts = np.split(planes[0], np.cumsum(np.square(sides))[:-1], axis=1)
    pictures = zip(parts, sides, strict=True)
    return [part.reshape(PLANES, side, side) for part, side in pictures], moves[0]


def test_the_pictures_are_centred_on_the_rover_and_hold_the_shares_of_their_blocks():
    """By definition, cell by cell, on a board wider than the finest picture."""
    episode = Episode.begin(EnvConfig("random", 15, 34), seed=5)
    for action in (1, 1, 2, 2, 1):
        if not episode.ended:
            episode.step(action)
    row, col = episode.position
    pictures, moves = features(episode, row * 34 + col)
    for (side, size), picture in zip(SCALES, pictures, strict=True):
        share = 255 // (size * size)
        for i, j in np.ndindex(side, side):
            top, left = row - side * size // 2 + i * size, col - side * size // 2 + j * size
            block = product(range(top, top + size), range(left, left + size))
            on_grid = ((r, c) if 0 <= r < 15 and 0 <= c < 34 else None for r, c in block)
            cells = [3 if cell is None else episode.codes[cell] for cell in on_grid]
            assert picture[0, i, j] == share * cells.count(0), (side, i, j)
            assert picture[1, i, j] == share * cells.count(3), (side, i, j)
    near = pictures[0]
    assert near[3, 5, 5] == 255  # the rover's own cell is the nearest
    assert near[2].max() > 0
    assert moves[:, 10].tolist() == [0, 1, 0, 0]


def test_the_coarse_pictures_show_the_most_new_cells_and_the_nearness_of_their_blocks():
    config, empty = EnvConfig("random", 11, 11), np.zeros((11, 11), bool)
    (near, middle, _), _ = features(Episode.begin(config, terrain=empty, start=(5, 5)), 60)
    for plane in (2, 3):
        blocks = near[plane][1:10, 1:10].reshape(3, 3, 3, 3).max((1, 3))
        assert (middle[plane][4:7, 4:7] == blocks).all()


def test_a_stack_of_boards_has_the_features_of_each_alone():
    config = EnvConfig("random", 13, 22)
    episodes = [Episode.begin(config, seed=seed) for seed in range(3)]
    codes, visited = (
        np.stack([episode.codes for episode in episodes]),
        np.zeros((3, config.n), np.uint8),
    )
    visited[:, 0] = 1
    boards = (codes, np.zeros(3, np.int64), visited, np.array([1, 2, 1]))
    together = [part.copy() for part in FeatureExtractor(3, 13, 22, 6)(*boards)]
    alone = FeatureExtractor(1, 13, 22, 6)
    for i in range(3):
        planes, moves = alone(*(part[i : i + 1] for part in boards))
        assert np.array_equal(planes[0], together[0][i])
        assert np.array_equal(moves[0], together[1][i])


def test_what_is_kept_of_a_board_changes_no_feature():
    """An extractor for several episodes in turn gives the features of a fresh one."""
    config = EnvConfig("2-2-1", 17, 70)
    rng, extractor = np.random.default_rng(3), FeatureExtractor(1, 17, 70, 6)
    episodes = [Episode.begin(config, seed=seed) for seed in range(3)]
    visited = np.zeros((3, config.n), np.uint8)
    for step in range(240):
        which = step // 20 % 3
        episode = episodes[which]
        if episode.ended:
            continue
        place = np.array([episode.position[0] * 70 + episode.position[1]])
        visited[which, place] = 1
        board = episode.codes[None], place, visited[which : which + 1], np.array([step % 4])
        seen, fresh = extractor(*board), FeatureExtractor(1, 17, 70, 6)(*board)
        assert np.array_equal(seen[0], fresh[0])
        assert np.array_equal(seen[1], fresh[1])
        valid = np.flatnonzero(seen[1][0, :, 0])
        forward = valid[seen[1][0, valid, 7] > 0]
        episode.step(int(rng.choice(forward if len(forward) and rng.random() < 0.8 else valid)))
    assert all(episode.steps > 40 for episode in episodes)


def spoil(model, kind):
    """Change a model's first weight, or what weights there are."""
    weights = model.graph.initializer
    array = numpy_helper.to_array(weights[0])
    if kind == "one missing":
        del weights[0]
    elif kind == "one too many":
        weights.append(numpy_helper.from_array(np.zeros(1, np.float32), "more"))
    else:
        others = {
            "another shape": np.zeros((2, 2), np.float32),
            "another type": array.astype(np.float64),
            "not a number": array * np.nan,
        }
        weights[0].CopyFrom(numpy_helper.from_array(others[kind], weights[0].name))


@pytest.mark.parametrize(
    "kind", ["one missing", "one too many", "another shape", "another type", "not a number"]
)
def test_weights_that_are_not_the_networks_are_not_trained_on(kind, file, tmp_path):
    path, model = tmp_path / "bad.onnx", onnx.load(file)
    spoil(model, kind)
    onnx.save(model, path)
    with pytest.raises(policies.PolicyFileError, match=r"is no policy: expected .*, got .*; "):
        load_net(path)
    if kind != "one too many":  # a weight that nothing is multiplied with does not harm who plays
        with pytest.raises(policies.PolicyFileError, match=r"is no policy: expected .*, got .*; "):
            policies.load(path)


def test_a_network_of_another_format_is_refused_by_name(file, tmp_path):
    path, model = tmp_path / "old.onnx", onnx.load(file)
    card = model.metadata_props[0]
    card.value = card.value.replace(FORMAT, "marsexplorer-network-0")
    onnx.save(model, path)
    for load in (policies.load, load_net):
        sentence = rf"expected the format {FORMAT}, got 'marsexplorer-network-0'"
        with pytest.raises(policies.PolicyFileError, match=sentence):
            load(path)


def test_neither_the_server_nor_the_shipped_network_imports_torch_nor_a_rule_what_networks_need(
    tmp_path,
):
    """They are large packages, and extras bring them: torch is the largest by far."""
    code = """
import sys
from marsexplorer import policies
policies.load("frontier-priced")
assert not {"onnx", "onnxruntime"} & set(sys.modules)
import humanplay.web.server
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import evaluate
from marsexplorer.evaluation.cost import CostEstimator
from marsexplorer.episode import Episode
policy, episode = policies.load("ppo"), Episode.begin(EnvConfig("random", 9, 14), seed=1)
policy.reset(1)
while not episode.ended:
    episode.step(policy.act(episode.codes))
policy.thought()
CostEstimator("ppo").costs(episode.record())
evaluate(["ppo"], EnvConfig("random", 9, 14), 2, 10**9)
sys.exit("torch" in sys.modules)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "HOME": str(tmp_path)}, check=False
    )
    assert done.returncode == 0
    assert list(tmp_path.rglob("*onnxruntime*")) == [], "no report of use, and no id for one"
