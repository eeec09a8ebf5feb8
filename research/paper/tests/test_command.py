"""`python -m research.paper` as people type it, with its refusals and pictures."""

import json
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from marsexplorer.config import EnvConfig
from research.paper.__main__ import paper, read_human_level
from research.paper.algorithms import ALGORITHMS
from research.paper.jobs import lock
from research.paper.tests.logs import trial_of, write_trial
from research.paper.trial import LARGEST_CHECKPOINT

PICTURES = ("figure4-moves.svg", "figure4-cpu.svg", "figure4-endings.svg")
TABLES = ("figure4.csv", "figure4.jsonl")
PPO_ALONE = ("--figure", 4, "--algorithms", "ppo", "--variants", "paper", "--seeds", 1)


def run(*args):
    """Return (exit code, stdout, stderr)."""
    result = CliRunner().invoke(paper, [*map(str, args)])
    return result.exit_code, result.stdout, result.stderr


def test_the_list_names_each_job_and_does_nothing(tmp_path):
    out = tmp_path / "out"
    code, printed, _ = run("--figure", 4, "--budget", "full", "--seeds", 1, "--out", out, "--list")
    assert (code, out.exists()) == (0, False)
    assert "sac-works-random-21-s0" in printed
    assert "8 of 8 jobs to do in" in printed
    write_trial(out, trial_of(moves=1000), [0.1, 0.2])
    options = ("--moves", 1000, "--terrains", 10, "--out", out)
    printed = run(*PPO_ALONE[:-1], 3, *options, "--list")[1]
    assert "ppo-paper-random-21-s0: done\n" in printed
    assert "2 of 3 jobs to do in" in printed


COMMAND = re.compile(
    r"(?:python -m\s+research\.paper |`)(--figure \d[^`#\n<]*(?:\n[^`#\n<]+(?=`))?)"
)
"""A command in a document, or its options alone; a line may break it."""


@pytest.mark.parametrize(
    "name", ["docs/paper.md", "docs/paper-trainings.md", "docs/evaluation.md", "research/README.md"]
)
def test_the_commands_of_the_documents_are_ones_that_there_are(name, tmp_path):
    quoted = COMMAND.findall((Path(__file__).parents[3] / name).read_text())
    commands = {command for command in quoted if "--redraw" not in command}
    assert commands
    for command in commands:
        code, printed, err = run(
            *command.replace("--list", "").split(), "--list", "--out", tmp_path
        )
        assert (code, "jobs to do in" in printed) == (0, True), f"{command}: {err}"


def test_all_algorithms_that_have_a_variant_take_part(tmp_path):
    printed = run(
        "--figure", 4, "--variants", "paper,appendix", "--seeds", 1, "--out", tmp_path, "--list"
    )[1]
    assert {line for line in printed.splitlines() if line.endswith("-s0")} == {
        *(f"{name}-paper-random-21-s0" for name in ALGORITHMS),
        "ppo-appendix-random-21-s0",
    }


def test_a_training_is_made_drawn_and_not_made_again(tmp_path):
    options = (*PPO_ALONE, "--moves", 4000, "--terrains", 2, "--out", tmp_path)
    code, printed, err = run(*options)
    assert code == 0, err
    assert "1 of 1 jobs to do in" in err
    assert "4 k" in printed
    assert {path.name for path in tmp_path.glob("figure4*")} == {*PICTURES, *TABLES}
    log = (tmp_path / "ppo-paper-random-21-s0" / "log.jsonl").read_bytes()
    assert "0 of 1 jobs to do in" in run(*options)[2]
    assert (tmp_path / "ppo-paper-random-21-s0" / "log.jsonl").read_bytes() == log


@pytest.mark.long
def test_a_run_that_is_told_to_end_saves_where_its_training_is(tmp_path):
    options = (*PPO_ALONE, "--moves", 10**9, "--out", tmp_path / "out")
    command = [sys.executable, "-m", "research.paper", *map(str, options)]
    process = subprocess.Popen(command, cwd=Path(__file__).parents[3], stderr=subprocess.PIPE)
    home, deadline = tmp_path / "out" / "ppo-paper-random-21-s0", time.monotonic() + 120
    while not home.exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    process.terminate()
    printed = process.communicate()[1].decode()
    assert process.returncode == 1
    assert "keeps what is done and how far trainings are; the same command goes on" in printed
    assert (home / "checkpoint.pt").stat().st_size < LARGEST_CHECKPOINT


def test_without_tianshou_three_algorithms_are_refused_before_anything_is_trained(
    tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules, "tianshou", None)
    monkeypatch.setattr("research.paper.__main__.find_spec", lambda name: None)
    code, _, err = run("--figure", 4, "--algorithms", "ppo,sac,a2c", "--out", tmp_path / "out")
    assert code == 2
    assert (
        "what trains A2C, in place of A3C, discrete SAC is not installed here: run `make paper`"
        in (err)
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "code", "part"),
    [
        (("--figure", 4, "--algorithms", "dqn"), 2, "no algorithm 'dqn'; choose of: a2c, ppo, "),
        ((*PPO_ALONE, "--variants", "wurks"), 2, "no variant 'wurks'"),
        (("--figure", 4, "--variants", "wurks"), 2, "no variant 'wurks'"),
        (
            ("--figure", 4, "--algorithms", "sac", "--variants", "appendix"),
            2,
            "no variant 'appendix'",
        ),
        ((*PPO_ALONE, "--moves", 2000), 2, "was begun with 1,000 moves"),
        (("--figure", 4, "--redraw", "nowhere"), 2, "nowhere holds none of: figure4*.jsonl"),
        (
            ("--figure", 4, "--draw", "--human-level", "nowhere.json"),
            1,
            "nowhere.json: No such file",
        ),
        (("--figure", 3), 2, "'3' is not one of"),
    ],
)
def test_a_mistake_is_one_sentence(tmp_path, options, code, part):
    write_trial(tmp_path, trial_of(moves=1000), [0.1, 0.2])
    exit_code, out, err = run(*options, "--out", tmp_path)
    assert (exit_code, out) == (code, "")
    assert part in err


def test_two_runs_in_a_folder_are_refused(tmp_path):
    with lock(tmp_path):
        code, _, err = run(*PPO_ALONE, "--out", tmp_path)
    assert code == 1
    assert f"another run is at work in {tmp_path}; wait for it, or give another --out\n" in err


def test_from_an_export_comes_what_comes_from_the_logs(tmp_path):
    logs, again, exported = (tmp_path / name for name in ("logs", "again", "data"))
    for seed in range(2):
        write_trial(logs, trial_of(seed=seed), [number / 300 for number in range(120)])
    assert "figure4.jsonl: " in run("--figure", 4, "--export", exported, "--out", logs)[1]
    assert (exported / "figure4.jsonl").stat().st_size < 10_000
    drawn = run("--figure", 4, "--draw", "--out", logs)[1]
    redrawn = run("--figure", 4, "--redraw", exported, "--out", again)[1]
    assert "0.397 ± 0.000" in drawn
    assert "No line for people" in drawn
    assert redrawn.replace(str(again), str(logs)) == drawn
    assert {path.name for path in again.iterdir()} == {*PICTURES, *TABLES}
    for name in (*PICTURES, *TABLES):
        assert (again / name).read_bytes() == (logs / name).read_bytes()


def report(**changes):
    score = {"mean": 0.93, "interval": [0.92, 0.94]}
    figures = [
        {"name": "all", "players": 12, "score": None},
        {"name": "protocol", "players": 10, "score": score},
    ]
    return {
        "format": "humanplay-report-1",
        "study": "dunes",
        "synthetic": False,
        "status": "closed",
        "protocol": {"config": EnvConfig().to_dict()},
        "groups": [{"kind": "human", "primary": "protocol", "figures": figures}],
    } | changes


def test_the_human_line_comes_from_a_closed_study(tmp_path):
    path = tmp_path / "report.json"
    path.write_text(json.dumps(report()))
    level = read_human_level(path)
    assert (level.study, level.players, level.mean) == ("dunes", 10, 0.93)
    assert (level.low, level.high) == (0.92, 0.94)


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"status": "open"}, "only a closed study"),
        ({"synthetic": True}, "is of scripts"),
        ({"format": "another"}, "is no report"),
        ({"groups": []}, "nobody has played"),
        (
            {"protocol": {"config": EnvConfig.of("1-1-1", 21).to_dict()}},
            "is of a study on level 1-1-1",
        ),
    ],
)
def test_nothing_else_gives_a_human_line(tmp_path, changes, part):
    path = tmp_path / "report.json"
    path.write_text(json.dumps(report(**changes)))
    with pytest.raises(ValueError, match=part):
        read_human_level(path)
