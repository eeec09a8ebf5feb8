"""`marsexplorer train`: a run of PPO, with its card, that stops and goes on."""

import os
import re
import shlex
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from click.testing import CliRunner

from humanplay.tasks.mars.cli import cards, cli
from marsexplorer.policies.files.card import read_card
from marsexplorer.training import run_folder
from marsexplorer.training.config import RECIPES

TINY = replace(
    RECIPES["priced"], num_envs=8, num_steps=16, minibatch_size=64, value_warmup_updates=1
)


@pytest.fixture
def quick(monkeypatch):
    """Make the recipe small enough for a test, and draw no curve."""
    monkeypatch.setitem(RECIPES, "priced", TINY)
    monkeypatch.setattr(cards, "HELD_OUT_TERRAINS", 3)
    monkeypatch.setattr(run_folder, "VALIDATION_EPISODES", 8)
    monkeypatch.setattr(run_folder, "plot_learning_curve", lambda _, path: path.touch())
    monkeypatch.setattr("humanplay.jobs.cores", lambda: 1)


@pytest.fixture
def in_a_thread(monkeypatch):
    """Play in a thread, not a process; `research/refinement` tests with processes."""
    monkeypatch.setattr("humanplay.jobs.Jobs", lambda *_: ThreadPoolExecutor(1))


def test_the_card_has_the_command_and_the_figures_of_every_size(quick, in_a_thread, tmp_path):
    options = [
        "--recipe",
        "priced",
        "--level",
        "random",
        "--size",
        "21",
        "--size",
        "24",
        "--steps",
        "256",
        "--seed",
        "3",
    ]
    done = CliRunner().invoke(cli, ["train", *options, "--out", str(tmp_path / "mine")])
    assert done.exit_code == 0, done.output
    card = read_card(tmp_path / "mine" / "mine.onnx")
    assert card["command"] == f"marsexplorer train {' '.join(options)} --out mine"
    terrains = {size: figures["terrains"] for size, figures in card["results"].items()}
    assert terrains == {"random 21x21": 3, "random 24x24": 2}


def test_a_stopped_run_goes_on_by_the_same_command_with_resume(
    quick, in_a_thread, monkeypatch, tmp_path
):
    monkeypatch.setitem(RECIPES, "best", replace(TINY, name="best", rule_coef=(0.0, 0.0, 0.0)))
    folder, updates = tmp_path / "mine", run_folder.RunFolder.on_update

    def stop_after_two(self, metrics):
        updates(self, metrics)
        if metrics.global_step == 256:
            os.kill(os.getpid(), signal.SIGINT)

    words = [
        "train",
        "--minutes=0.001",
        "--set",
        "gamma=0.9",
        "--set=target_entropy=0.5,0.05",
        "--out",
        str(folder),
    ]
    monkeypatch.setattr("humanplay.tasks.mars.cli.train._steps_for", lambda *_: 512)
    monkeypatch.setattr(run_folder.RunFolder, "on_update", stop_after_two)
    stopped = CliRunner().invoke(cli, words)
    assert "stopped after 256 of 512 moves" in stopped.output
    assert "no episode has ended yet" in stopped.output
    assert "nan" not in stopped.output
    monkeypatch.setattr(run_folder.RunFolder, "on_update", updates)
    for command in (
        [*words, "--resume"],
        shlex.split(re.search(r"go on with: marsexplorer (.*)", stopped.output)[1]),
    ):
        done = CliRunner().invoke(cli, command)
        assert done.exit_code == 0, done.output
        training = read_card(folder / "mine.onnx")["training"]
        assert training["moves"] == 512
        assert (training["recipe"]["gamma"], training["recipe"]["target_entropy"]) == (
            0.9,
            [0.5, 0.05],
        )
    other = CliRunner().invoke(cli, ["train", "--out", str(folder), "--resume"])
    assert other.exit_code == 2
    assert "is of another run (config)" in " ".join(other.output.split())


@pytest.mark.long
def test_sigterm_ends_a_run_like_ctrl_c_and_in_its_own_words_alone(tmp_path):
    command = [
        sys.executable,
        "-m",
        "humanplay.tasks.mars.cli",
        "train",
        "--steps=100000000",
        "--out",
        "run",
    ]
    environ = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(command, cwd=tmp_path, env=environ, **pipes) as run:
        next(line for line in run.stdout if " moves, " in line)
        run.send_signal(signal.SIGTERM)
        printed = run.communicate(timeout=60)[0]
    assert "go on with: marsexplorer train" in printed
    assert "leaked" not in printed, "semaphores of its workers"


def test_a_run_that_is_too_short_to_learn_says_so(quick, in_a_thread, tmp_path):
    for steps in (128, 129):
        words = [
            "train",
            "--recipe=priced",
            f"--steps={steps}",
            "--out",
            str(tmp_path / str(steps)),
        ]
        done = CliRunner().invoke(cli, words)
        assert done.exit_code == 0, done.output
        assert ("128 moves train the value alone" in done.output) is (steps == 128)


@pytest.mark.parametrize(
    ("setting", "part"),
    [
        ("speed=3", "expected FIELD=VALUE with a field of prior_scale,"),
        ("gamma", "expected FIELD=VALUE"),
        ("gamma=high", "gamma takes a number, got 'high'"),
        ("num_envs=0", "num_envs takes a whole number above 0, got '0'"),
        ("has_bonus=maybe", "has_bonus takes true or false, got 'maybe'"),
        ("rule_coef=1,2", "rule_coef takes 3 numbers with commas, got '1,2'"),
    ],
)
def test_a_setting_that_cannot_be_is_refused_in_words(setting, part, tmp_path):
    refused = CliRunner().invoke(cli, ["train", "--set", setting, "--out", str(tmp_path / "new")])
    assert refused.exit_code == 2
    assert part in " ".join(refused.output.split()).replace("│ ", "").replace(" │", "")
    assert not (tmp_path / "new").exists()
