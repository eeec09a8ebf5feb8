"""PPO's variants, and its state: with the whole of it a training goes on to the same weights, without any part it does not."""

from copy import deepcopy
from dataclasses import asdict, replace

import pytest
import torch

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.paper.algorithms import begin
from marsexplorer.paper.trainers.ppo_trainer import CHANGES, TUNED, VARIANTS, PPOTrainer, config_of
from marsexplorer.policies import load
from marsexplorer.policies.files.card import read_card
from marsexplorer.training.config import RECIPES

ENV_CONFIG = EnvConfig(rows=9, cols=12, max_steps=20)
SMALL = {
    "num_envs": 8,
    "num_steps": 16,
    "minibatch_size": 64,
    "update_epochs": 2,
    "value_warmup_updates": 0,
}


def trainer(config):
    return PPOTrainer(replace(config, **SMALL), ENV_CONFIG, 5, 4 * 128)


def weights(one):
    return [weight.clone() for weight in one.state_dict()["net"].values()]


def same(some, others):
    return all(torch.equal(*both) for both in zip(some, others, strict=True))


def changed(variant):
    paper, other = asdict(RECIPES["paper"]), asdict(config_of(variant))
    return {name for name in paper if paper[name] != other[name]}


def test_a_variant_differs_from_the_paper_in_the_settings_of_its_changes_alone():
    assert changed("paper") == set()
    assert changed("appendix") == {"update_epochs", "minibatch_size"}
    assert changed("paper-no-bonus") == {"has_bonus"}
    assert changed("paper-no-value-clip") == {"vf_change_clip"}
    assert changed("paper+discount") == {"gamma"}
    assert changed("paper+reward+discount") == {"reward_per_cell", "has_bonus", "gamma"}
    assert changed("works") == changed("paper+mask+features")
    for left_out in TUNED:
        assert changed("tuned") - changed(f"tuned-no-{left_out}") == set(
            CHANGES[left_out]
        ) & changed("tuned")
    assert len({config_of(variant) for variant in VARIANTS}) == len(VARIANTS)
    assert replace(config_of("tuned"), name="best", has_bonus=True) == RECIPES["best"]


@pytest.mark.parametrize("variant", ["paper+", "paper+moss", "works-no-moss", "works-no-", "moss"])
def test_an_unknown_variant_is_refused_with_those_that_there_are(variant):
    with pytest.raises(ValueError, match=r"no variant .*works-no-.*tuned-no-.*paper\+reward"):
        begin("ppo", variant, ENV_CONFIG, 0, 100)


@pytest.mark.parametrize("variant", ["paper", "works", "works-no-mask", "works-no-features"])
def test_a_policy_of_any_network_is_loaded_and_plays(tmp_path, variant):
    some = trainer(config_of(variant))
    some.advance()
    some.save_policy(tmp_path / "some.safetensors", {"summary": "one", "size": [9, 12]})
    policy, episode, is_masked = (
        load(tmp_path / "some.safetensors"),
        Episode.begin(ENV_CONFIG, seed=3),
        some.settings["mask"],
    )
    policy.reset(3)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    assert episode.outcome in (
        ("explored", "timed_out") if is_masked else ("collided", "out_of_bounds")
    )
    assert ("may drive into" in read_card(tmp_path / "some.safetensors")["limits"]) != is_masked


@pytest.mark.parametrize("variant", ["paper", "works"])
def test_a_training_goes_on_to_the_same_weights_from_its_whole_state_alone(variant):
    config = replace(config_of(variant), target_entropy=(1.0, 0.5), kl_coef=0.2)
    whole = trainer(config)
    for _ in range(2):
        whole.advance()
    state = deepcopy(whole.state_dict())
    for _ in range(2):
        whole.advance()
    for left_out in (None, *state):
        other = trainer(config)
        torch.rand(7)
        other.load_state_dict(
            {**state, **({left_out: trainer(config).state_dict()[left_out]} if left_out else {})}
        )
        assert other.moves == (0 if left_out == "updates_done" else 256)
        for _ in range(2):
            other.advance()
        assert same(weights(other), weights(whole)) == (left_out is None), left_out
