"""Policy files of older formats play exactly as they did, and the shipped ones are nothing but those files under new names.

tests/fixtures/policies has what the networks saw and decided when their files still had the older formats, and the digests of
those files, which are rebuilt here from the shipped ones by undoing the renaming.
"""

import hashlib
import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from marsexplorer import policies
from marsexplorer.policies.files import formats
from marsexplorer.policies.files.card import read_card, read_stored_card, shipped
from marsexplorer.policies.network.model import load_net
from marsexplorer.policies.network.paper_model import load_paper_net
from marsexplorer.training.config import TrainConfig
from marsexplorer.training.refine import RefineConfig

FIXTURES = Path(__file__).parents[2] / "fixtures" / "policies"
NAMES = ("ppo", "ppo-paper")
ADDED_TO_RECIPES = {"network", "mask", "has_bonus", "kl_of_last_epoch", "vf_change_clip"}
ADDED_TO_RECIPES |= {"sees_prices", "prior_scale", "rule_coef"}
"""What recipes have had since the shipped policies were trained."""
ADDED_TO_PLANS = {"sizes", "anchor_levels"}
"""The same of the plans of a refinement."""


def older_names(value):
    """Return a card with the keys of every recipe and plan as they were before."""
    if isinstance(value, list):
        return [older_names(each) for each in value]
    if not isinstance(value, dict):
        return value
    card = {}
    for key, part in value.items():
        older = {new: old for old, new in formats.NEWER_KEYS.get(key, {}).items()}
        inside = older_names(part)
        card[key] = (
            {older.get(name, name): each for name, each in inside.items()} if older else inside
        )
    return card


def rebuilt(source, target):
    """Write a shipped file as it was in the older format: the exact inverse of `formats.convert_file`."""
    older_format = {new: old for old, new in formats.NEWER_FORMATS.items()}
    older_tensor = {new: old for old, new in formats.NEWER_TENSORS.items()}
    data = source.read_bytes()
    end = 8 + int.from_bytes(data[:8], "little")
    header = json.loads(data[8:end])
    card = json.loads(header.pop("__metadata__")["card"])
    card = older_names(card) | {"format": older_format[card["format"]]}
    older = {"__metadata__": {"card": json.dumps(card, indent=1)}}
    for name, place in header.items():
        first, _, rest = name.partition(".")
        older[f"{older_tensor.get(first, first)}.{rest}"] = place
    text = json.dumps(older, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    target.write_bytes(len(text).to_bytes(8, "little") + text + data[end:])
    return target


def recorded(name):
    """Yield (head, observations uint8[steps, rows, cols], first step, last step) of each recorded episode, and the arrays."""
    arrays = np.load(FIXTURES / f"{name}-decisions.npz")
    episodes, byte, step = [], 0, 0
    for head in json.loads(str(arrays["episodes"])):
        cells, steps = head["rows"] * head["cols"], head["moves"]
        length = -(-cells // 4)
        packed = arrays["codes"][byte : byte + steps * length].reshape(steps, length)
        codes = np.stack([packed >> shift & 3 for shift in (0, 2, 4, 6)], axis=2).reshape(
            steps, -1
        )[:, :cells]
        observations = codes.reshape(steps, head["rows"], head["cols"]).astype(np.uint8)
        episodes.append((head, observations, step, step + steps))
        byte, step = byte + steps * length, step + steps
    return episodes, arrays


@pytest.fixture(scope="module", params=NAMES)
def files(request, tmp_path_factory):
    """(name, the shipped file, the same file in its older format)."""
    name = request.param
    return (
        name,
        shipped()[name],
        rebuilt(shipped()[name], tmp_path_factory.mktemp("older") / f"{name}.safetensors"),
    )


def test_the_rebuilt_file_is_the_older_one_byte_for_byte(files):
    name, _, older = files
    expected = json.loads((FIXTURES / "shipped.json").read_text())[f"{name}.safetensors"]
    assert older.stat().st_size == expected["bytes"]
    assert hashlib.sha256(older.read_bytes()).hexdigest() == expected["sha256"]


def test_converting_the_older_file_gives_the_shipped_one_byte_for_byte(files, tmp_path):
    _, current, older = files
    formats.convert_file(older, tmp_path / "converted.safetensors")
    assert (tmp_path / "converted.safetensors").read_bytes() == current.read_bytes()


def test_both_formats_give_the_same_card_and_the_same_weights(files):
    name, current, older = files
    assert read_card(older) == read_card(current) == read_stored_card(current)
    assert read_stored_card(older)["format"] in formats.NEWER_FORMATS
    load = load_paper_net if name == "ppo-paper" else load_net
    both = load(older).state_dict(), load(current).state_dict()
    assert list(both[0]) == list(both[1])
    assert all(
        torch.equal(*tensors) for tensors in zip(both[0].values(), both[1].values(), strict=True)
    )


def test_cards_name_what_training_was_given_as_its_configurations_do(files):
    training = read_card(files[1])["training"]
    if "plan" in training:
        assert (
            set(training["plan"]) == {field.name for field in fields(RefineConfig)} - ADDED_TO_PLANS
        )
        training = training["began_with"]["training"]
    assert (
        set(training["recipe"]) == {field.name for field in fields(TrainConfig)} - ADDED_TO_RECIPES
    )


def test_every_recorded_decision_is_made_again_from_both_formats(files):
    name, current, older = files
    twins = policies.load(current), policies.load(older)
    episodes, arrays = recorded(name)
    said = []
    for head, observations, first, last in episodes:
        for policy in twins:
            policy.reset(head["seed"])
        for observation, action in zip(observations, arrays["action"][first:last], strict=True):
            assert [policy.act(observation) for policy in twins] == [action, action]
            (shares, value), (older_shares, older_value) = (policy.thought() for policy in twins)
            assert np.array_equal(shares, older_shares)
            assert value == older_value
            said.append((*shares, value))
    assert np.allclose(np.array(said)[:, :4], arrays["probabilities"], atol=1e-5)
    assert np.allclose(np.array(said)[:, 4], arrays["value"], atol=1e-4)


def logits_of(name, path, episodes):
    """Return float32[steps, 4] of recorded observations in order, each decided alone."""
    found = []
    policy, paper = policies.load(path), load_paper_net(path) if name == "ppo-paper" else None
    for head, observations, _, _ in episodes:
        policy.reset(head["seed"])
        for observation in observations:
            if paper is not None:
                with torch.inference_mode():
                    logits = paper(torch.from_numpy(observation.copy())[None])[0].numpy()
            else:
                logits, values = policy.net.infer(*policy.extract_features(observation))
                policy.choose(logits[0], float(values[0]))
            found.append(logits[0])
    return np.array(found)


def test_every_recorded_logit_is_computed_again(files):
    """Bit for bit from both formats; to some millionths of the recording, where another torch or processor made it."""
    name, current, older = files
    episodes, arrays = recorded(name)
    logits = logits_of(name, current, episodes)
    assert np.array_equal(logits, logits_of(name, older, episodes))
    assert np.allclose(logits, arrays["logits"], atol=1e-4)
    print(
        f"\n{name}: logits equal to the recorded ones bit for bit: {np.array_equal(logits, arrays['logits'])}"
    )


def test_a_file_with_tensors_of_both_names_is_refused(files, tmp_path):
    _, _, older = files
    tensors = load_file(older)
    name, tensor = next(iter(tensors.items()))
    tensors[formats.NEWER_TENSORS.get(name.split(".")[0], "more") + ".0.bias"] = tensor.clone()
    save_file(
        tensors,
        tmp_path / "both.safetensors",
        metadata={"card": json.dumps(read_stored_card(older))},
    )
    with pytest.raises(
        policies.PolicyFileError, match=r"expected the \d+ tensors of the network, got \d+ others"
    ):
        policies.load(tmp_path / "both.safetensors")
