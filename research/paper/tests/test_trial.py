"""A trial trains, measures and writes its result last, the same each time."""

from dataclasses import asdict, replace
from itertools import pairwise
from math import log

import onnx
import pytest
import torch

from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.cards import replay_card
from marsexplorer.policies import load
from marsexplorer.policies.files.onnx import OnnxModel
from marsexplorer.rules import SEED
from marsexplorer.training.ppo import RolloutBuffer, TrainingRun, collect_rollout, forward
from research.paper import algorithms, trial
from research.paper.algorithms import PPOTrainer, begin, check_variant
from research.paper.jobs import read_lines
from research.paper.trainers import settings
from research.paper.trainers.settings import PPO, TUNED, VARIANTS, Variants, ppo_settings
from research.paper.trial import ENDINGS, TRAINING_SHARE, Trial

SMALL = {"num_envs": 4, "num_steps": 8, "minibatch_size": 16, "update_epochs": 2}
TRIAL = Trial("ppo", "paper", "random", 9, 3, 3 * 32, terrains=2)
BOARD = EnvConfig(rows=9, cols=12, max_steps=20)
CHANGES = {"reward": {"a": 1}, "mask": {"b": 2}, "rest": {"c": 3}}
SARSA = Variants("SARSA", CHANGES, works=("reward", "mask"), tuned=("reward", "mask", "rest"))


@pytest.fixture
def quick(monkeypatch):
    """Small updates."""
    monkeypatch.setattr(settings, "PPO", replace(PPO, **SMALL))


def without_time(folder):
    lines = read_lines(folder / TRIAL.name / "log.jsonl")
    return [{name: value for name, value in line.items() if name != "cpu_s"} for line in lines]


def weights(path):
    return [tensor.raw_data for tensor in onnx.load(path).graph.initializer]


def test_a_trial_has_a_log_of_its_settings_its_curve_and_its_result_and_a_policy_with_a_card(
    quick, tmp_path
):
    shares = []
    assert not TRIAL.is_done(tmp_path)
    TRIAL.run(tmp_path, shares.append)
    head, *curve, result = read_lines(tmp_path / TRIAL.name / "log.jsonl")
    assert shares[:3] == pytest.approx([TRAINING_SHARE * number / 3 for number in (1, 2, 3)])
    assert shares[-1] == 1
    assert (head["kind"], head["trial"]) == ("trial", asdict(TRIAL))
    assert head["settings"]["update_epochs"] == 2
    assert [line["moves"] for line in curve] == [32, 64, 96]
    assert all(0 < one["cpu_s"] < other["cpu_s"] for one, other in pairwise(curve))
    for line in curve:
        assert sum(line[ending] for ending in ENDINGS) == pytest.approx(1.0, abs=1e-5)
        assert 0 < line["coverage"] <= 1
    assert (result["kind"], result["moves"], result["terrains"]) == ("result", 96, 2)
    assert result["cpu_s"] >= curve[-1]["cpu_s"]
    assert result["completion"] == result["explored"]
    path = tmp_path / TRIAL.name / f"{TRIAL.name}.onnx"
    assert load(path).name == TRIAL.name
    card = OnnxModel(path).card
    assert card["training"]["settings"] == head["settings"]
    assert card["results"]["random 9x9"]["score"] == result["score"]
    assert not any(replay_card(path))
    assert result["commonest"] in ACTIONS
    assert 0.25 <= result["commonest_share"] <= 1
    assert 0 <= result["entropy_of_moves"] <= log(4) + 1e-4
    assert TRIAL.is_done(tmp_path)
    assert not replace(TRIAL, moves=1000).is_done(tmp_path)


def test_the_same_trial_gives_the_same_curve_policy_and_result(quick, tmp_path):
    for name in ("one", "other"):
        TRIAL.run(tmp_path / name, lambda share: None)
    assert without_time(tmp_path / "one") == without_time(tmp_path / "other")
    file = f"{TRIAL.name}/{TRIAL.name}.onnx"
    assert weights(tmp_path / "one" / file) == weights(tmp_path / "other" / file)


def stops_after(rounds):
    """The progress callback of a job that is stopped after some rounds."""
    shares = []

    def on_progress(share):
        shares.append(share)
        if len(shares) == rounds:
            raise KeyboardInterrupt

    return on_progress


def test_a_trial_that_was_stopped_goes_on_exactly_here_and_on_another_machine(
    quick, tmp_path, monkeypatch
):
    TRIAL.run(tmp_path / "whole", lambda share: None)
    with pytest.raises(KeyboardInterrupt):
        TRIAL.run(tmp_path / "stopped", stops_after(1))
    with pytest.raises(ValueError, match=r"is of another trial .*give another --out"):
        replace(TRIAL, moves=64).run(tmp_path / "stopped", lambda share: None)
    with pytest.raises(KeyboardInterrupt):
        TRIAL.run(tmp_path / "stopped", stops_after(1))
    carried = tmp_path / "carried"
    checkpoint = tmp_path / "stopped" / TRIAL.name / "checkpoint.pt"
    assert trial.carry(tmp_path / "stopped", carried)[0].endswith("64 moves so far")
    (far,) = trial.read_unfinished(carried)
    assert (far["trial"], far["moves"], far["line"]["moves"]) == (TRIAL, 64, 64)
    checkpoint.unlink()
    monkeypatch.setattr(trial, "CARRIED", carried)
    shares = []
    TRIAL.run(tmp_path / "stopped", shares.append)
    assert shares[0] == TRAINING_SHARE  # only the third round was left
    assert without_time(tmp_path / "stopped") == without_time(tmp_path / "whole")
    file = f"{TRIAL.name}/{TRIAL.name}.onnx"
    assert weights(tmp_path / "stopped" / file) == weights(tmp_path / "whole" / file)
    assert trial.carry(tmp_path / "stopped", carried) == []
    assert not checkpoint.exists()
    assert not [*carried.iterdir()]


def test_a_trial_that_goes_on_from_another_machine_names_both_and_tells_no_cpu_time(
    quick, tmp_path
):
    with pytest.raises(KeyboardInterrupt):
        TRIAL.run(tmp_path, stops_after(1))
    checkpoint = tmp_path / TRIAL.name / "checkpoint.pt"
    stored = torch.load(checkpoint, weights_only=True)
    assert [line["cpu_s"] > 0 for line in stored["lines"]] == [True]
    torch.save(stored | {"machines": ["a CPU, beside a GPU"]}, checkpoint)
    TRIAL.run(tmp_path, lambda share: None)
    head, _, *later = read_lines(tmp_path / TRIAL.name / "log.jsonl")
    assert head["hardware"] == f"a CPU, beside a GPU; then {trial.hardware()}"
    assert [line["cpu_s"] for line in later] == [None, None, None]


@pytest.mark.parametrize("variant", ["paper", "works"])
def test_the_values_of_a_rollout_are_what_the_network_says_of_its_steps(variant):
    config = replace(ppo_settings(variant), **SMALL)
    run = TrainingRun.begin(config, [BOARD], 128, 5)
    buffer = RolloutBuffer.empty(config, run.envs.observe())
    after = collect_rollout(run, buffer)
    with torch.no_grad():
        values = [forward(run, obs)[1] for obs in zip(*buffer.obs, strict=True)]
        assert torch.allclose(buffer.values, torch.stack(values), atol=1e-6)
        assert torch.allclose(after, forward(run, run.envs.observe())[1], atol=1e-6)
    assert len(buffer.values.unique()) > 8


def test_a_training_on_few_terrains_meets_no_others_and_goes_on_with_them(quick):
    trainer, first = begin("ppo", "works@3", EnvConfig.of("random", 9), 1, 10_000), 2 * 10**12
    met = set()
    for _ in range(30):
        met |= {*trainer.envs.env._worlds.scalars.view("int64")[:, SEED].tolist()}
        trainer.advance()
    assert trainer.envs.recent.count > 3
    assert met == {first, first + 1, first + 2}
    with pytest.raises(ValueError, match="only PPO has variants NAME@TERRAINS"):
        check_variant("a2c", "works@3")


def changed(variant):
    other = asdict(ppo_settings(variant))
    return {name for name, value in asdict(PPO).items() if value != other[name]}


def test_a_variant_of_ppo_differs_from_the_paper_in_the_settings_of_its_changes_alone():
    assert changed("paper") == set()
    assert changed("appendix") == {"update_epochs", "minibatch_size"}
    assert changed("paper-no-bonus") == {"has_bonus"}
    assert changed("paper-no-value-clip") == {"vf_change_clip"}
    assert changed("paper+reward+discount") == {"reward_per_cell", "has_bonus", "gamma"}
    assert changed("works") == changed("paper+mask+features") == {"network", "mask"}
    for left_out in TUNED:
        without = changed(f"tuned-no-{left_out}")
        assert changed("tuned") - without == set(settings.CHANGES[left_out]) & changed("tuned")
    names = (*VARIANTS["ppo"].alone, *VARIANTS["ppo"].sets)
    assert len({ppo_settings(variant) for variant in names}) == len(names)


@pytest.mark.parametrize(
    ("variant", "expected"),
    [
        ("paper", {}),
        ("works", {"a": 1, "b": 2}),
        ("works-no-mask", {"a": 1}),
        ("tuned-no-mask", {"a": 1, "c": 3}),
        ("paper+mask+rest", {"b": 2, "c": 3}),
    ],
)
def test_a_variant_is_the_paper_with_its_changes(variant, expected):
    assert SARSA.settings_for(variant) == expected


@pytest.mark.parametrize(
    "variant", ["", "work", "works-no-", "works-no-rest", "paper+", "paper+none"]
)
def test_an_unknown_variant_is_an_error_that_names_the_others(variant):
    names = r"SARSA has no variant .*works-no-mask, tuned, .*tuned-no-rest, paper\+reward"
    with pytest.raises(ValueError, match=names):
        SARSA.settings_for(variant)


def test_without_tianshou_variants_are_checked_and_a_sentence_says_what_to_run(monkeypatch):
    for algorithm in ("a2c", "rainbow", "sac"):
        check_variant(algorithm, "works-no-features")
        with pytest.raises(ValueError, match="has no variant 'wroks'"):
            check_variant(algorithm, "wroks")
    monkeypatch.setitem(__import__("sys").modules, "research.paper.trainers.tianshou_trainer", None)
    with pytest.raises(ModuleNotFoundError):
        begin("sac", "paper", BOARD, 1, 1000)
    assert set(algorithms.ALGORITHMS) == {"a2c", "ppo", "rainbow", "sac"}


@pytest.mark.parametrize("variant", ["paper", "works", "works-no-mask", "works-no-features"])
def test_a_policy_of_any_network_is_loaded_and_plays(tmp_path, variant):
    config = replace(ppo_settings(variant), **{**SMALL, "value_warmup_updates": 0})
    trainer, path = PPOTrainer(config, BOARD, 5, 128), tmp_path / "some.onnx"
    trainer.advance()
    trainer.save_policy(path, {"summary": "one", "size": [9, 12]})
    policy, episode = load(path), Episode.begin(BOARD, seed=3)
    policy.reset(3)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    ends = {True: ("explored", "timed_out"), False: ("collided", "out_of_bounds")}
    assert episode.outcome in ends[config.mask]
    assert ("may drive into" in OnnxModel(path).card["limits"]) != config.mask


def test_the_hardware_has_the_model_of_the_processor_where_the_system_says_it(
    tmp_path, monkeypatch
):
    info = tmp_path / "cpuinfo"
    info.write_text("processor\t: 0\nmodel name\t: Some CPU @ 2.00GHz\nprocessor\t: 1\n")
    assert trial.processor(info) == "Some CPU @ 2.00GHz"
    monkeypatch.setattr(trial, "accelerator", lambda: "")
    monkeypatch.setattr(trial.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(trial.platform, "processor", lambda: "x86_64")
    assert trial.processor(tmp_path / "none") == ""
    monkeypatch.setattr(trial, "processor", lambda: "")
    assert trial.hardware() == "x86_64, one thread"
    assert not trial.names_processor(trial.hardware())
    monkeypatch.setattr(trial, "processor", lambda: "Some CPU")
    assert trial.hardware() == "x86_64, Some CPU, one thread"
    assert trial.names_processor(trial.hardware())
    assert not trial.names_processor(None)
    assert not trial.names_processor("x86_64, one thread, beside Some GPU")
