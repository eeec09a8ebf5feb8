"""Files of the paper's four algorithms: they play as their cards say wherever policies play, and damaged ones are refused."""

import json

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from safetensors import safe_open
from safetensors.torch import save_file

from app.cli.training.policies import policies as policies_command
from app.leaderboard.evaluations import Evaluation
from app.play.policy_catalogue import PolicyCatalogue
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation import evaluate
from marsexplorer.policies.files.card import read_card
from marsexplorer.policies.files.formats import PAPER_FORMAT, PAPER_NETWORK_FORMAT
from marsexplorer.policies.files.weights import save_network
from marsexplorer.policies.network.batch import act_many, shared_net
from marsexplorer.policies.network.paper_model import PaperNet
from marsexplorer.policies.network.paper_network import make_network
from marsexplorer.policies.network.paper_policy import (
    GreedyPolicy,
    SampledPolicy,
    save_paper_network,
)
from marsexplorer.policies.network.shape import NetworkShape, ShapeError

CONFIG = EnvConfig.of("random", (9, 14), max_steps=60)
HEADS = {
    "policy": {"head": "policy", "critic": "separate"},
    "actor": {"head": "policy"},
    "q": {"head": "q"},
    "categorical": {"head": "categorical", "atoms": 11, "support": (-100.0, 100.0)},
}


@pytest.fixture(autouse=True)
def one_thread():
    """Keep torch's threads from waiting for one another on a busy machine."""
    torch.set_num_threads(1)


def shape_of(head, trunk="authors", **more):
    rows, cols = (None, None) if trunk == "features" else (CONFIG.rows, CONFIG.cols)
    return NetworkShape(trunk=trunk, rows=rows, cols=cols, **HEADS[head], **more)


def written(folder, head, trunk="authors", mask=True, **card):
    """Save an untrained network and return its file."""
    torch.manual_seed(8)
    shape, path = shape_of(head, trunk, mask=mask), folder / f"{head}-{trunk}.safetensors"
    net = make_network(shape, sigma=0.5)
    for (
        module
    ) in net.modules():  # fresh policy heads are near 0: every move would be as good as any other
        if isinstance(module, torch.nn.Linear) and head in ("policy", "actor"):
            torch.nn.init.xavier_normal_(module.weight, 2.0)
    save_paper_network(net, shape, path, {"summary": f"Untrained {head}.", **card})
    return path


def play(policy, seed, config=CONFIG, floats=False):
    episode = Episode.begin(config, seed=seed)
    policy.reset(seed)
    while not episode.ended:
        episode.step(policy.act(episode.observation() if floats else episode.codes))
    return bytes(episode.actions)


@pytest.mark.parametrize(
    ("head", "trunk"),
    [*((head, "authors") for head in HEADS), ("policy", "rllib"), ("q", "features")],
)
def test_a_file_of_every_head_plays_wherever_policies_play(head, trunk, tmp_path):
    path = written(tmp_path, head, trunk)
    policy = policies.load(path)
    assert isinstance(policy, policies.Policy)
    assert policy.name == path.stem
    assert policy.size == (None if trunk == "features" else (9, 14))
    assert policies.describe(str(path)) == f"Untrained {head}."
    row = evaluate([str(path)], CONFIG, 4).rows[0]
    assert row.collisions == 0
    offer = PolicyCatalogue([path]).offers()[-1]
    assert (offer.name, offer.size) == (path.stem, policy.size)
    figure, steps = Evaluation(str(path), CONFIG, (0, 1, 2, 3)).play()
    assert np.mean(steps) == row.steps_mean
    assert figure["curve"]
    shown = CliRunner().invoke(policies_command, ["card", str(path)])
    assert json.loads(shown.output)["network"] == policy_shape(path)


def policy_shape(path):
    card = read_card(path)
    assert card["format"] == PAPER_NETWORK_FORMAT
    return card["network"]


def test_how_a_policy_acts_is_by_default_that_of_its_head(tmp_path):
    for head, kind in (
        ("policy", SampledPolicy),
        ("actor", SampledPolicy),
        ("q", GreedyPolicy),
        ("categorical", GreedyPolicy),
    ):
        path = written(tmp_path, head)
        assert type(policies.load(path)) is kind
        assert read_card(path)["acts"] == ("samples" if kind is SampledPolicy else "greedy")
    assert type(policies.load(written(tmp_path, "policy", acts="greedy"))) is GreedyPolicy


def test_draws_are_fixed_by_the_seed_and_greedy_moves_by_nothing(tmp_path):
    drawing, greedy = (
        policies.load(written(tmp_path, "policy")),
        policies.load(written(tmp_path, "q")),
    )
    codes = Episode.begin(CONFIG, seed=0).codes

    def first_moves(policy, seed):
        policy.reset(seed)
        return [policy.act(codes) for _ in range(40)]

    assert first_moves(drawing, 1) == first_moves(drawing, 1) != first_moves(drawing, 2)
    assert len(set(first_moves(greedy, 1) + first_moves(greedy, 2))) == 1
    for policy in (drawing, greedy):
        assert play(policy, 4) == play(policy, 4, floats=True)


def test_draws_come_as_often_as_their_probabilities_and_never_invalid(tmp_path):
    policy = policies.load(written(tmp_path, "policy"))
    codes = Episode.begin(CONFIG, seed=0).codes
    policy.reset(3)
    counts = np.bincount([policy.act(codes) for _ in range(800)], minlength=4) / 800
    shares, value = policy.thought()
    assert shares[0] == shares[3] == counts[0] == counts[3] == 0  # the rover stands in the corner
    assert counts == pytest.approx(shares, abs=0.07)
    assert np.isfinite(value)


def test_the_same_weights_draw_the_same_moves_as_in_the_older_format(tmp_path):
    torch.manual_seed(6)
    older = PaperNet(9, 14)
    save_network(
        older, tmp_path / "older.safetensors", {"summary": "Older.", "size": [9, 14]}, PAPER_FORMAT
    )
    shape = NetworkShape("rllib", "policy", 9, 14, critic="separate")
    net = make_network(shape)
    net.load_state_dict(dict(zip(sorted_by_tower(net), older.state_dict().values(), strict=True)))
    save_paper_network(net, shape, tmp_path / "newer.safetensors", {})
    both = [policies.load(tmp_path / f"{name}.safetensors") for name in ("older", "newer")]
    for seed in range(6):
        assert play(both[0], seed) == play(both[1], seed)
        assert both[0].thought()[0] == pytest.approx(both[1].thought()[0], abs=1e-6)
        assert both[0].thought()[1] == both[1].thought()[1]


def sorted_by_tower(net):
    """The names of the tensors, those of the policy before those of the value, as the older network has them."""
    return sorted(net.state_dict(), key=lambda name: (name.startswith("value"), "head" in name))


def test_what_values_say_is_the_best_move_for_certain_and_its_value(tmp_path):
    for head in ("q", "categorical"):
        path = written(tmp_path, head)
        policy, codes = policies.load(path), Episode.begin(CONFIG, seed=2).codes
        policy.reset(0)
        action = policy.act(codes)
        shares, value = policy.thought()
        assert shares.tolist() == [float(move == action) for move in range(4)]
        scores, _ = policy.net.infer(codes[None].copy())
        assert value == scores[0].max() == scores[0, action]
    actor = policies.load(written(tmp_path, "actor"))
    actor.act(codes)
    assert np.isnan(actor.thought()[1])


@pytest.mark.parametrize("trunk", ["authors", "features"])
def test_with_the_guard_even_an_untrained_network_finishes(trunk, tmp_path):
    config = EnvConfig.of("random", (9, 14), max_steps=100_000)
    for head in ("policy", "categorical"):
        path = written(tmp_path, head, trunk, acts="greedy with guard")
        assert evaluate([str(path)], config, 2).rows[0].completion == 1


def test_without_a_mask_it_drives_where_it_likes(tmp_path):
    path = written(tmp_path, "policy", mask=False)
    assert evaluate([str(path)], CONFIG, 4).rows[0].completion == 0
    policy = policies.load(path)
    policy.act(Episode.begin(CONFIG, seed=0).codes)
    assert np.all(policy.thought()[0] > 0)


@pytest.mark.parametrize("trunk", ["authors", "features"])
def test_boards_decided_together_make_the_moves_of_single_decisions(trunk, tmp_path):
    path = written(tmp_path, "categorical", trunk, acts="greedy with guard")
    episodes, drivers = (
        [Episode.begin(CONFIG, seed=seed) for seed in range(6)],
        [policies.load(path) for _ in range(6)],
    )
    assert len({id(shared_net(driver)) for driver in drivers}) == 1
    while running := [at for at, one in enumerate(episodes) if not one.ended]:
        actions = act_many([drivers[at] for at in running], [episodes[at].codes for at in running])
        for at, action in zip(running, actions, strict=True):
            episodes[at].step(action)
    assert [bytes(one.actions) for one in episodes] == [
        play(policies.load(path), seed) for seed in range(6)
    ]
    assert shared_net(policies.load(written(tmp_path, "policy", trunk))) is None


def test_a_board_of_another_size_is_refused_with_the_size_it_was_made_for(tmp_path):
    for head in HEADS:
        policy = policies.load(written(tmp_path, head))
        with pytest.raises(
            ValueError,
            match=r"was made for 9x14 and cannot play 14x9; choose that size, or another policy",
        ):
            policy.act(Episode.begin(EnvConfig.of("random", (14, 9)), seed=0).codes)


def test_a_noisy_network_is_saved_with_its_mean_weights(tmp_path):
    torch.manual_seed(9)
    shape, path = shape_of("categorical"), tmp_path / "noisy.safetensors"
    net = make_network(shape, sigma=0.5)
    save_paper_network(net, shape, path, {"format": "another", "acts": "greedy"})
    assert read_card(path)["format"] == PAPER_NETWORK_FORMAT
    with safe_open(path, "pt") as file:
        assert not [name for name in file.keys() if "sigma" in name or "noise" in name]  # noqa: SIM118
    codes = torch.from_numpy(Episode.begin(CONFIG, seed=2).codes.copy())[None]
    with torch.inference_mode():
        assert torch.equal(policies.load(path).net(codes), net.eval()(codes))


def test_saving_and_loading_draw_nothing_from_the_generator_of_a_training_under_way(tmp_path):
    shape = shape_of("categorical")
    net, before = make_network(shape, sigma=0.5), torch.get_rng_state()
    save_paper_network(net, shape, tmp_path / "a.safetensors", {})
    policies.load(tmp_path / "a.safetensors")
    assert torch.equal(torch.get_rng_state(), before)


def test_what_does_not_fit_is_not_saved(tmp_path):
    net = make_network(shape_of("q"))
    with pytest.raises(ValueError, match="expected a network of the shape"):
        save_paper_network(net, shape_of("policy"), tmp_path / "a.safetensors", {})
    with pytest.raises(
        ShapeError, match=r'one of greedy, greedy with guard as "acts" of the head q, got .samples'
    ):
        save_paper_network(net, shape_of("q"), tmp_path / "a.safetensors", {"acts": "samples"})
    assert not list(tmp_path.iterdir())


HOSTILE = {
    "no network": {"network": None},
    "a list": {"network": [1]},
    "another field": {"network": {"units": 512}},
    "no trunk": {"network": {"head": "q"}},
    "unknown head": {"head": "quantile"},
    "head of another type": {"head": {"policy": 1}},
    "unknown trunk": {"trunk": "resnet"},
    "huge grid": {"rows": 10**9},
    "grid of numbers beyond machines": {"rows": 10**400},
    "negative grid": {"rows": -9},
    "grid of fractions": {"rows": 9.0},
    "grid of booleans": {"rows": True},
    "text for a grid": {"rows": "9"},
    "no grid": {"rows": None, "cols": None},
    "huge number of atoms": {"atoms": 10**9},
    "one atom": {"atoms": 1},
    "support of no number": {"support": [float("nan"), 1.0]},
    "support without end": {"support": [0.0, float("inf")]},
    "support that falls": {"support": [1.0, -1.0]},
    "support of text": {"support": "01"},
    "support of three": {"support": [0.0, 1.0, 2.0]},
    "mask of text": {"mask": "yes"},
    "critic of another head": {"critic": "shared"},
    "another size than the weights": {"rows": 13},
    "other atoms than the weights": {"atoms": 12},
    "another trunk than the weights": {"trunk": "rllib"},
    "deep": {"network": json.loads("[" * 200 + "]" * 200)},
    "acts in an unknown way": {"acts": "dreams"},
    "values that are drawn from": {"acts": "samples"},
    "acts of another type": {"acts": ["greedy"]},
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_card_that_says_something_else_is_refused_in_a_sentence(kind, tmp_path):
    path, changed = written(tmp_path, "categorical"), dict(HOSTILE[kind])
    card = read_card(path)
    for name in ("acts", "network"):
        if name in changed:
            card[name] = changed.pop(name)
    if changed:
        card["network"] |= changed
    with safe_open(path, "pt") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    save_file(tensors, path, metadata={"card": json.dumps(card)})
    with pytest.raises(
        policies.PolicyFileError, match=r"(?s)is no policy: expected .*, got .*; give the path"
    ) as refusal:
        policies.load(path)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 500


@pytest.mark.parametrize("kind", ["not a number", "another type", "cut short"])
def test_damaged_weights_are_refused(kind, tmp_path):
    path = written(tmp_path, "q")
    card = read_card(path)
    with safe_open(path, "pt") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    if kind == "cut short":
        path.write_bytes(path.read_bytes()[:-100])
    else:
        weight = tensors["q_head.weight"]
        tensors["q_head.weight"] = (
            weight * float("nan") if kind == "not a number" else weight.double()
        )
        save_file(tensors, path, metadata={"card": json.dumps(card)})
    with pytest.raises(policies.PolicyFileError, match=r"is no policy: expected .*, got .*; "):
        policies.load(path)
