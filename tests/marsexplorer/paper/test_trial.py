"""Trials: wherever one is stopped or killed, it goes on to the same curve, the same policy and the same result."""

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import asdict, replace
from itertools import count, pairwise
from pathlib import Path

import pytest
from torch.optim.optimizer import register_optimizer_step_post_hook

from marsexplorer.paper import trial as trial_module
from marsexplorer.paper.trial import ENDINGS, Trial, read_log
from marsexplorer.policies import load
from marsexplorer.training.config import RECIPES

SMALL = {"num_envs": 4, "num_steps": 8, "minibatch_size": 16, "update_epochs": 2}
TRIAL = Trial("ppo", "paper", "random", 9, 3, 3 * 32, terrains=2)
TRAINED = 1 - 2 * trial_module.CPU_S_PER_TERRAIN / TRIAL.forecast
SHARES = [
    TRAINED / 3,
    2 * TRAINED / 3,
    TRAINED,
    *(TRAINED + (1 - TRAINED) * played / 6 for played in (2, 4, 6)),
]
"""What is done after each of three updates, and after the two episodes of the policy and of each rule."""
CHILD = f"""
import os, signal, sys
from dataclasses import replace
from pathlib import Path
from marsexplorer.paper import trial as trial_module
from marsexplorer.training.config import RECIPES
RECIPES["paper"] = replace(RECIPES["paper"], **{SMALL})
trial_module.CHECKPOINT_INTERVAL_S, trial_module.SAVING_SHARE = 0.0, float("inf")
rename, seen = Path.replace, []
def die(path, target):
    seen.append(target.name)
    if seen.count("checkpoint.pt") == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return rename(path, target)
Path.replace = die
trial_module.{TRIAL!r}.run(Path(sys.argv[1]), lambda share: None)
"""


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Small updates, and a checkpoint after each."""
    monkeypatch.setitem(RECIPES, "paper", replace(RECIPES["paper"], **SMALL))
    monkeypatch.setattr(trial_module, "CHECKPOINT_INTERVAL_S", 0.0)
    monkeypatch.setattr(trial_module, "SAVING_SHARE", float("inf"))


@pytest.fixture
def whole(tmp_path):
    TRIAL.run(tmp_path / "whole", lambda share: None)
    return outcome(tmp_path / "whole")


class Killed(BaseException):
    """Stands for a kill."""


def outcome(folder):
    """What a trial came to, without the time that it took."""
    own = folder / TRIAL.name
    assert TRIAL.is_done(folder)
    assert sorted(path.name for path in own.iterdir()) == ["log.jsonl", f"{TRIAL.name}.safetensors"]
    lines = read_log(own / "log.jsonl")
    return [
        {name: value for name, value in line.items() if name != "cpu_s"} for line in lines
    ], policy_bytes(own)


def policy_bytes(own):
    return (own / f"{TRIAL.name}.safetensors").read_bytes()


def test_a_trial_has_a_log_of_its_settings_its_curve_and_its_result_and_a_policy_with_a_card(
    tmp_path,
):
    shares = []
    TRIAL.run(tmp_path, shares.append)
    head, *curve, result = read_log(tmp_path / TRIAL.name / "log.jsonl")
    assert shares == pytest.approx(SHARES)
    assert head["kind"] == "trial"
    assert head["trial"] == asdict(TRIAL)
    assert head["settings"]["update_epochs"] == 2
    assert [line["moves"] for line in curve] == [32, 64, 96]
    assert all(0 < one["cpu_s"] < other["cpu_s"] for one, other in pairwise(curve))
    for line in curve:
        assert sum(line[ending] for ending in ENDINGS) == pytest.approx(1.0, abs=1e-5)
        assert 0 < line["coverage"] <= 1
    assert (result["kind"], result["moves"], result["terrains"]) == ("result", 96, 2)
    assert result["cpu_s"] >= curve[-1]["cpu_s"]
    assert sum(result[ending] for ending in ENDINGS) == 1.0
    assert result["completion"] == result["explored"]
    policy = tmp_path / TRIAL.name / f"{TRIAL.name}.safetensors"
    assert load(policy).name == TRIAL.name
    assert (
        json.loads(json.dumps(head["settings"])).items()
        <= card_of(policy)["training"]["settings"].items()
    )
    assert card_of(policy)["results"]["random 9x9"]["score"] == result["score"]


def card_of(policy):
    header = policy.read_bytes()
    return json.loads(
        json.loads(header[8 : 8 + int.from_bytes(header[:8], "little")])["__metadata__"]["card"]
    )


@pytest.mark.parametrize("rounds", [1, 3, 4])
def test_a_trial_that_was_stopped_goes_on_to_the_same_curve_policy_and_result(
    tmp_path, whole, rounds
):
    shares = []

    def stop(share):
        shares.append(share)
        if len(shares) == rounds:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        TRIAL.run(tmp_path, stop)
    assert not TRIAL.is_done(tmp_path)
    TRIAL.run(tmp_path, shares.append)
    assert list(dict.fromkeys(shares)) == pytest.approx(SHARES)
    assert outcome(tmp_path) == whole


def test_a_trial_that_is_killed_after_any_of_its_writes_goes_on_to_the_same(
    tmp_path, whole, monkeypatch
):
    rename, written = Path.replace, []

    def die(path, target):
        rename(path, target)
        written.append(target.name)
        if len(written) == moment:
            raise Killed

    for moment in count(1):
        folder = tmp_path / str(moment)
        written.clear()
        with monkeypatch.context() as patched, suppress(Killed):
            patched.setattr(Path, "replace", die)
            TRIAL.run(folder, lambda share: None)
        TRIAL.run(folder, lambda share: None)
        assert outcome(folder) == whole, written
        if len(written) < moment:
            break
    log, policy, checkpoint = "log.jsonl", f"{TRIAL.name}.safetensors", "checkpoint.pt"
    assert written == [*[log, policy, checkpoint] * 4, policy, log]


@pytest.mark.long
def test_a_trial_whose_process_is_killed_while_it_writes_a_checkpoint_goes_on_to_the_same(
    tmp_path, whole
):
    process = subprocess.run([sys.executable, "-c", CHILD, str(tmp_path)], check=False, timeout=120)
    assert process.returncode == -signal.SIGKILL
    own = tmp_path / TRIAL.name
    assert [path.name for path in own.glob(".checkpoint*")] != []
    assert len(read_log(own / "log.jsonl")) == 3
    shares = []
    TRIAL.run(tmp_path, shares.append)
    assert shares == pytest.approx(SHARES[1:])
    assert outcome(tmp_path) == whole


def test_a_ctrl_c_in_the_middle_of_a_round_waits_for_its_end_and_a_second_one_breaks_it_off(
    tmp_path, whole
):
    steps = presses = 0

    def press(optimizer, args, kwargs):
        nonlocal steps
        steps += 1
        if steps == 5:  # the first gradient step of the second round
            for _ in range(presses):
                os.kill(os.getpid(), signal.SIGINT)

    for presses, done_before_resuming in ((1, 2), (2, 1)):
        folder, shares, steps = tmp_path / str(presses), [], 0
        hook = register_optimizer_step_post_hook(press)
        with pytest.raises(KeyboardInterrupt):
            TRIAL.run(folder, lambda share: None)
        hook.remove()
        TRIAL.run(folder, shares.append)
        assert shares == pytest.approx(SHARES[done_before_resuming:])
        assert outcome(folder) == whole


def test_a_folder_of_another_trial_is_refused_and_a_finished_trial_is_left_as_it_is(tmp_path):
    TRIAL.run(tmp_path, lambda share: None)
    before = policy_bytes(tmp_path / TRIAL.name)
    with pytest.raises(ValueError, match="another trial"):
        replace(TRIAL, moves=1000).run(tmp_path, lambda share: None)
    TRIAL.run(tmp_path, lambda share: pytest.fail("a finished trial went on"))
    assert policy_bytes(tmp_path / TRIAL.name) == before
