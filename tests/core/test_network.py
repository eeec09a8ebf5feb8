"""Networks from files: what they decide, what they are shown, and what is refused."""

import json
import subprocess
import sys

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies.network import FORMAT, Net, save_network
from marsexplorer.policies.perception import REACH, Perception


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """An untrained network: it wanders, which is what the guard is for."""
    torch.manual_seed(5)
    path = tmp_path_factory.mktemp("policies") / "wanderer.safetensors"
    save_network(Net(), path, {"summary": "Wanders."})
    return path


def play(policy, config, seed, floats=False):
    episode = Episode.begin(config, seed=seed)
    policy.reset(seed)
    while not episode.ended:
        episode.step(policy.act(episode.observation() if floats else episode.codes))
    return episode


def test_a_network_is_named_after_its_file_and_is_a_policy(file):
    policy = policies.load(file)
    assert policy.name == "wanderer"
    assert isinstance(policy, policies.Policy)
    assert policies.describe(str(file)) == "Wanders."


@pytest.mark.parametrize(("size", "radius"), [((5, 6), 6), ((9, 31), 3), ((12, 33), 6)])
def test_even_an_untrained_network_finishes_every_size_thanks_to_the_guard(file, size, radius):
    config = EnvConfig("random", *size, sensor_radius=radius, max_steps=100_000)
    policy = policies.load(file, radius)
    for seed in range(2):
        assert play(policy, config, seed).outcome == "explored"


def test_floats_and_codes_give_the_same_moves_whatever_the_seed(file):
    policy, config = policies.load(file), EnvConfig("random", 11, 16)
    first = bytes(play(policy, config, 4).actions)
    assert bytes(play(policy, config, 4, floats=True).actions) == first
    assert bytes(play(policies.load(file), config, 4).actions) == first


def test_thoughts_are_probabilities_that_leave_invalid_moves_out(file):
    policy = policies.load(file)
    policy.reset(0)
    policy.act(Episode.begin(EnvConfig("random", 9, 14), seed=1).codes)
    probabilities, value = policy.thought()
    assert probabilities.sum() == pytest.approx(1)
    assert probabilities[0] == probabilities[3] == 0  # north and west of the corner lies nothing
    assert np.isfinite(value)


def test_perception_is_centred_on_the_rover():
    episode = Episode.begin(EnvConfig("random", 9, 14), terrain=np.zeros((9, 14), bool), start=(4, 6))
    visited = np.zeros((1, 9 * 14), np.uint8)
    planes, moves = Perception(1, 9, 14, 6)(episode.codes[None], np.array([4 * 14 + 6]), visited, np.array([1]))
    unknown, blocked = planes[0, 0] == 255, planes[0, 1] == 255
    top, left = REACH - 4, REACH - 6
    assert np.array_equal(unknown[top : top + 9, left : left + 14], episode.codes == 0)
    assert not blocked[top : top + 9, left : left + 14].any()
    assert blocked.sum() == blocked.size - 9 * 14
    assert moves[0, :, 0].tolist() == [1, 1, 1, 1]
    assert moves[0, :, 10].tolist() == [0, 1, 0, 0]


def test_a_stack_of_boards_is_perceived_as_each_alone():
    config = EnvConfig("random", 13, 22)
    episodes = [Episode.begin(config, seed=seed) for seed in range(3)]
    codes = np.stack([episode.codes for episode in episodes])
    visited, places, headings = np.zeros((3, config.n), np.uint8), np.zeros(3, np.int64), np.array([1, 2, 1])
    visited[:, 0] = 1
    together = [part.copy() for part in Perception(3, 13, 22, 6)(codes, places, visited, headings)]
    alone = Perception(1, 13, 22, 6)
    for i in range(3):
        planes, moves = alone(codes[i : i + 1], places[:1], visited[i : i + 1], headings[i : i + 1])
        assert np.array_equal(planes[0], together[0][i])
        assert np.array_equal(moves[0], together[1][i])


def written(path, tensors, card=None):
    save_file(tensors, path, metadata={"card": json.dumps({"format": FORMAT} if card is None else card)})
    return path


def spoilt(kind):
    tensors = dict(Net().state_dict())
    name = next(iter(tensors))
    if kind == "one missing":
        del tensors[name]
    elif kind == "one too many":
        tensors["more"] = torch.zeros(1)
    elif kind == "another shape":
        tensors[name] = torch.zeros(2, 2)
    elif kind == "another type":
        tensors[name] = tensors[name].double()
    elif kind == "not a number":
        tensors[name] = torch.full_like(tensors[name], float("nan"))
    return {name: tensor.contiguous() for name, tensor in tensors.items()}


@pytest.mark.parametrize("kind", ["one missing", "one too many", "another shape", "another type", "not a number"])
def test_weights_that_are_not_the_networks_are_refused(kind, tmp_path):
    path = written(tmp_path / "bad.safetensors", spoilt(kind))
    with pytest.raises(policies.PolicyFileError, match=r"is no policy: expected .*, got .*; "):
        policies.load(path)


def test_a_network_of_another_format_is_refused_by_name(tmp_path):
    path = written(tmp_path / "old.safetensors", spoilt("nothing"), {"format": "marsexplorer-network-0"})
    with pytest.raises(
        policies.PolicyFileError, match=r"expected the format marsexplorer-network-1, got 'marsexplorer-network-0'"
    ):
        policies.load(path)


def test_a_file_cut_short_is_refused(file, tmp_path):
    path = tmp_path / "cut.safetensors"
    path.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(policies.PolicyFileError, match="is no policy"):
        policies.load(path)


def test_torch_is_imported_only_when_a_network_is_loaded():
    code = "import sys; from marsexplorer import policies; policies.load('planner'); sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
