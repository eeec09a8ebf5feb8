"""An exported network makes the moves of the network and acts as its card says."""

import numpy as np
import pytest
import torch

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies.base import INVALID_LOGIT
from marsexplorer.policies.files.onnx import OnnxModel
from research.paper.networks import NetworkShape, NoisyLinear, make_network
from research.paper.onnx_agents import save_agent
from research.paper.tests.test_networks import observation_of

CONFIG = EnvConfig.of("random", (9, 14), max_steps=40)
HEADS = {
    "policy": {"head": "policy", "critic": "separate"},
    "actor": {"head": "policy"},
    "q": {"head": "q"},
    "categorical": {"head": "categorical", "atoms": 11, "support": (-100.0, 100.0)},
}


def written(folder, head, trunk="authors", **card):
    """Save an untrained network; return it and its file."""
    torch.manual_seed(8)
    rows, cols = (None, None) if trunk == "features" else (CONFIG.rows, CONFIG.cols)
    net = make_network(
        NetworkShape(trunk=trunk, rows=rows, cols=cols, mask=True, **HEADS[head]), 0.5
    )
    for module in net.modules():  # fresh heads are near 0: any move would be as good as another
        if isinstance(module, torch.nn.Linear) and not isinstance(module, NoisyLinear):
            torch.nn.init.xavier_normal_(module.weight, 2.0)
    before = torch.get_rng_state()
    path = folder / f"{head}-{trunk}.onnx"
    save_agent(net, path, {"summary": f"Untrained {head}.", **card})
    assert torch.equal(torch.get_rng_state(), before)  # a training may be under way
    return net.eval(), path


@pytest.mark.parametrize("trunk", ["authors", "rllib", "features"])
@pytest.mark.parametrize("head", HEADS)
def test_its_thoughts_are_those_of_the_network(head, trunk, tmp_path):
    net, path = written(tmp_path, head, trunk)
    policy, episode = policies.load(path), Episode.begin(CONFIG, seed=2)
    assert policies.describe(str(path)) == f"Untrained {head}."
    policy.reset(2)
    while not episode.ended:
        codes, cell = episode.codes.copy(), np.array([episode.position])
        action = policy.act(codes)
        if episode.steps == 0:  # before anything is remembered
            with torch.inference_mode():
                scores, value = net.evaluate(*observation_of(trunk, codes[None], cell))
            shares, thought_value = policy.thought()
            expected = scores[0].softmax(0).numpy()
            if head in ("q", "categorical"):
                expected = 1.0 * (np.arange(4) == int(scores[0].argmax()))
                assert action == int(scores[0].argmax())
            assert shares == pytest.approx(expected, abs=1e-5)
            assert thought_value == pytest.approx(float(value[0]), rel=1e-4, nan_ok=True)
            assert all(shares[(scores[0] == INVALID_LOGIT).numpy()] == 0)
        episode.step(action)
    assert episode.outcome in ("explored", "timed_out")


def test_noisy_layers_have_their_mean_weights_and_cards_say_how_a_policy_acts(tmp_path):
    for head, acts in (("categorical", "greedy"), ("actor", "samples")):
        _, path = written(tmp_path, head)
        model = OnnxModel(path)
        assert model.card["acts"] == acts
        assert "value" in model.outputs or head == "actor"
    _, path = written(tmp_path, "policy", "features", acts="greedy with guard")
    config = EnvConfig.of("random", (9, 14), max_steps=100_000)
    policy, episode = policies.load(path), Episode.begin(config, seed=3)
    policy.reset(3)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    assert episode.outcome == "explored"  # with the guard even an untrained network finishes
