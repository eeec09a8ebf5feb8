"""What the cards of shipped policies say of their terrains is played again."""

import numpy as np
import pytest

from marsexplorer.evaluation.cards import replay_card
from marsexplorer.policies.files.card import of_paper, read_card, shipped, write_card
from tests.support.policy_files import write_onnx

FILES = {**shipped(), **of_paper()}


@pytest.mark.parametrize("name", FILES)
def test_the_first_ten_terrains_of_a_card_are_played_again(name):
    assert not any(replay_card(FILES[name], 10))


@pytest.mark.long
@pytest.mark.parametrize("name", FILES)
def test_all_terrains_of_a_card_are_played_again(name):
    differences = list(replay_card(FILES[name]))
    results = read_card(FILES[name])["results"]
    assert len(differences) == sum(result["terrains"] for result in results.values()) >= 200
    assert not any(differences)


@pytest.mark.parametrize("name", FILES)
def test_the_figures_of_a_card_are_those_of_its_episodes(name):
    for result in read_card(FILES[name])["results"].values():
        assert len(result["moves"]) == len(result["actions"]) == result["terrains"]
        if result["completion"] == 1:
            assert result["steps"] == pytest.approx(np.mean(result["moves"]), abs=0.01)


def test_another_episode_and_a_card_without_any_are_noticed(tmp_path):
    path = tmp_path / "ppo.onnx"
    path.write_bytes(FILES["ppo"].read_bytes())
    card = read_card(path)
    result = next(iter(card["results"].values()))
    result["moves"][1] += 1
    result["actions"][2] = "0" * 12
    write_card(path, card)
    wrong = [difference for difference in replay_card(path, 3) if difference]
    assert [difference.seed - result["first_seed"] for difference in wrong] == [1, 2]
    empty = write_onnx(tmp_path / "none.onnx", card={"summary": "One."})
    with pytest.raises(ValueError, match="lists no episodes"):
        next(replay_card(empty))
