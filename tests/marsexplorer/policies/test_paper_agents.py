"""The agents of the paper play from ONNX files as the trained networks did."""

import json
from pathlib import Path

import numpy as np
import pytest

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies.files.card import of_paper
from marsexplorer.policies.files.onnx import OnnxModel
from marsexplorer.policies.network.batch import act_many
from tests.support.policy_files import write_onnx

RECORDED = json.loads(
    (Path(__file__).parents[2] / "fixtures" / "policies" / "paper_agents.json").read_text()
)
"""Agent -> episodes that its network decided, without ONNX: their moves, and what was thought of
the first board.
"""


def begin(recorded):
    size = recorded["size"]
    config = EnvConfig.of(recorded["level"], tuple(size) if isinstance(size, list) else size)
    return Episode.begin(config, seed=recorded["seed"])


@pytest.mark.parametrize("name", RECORDED)
def test_every_recorded_move_is_made_again(name):
    assert sorted(RECORDED) == sorted(of_paper())
    policy = policies.load(name)
    for recorded in RECORDED[name]:
        episode = begin(recorded)
        policy.reset(recorded["seed"])
        for number, digit in enumerate(recorded["actions"]):
            action = policy.act(episode.codes)
            assert action == int(digit), number
            if number == 0:
                shares, value = policy.thought()
                thought = [
                    np.nan if number is None else number for number in recorded["first_thought"]
                ]
                assert [*shares, value] == pytest.approx(thought, rel=1e-4, abs=2e-4, nan_ok=True)
            episode.step(action)


def test_they_act_as_their_cards_say_and_complete_terrains_but_for_the_letter():
    acts = {name: OnnxModel(path).card["acts"] for name, path in of_paper().items()}
    assert acts == {
        "a2c-works": "samples",
        "ppo-paper": "samples",
        "ppo-works": "greedy with guard",
        "rainbow-works": "greedy",
        "sac-works": "samples",
    }
    for name, path in of_paper().items():
        card = OnnxModel(path).card
        assert all(card[key] for key in ("summary", "hardware", "limits", "training"))
        cut_short = "240,000 of the paper's 9,000,000 moves" in card["summary"]
        assert cut_short == (name == "ppo-paper") == ("command" not in card)
        completion = card["results"]["random 21x21"]["completion"]
        assert completion == 0 if name == "ppo-paper" else completion >= 0.9


def test_boards_decided_together_make_the_moves_of_single_decisions():
    for name in ("ppo-works", "rainbow-works", "sac-works"):
        drivers, episodes = [], []
        for seed in range(3):
            drivers.append(policies.load(name))
            drivers[-1].reset(seed)
            episodes.append(Episode.begin(EnvConfig(), seed=seed))
        for _ in range(20):
            actions = act_many(drivers, [episode.codes for episode in episodes])
            for episode, action in zip(episodes, actions, strict=True):
                episode.step(action)
        alone = policies.load(name)
        for seed, together in enumerate(episodes):
            episode = Episode.begin(EnvConfig(), seed=seed)
            alone.reset(seed)
            for action in together.actions:
                assert alone.act(episode.codes) == action
                episode.step(action)


def test_moves_are_drawn_by_the_seed_where_the_card_says_so(tmp_path):
    path = write_onnx(tmp_path / "drawn.onnx", card={"acts": "samples", "summary": "One."})
    policy, codes = policies.load(path), Episode.begin(EnvConfig.of("random", (6, 7)), seed=0).codes
    drawn = []
    for seed in (1, 1, 2):
        policy.reset(seed)
        drawn.append([policy.act(codes) for _ in range(60)])
    assert drawn[0] == drawn[1] != drawn[2]
    shares = np.bincount([*drawn[1], *drawn[2]], minlength=4) / 120
    assert shares == pytest.approx(policy.thought()[0], abs=0.2)


@pytest.mark.parametrize("acts", ["dreams", ["greedy"], 3])
def test_a_card_that_says_something_else_is_refused(acts, tmp_path):
    path = write_onnx(tmp_path / "odd.onnx", card={"acts": acts})
    sentence = r'is no policy: expected .* as "acts", got '
    with pytest.raises(policies.PolicyFileError, match=sentence):
        policies.load(path)
