"""The shipped network decides as tests/fixtures/policies has recorded it."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from marsexplorer import policies
from marsexplorer.policies.files.card import read_card, shipped
from marsexplorer.training.network import load_net

RECORDED = Path(__file__).parents[2] / "fixtures" / "policies" / "ppo-decisions.npz"


@pytest.fixture(scope="module")
def recorded():
    """(head, observations) of each recorded episode, and the arrays of all steps.

    Observations are uint8[steps, rows, cols].
    """
    arrays = np.load(RECORDED)
    episodes, byte = [], 0
    for head in json.loads(str(arrays["episodes"])):
        cells, steps = head["rows"] * head["cols"], head["moves"]
        length = -(-cells // 4)
        packed = arrays["codes"][byte : byte + steps * length].reshape(steps, length)
        codes = np.stack([packed >> shift & 3 for shift in (0, 2, 4, 6)], axis=2)
        observations = codes.reshape(steps, -1)[:, :cells].astype(np.uint8)
        episodes.append((head, observations.reshape(steps, head["rows"], head["cols"])))
        byte += steps * length
    return episodes, arrays


def test_every_recorded_decision_is_made_again(recorded):
    episodes, arrays = recorded
    policy, actions, thoughts = policies.load("ppo"), [], []
    for head, observations in episodes:
        policy.reset(head["seed"])
        for observation in observations:
            actions.append(policy.act(observation))
            probabilities, value = policy.thought()
            thoughts.append((*probabilities, value))
    assert actions == arrays["action"].tolist()
    assert np.allclose(np.array(thoughts)[:, :4], arrays["probabilities"], atol=1e-5)
    assert np.allclose(np.array(thoughts)[:, 4], arrays["value"], atol=1e-4)


def test_every_recorded_logit_is_computed_again_by_the_file_that_plays_and_the_network_that_trains(
    recorded,
):
    """To some millionths, as other processors round otherwise; the same best move."""
    episodes, arrays = recorded
    policy, computed, shown = policies.load("ppo"), [], []
    for head, observations in episodes:
        policy.reset(head["seed"])
        for observation in observations:
            planes, moves = policy.extract_features(observation)
            logits, values = policy.net.infer(planes, moves)
            policy.choose(logits[0], float(values[0]))
            computed.append(logits[0])
            shown.append((torch.from_numpy(planes.copy()), torch.from_numpy(moves.copy())))
    with torch.no_grad():
        trained = load_net(shipped()["ppo"])(*map(torch.cat, zip(*shown, strict=True)))[0].numpy()
    for logits in (computed, trained):
        assert np.allclose(logits, arrays["logits"], atol=1e-4)
        assert (np.argmax(logits, 1) == arrays["logits"].argmax(1)).all()


def test_the_card_says_how_it_was_trained():
    training = read_card(shipped()["ppo"])["training"]
    assert {"tasks_per_level", "gradient_steps", "learning_rate"} <= set(training["plan"])
    assert "num_envs" in training["began_with"]["training"]["recipe"]
