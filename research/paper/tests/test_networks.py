"""The networks of the paper's four algorithms: outputs, masks, and noise left out."""

import numpy as np
import pytest
import torch

from marsexplorer.config import EnvConfig
from marsexplorer.observation import DISPLACEMENTS
from marsexplorer.policies.base import INVALID_LOGIT
from marsexplorer.policies.network.features import ACTION_FEATURES, FeatureExtractor
from marsexplorer.training.envs import make_vector_env
from research.paper.networks import (
    NetworkShape,
    NoisyLinear,
    centred,
    make_network,
    sample_noise,
)

SIZE = (9, 14)
CATEGORICAL = {"head": "categorical", "atoms": 7, "support": (-40.0, 25.0)}
KINDS = {
    "policy": {"head": "policy", "critic": "shared"},
    "policy and critic": {"head": "policy", "critic": "separate"},
    "actor": {"head": "policy"},
    "q": {"head": "q"},
    "hidden layers": {"head": "q", "hidden": (9, 7)},
    "categorical": CATEGORICAL,
}


@pytest.fixture(autouse=True)
def one_thread():
    """Keep torch's threads from waiting for one another on a busy machine."""
    torch.set_num_threads(1)


def shape_of(trunk, size=SIZE, **more):
    if trunk == "features":
        return NetworkShape(trunk=trunk, **{**more, "hidden": ()})
    return NetworkShape(trunk=trunk, rows=size[0], cols=size[1], **more)


def walk(config, steps, num=32, seed=0):
    """Yield (codes, rovers' cells) along random walks, invalid moves included."""
    env, rng = make_vector_env(config, num), np.random.default_rng(seed)
    codes, info = env.reset(seed=seed)
    for _ in range(steps):
        yield codes, info["position"]
        codes, _, _, _, info = env.step(rng.integers(0, 4, num))


def invalid_by_definition(codes, position):
    """Written out: an invalid move leaves the grid or enters a known obstacle."""
    is_invalid = []
    for row, col in DISPLACEMENTS:
        r, c = position[0] + row, position[1] + col
        on_grid = 0 <= r < codes.shape[0] and 0 <= c < codes.shape[1]
        is_invalid.append(not on_grid or codes[r, c] == 3)
    return is_invalid


def observation_of(trunk, codes, positions, radius=6):
    if trunk != "features":
        return (torch.from_numpy(codes.copy()),)
    num, rows, cols = codes.shape
    cells, headings = positions[:, 0] * cols + positions[:, 1], np.ones(num, np.int64)
    planes, moves = FeatureExtractor(num, rows, cols, radius, rules=())(
        codes, cells, np.zeros((num, rows * cols), np.uint8), headings
    )
    action_features = moves[:, :, :ACTION_FEATURES].copy()
    return torch.from_numpy(planes), torch.from_numpy(action_features)


def masked_means(scores, invalid):
    """The mean of each row's valid moves."""
    return np.where(invalid, 0, scores).sum(1, keepdims=True) / (~invalid).sum(1, keepdims=True)


def test_the_gradients_of_centred_logits_sum_to_nothing_however_large_the_logits_are():
    torch.manual_seed(0)
    invalid = torch.rand(512, 4) < 0.2
    invalid[:, 0] = False

    def sums(logits, seen):
        masked = seen.masked_fill(invalid, INVALID_LOGIT)
        chances = torch.distributions.Categorical(logits=masked, validate_args=False)
        values = chances.probs @ torch.tensor([1.0, 2.0, 3.0, 4.0])
        (-chances.entropy() - values).sum().backward()
        return logits.grad.sum(1)

    logits = (torch.randn(512, 4) + 2e10).requires_grad_()
    assert sums(logits, centred(logits, invalid)).abs().max() < 1e-2
    raw = logits.detach().clone().requires_grad_()
    assert sums(raw, raw).mean() < -0.5  # every step raised all logits: so those of SAC grew


@pytest.mark.parametrize("trunk", ["authors", "features"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_mask_hits_exactly_the_invalid_moves(trunk, kind):
    torch.manual_seed(1)
    plain = make_network(shape_of(trunk, **KINDS[kind])).eval()
    masked = make_network(shape_of(trunk, **KINDS[kind], mask=True)).eval()
    masked.load_state_dict(plain.state_dict())
    seen = set()
    for codes, positions in walk(EnvConfig.of("random", SIZE), 12):
        observation = observation_of(trunk, codes, positions)
        boards = zip(codes, positions, strict=True)
        invalid = np.array([invalid_by_definition(*board) for board in boards])
        seen |= {tuple(mask) for mask in invalid}
        with torch.inference_mode():
            scores, before = (net.evaluate(*observation)[0].numpy() for net in (masked, plain))
        assert np.all(scores[invalid] == INVALID_LOGIT)
        assert np.all(before > -100)
        if masked.shape.head == "policy":  # what the logits of a board have in common means nothing
            scores, before = (logits - masked_means(logits, invalid) for logits in (scores, before))
        assert scores[~invalid] == pytest.approx(before[~invalid], abs=1e-6)
    assert len(seen) > 8


def test_the_trunk_of_the_authors_is_that_of_their_repository_on_21x21():
    """21 cells become 11, then 6, which the third filter covers.

    `[[8, [3, 3], 2], [16, [2, 2], 2], [512, [6, 6], 1]]`
    """
    net = make_network(shape_of("authors", (21, 21), head="q"))
    state, rng = net.state_dict(), np.random.default_rng(3)
    codes = torch.from_numpy(rng.integers(0, 4, (6, 21, 21), np.uint8))
    assert [tuple(tensor.shape) for name, tensor in state.items() if name.endswith("weight")] == [
        (8, 1, 3, 3),
        (16, 8, 2, 2),
        (512, 576),
        (4, 512),
    ]
    picture = torch.tensor([0, 0.3, 0.6, 1])[codes.long()][:, None]
    framed = torch.nn.functional.pad(picture, (1, 1, 1, 1))
    first = torch.conv2d(framed, state["trunk.layers.1.weight"], None, 2).relu()
    framed = torch.nn.functional.pad(first, (0, 1, 0, 1))
    second = torch.conv2d(framed, state["trunk.layers.4.weight"], None, 2).relu()
    third = torch.conv2d(second, state["trunk.layers.7.weight"].view(512, 16, 6, 6), None, 1).relu()
    assert third.shape == (6, 512, 1, 1)
    q = third[:, :, 0, 0] @ state["q_head.weight"].T
    assert torch.allclose(net(codes), q, atol=1e-5)


def test_noise_has_no_mean_and_the_spread_that_its_sigma_says():
    torch.manual_seed(5)
    layer, inputs = NoisyLinear(40, 200, sigma=0.5), torch.rand(40)
    mean, drawn = layer.eval()(inputs), []
    layer.train()
    for _ in range(300):
        layer.sample()
        drawn.append((layer(inputs) - mean).detach())
    spread = torch.stack(drawn)
    # The weights' noise f(e_in) f(e_out) has variance E|e| E|e| = 2 / pi; the bias has f(e_out), of
    # variance sqrt(2 / pi).
    share = (2 / np.pi) ** 0.5
    expected = 0.5 / 40**0.5 * (share**2 * float((inputs**2).sum()) + share) ** 0.5
    assert abs(float(spread.mean())) < 0.05 * expected
    assert float(spread.pow(2).mean().sqrt()) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("trunk", ["rllib", "authors", "features"])
def test_distributions_sum_to_one_and_their_means_stay_within_the_support(trunk):
    torch.manual_seed(6)
    net = make_network(shape_of(trunk, **CATEGORICAL, mask=True), sigma=3.0).train()
    for codes, positions in walk(EnvConfig.of("random", SIZE), 5):
        observation = observation_of(trunk, codes, positions)
        sample_noise(net)
        with torch.inference_mode():
            shares, expected = net(*observation), net.expected(*observation)
        assert shares.shape == (32, 4, 7)
        assert torch.allclose(shares.sum(2), torch.ones(32, 4), atol=1e-5)
        valid = expected > INVALID_LOGIT
        assert bool(((expected >= -40.001) & (expected <= 25.001))[valid].all())
        assert bool((shares[~valid][:, 0] == 1).all())
        assert bool((shares[~valid][:, 1:] == 0).all())
