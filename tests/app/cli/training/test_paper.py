"""`marsexplorer paper` as people type it: what it would do, what it refuses, what it draws and exports."""

import json

import pytest

from app.cli.main import main
from app.cli.training.paper_results import read_human_level
from marsexplorer.config import EnvConfig
from marsexplorer.paper.schedule import lock
from tests.support.paper_logs import trial_of, write_trial


@pytest.fixture
def run(capsys):
    """`run("--figure", 4, ...)` -> (exit code, stdout, stderr)."""

    def call(*args):
        with pytest.raises(SystemExit) as left:
            main(["paper", *map(str, args)])
        said = capsys.readouterr()
        return left.value.code, said.out, said.err

    return call


def test_the_list_names_each_job_and_does_nothing(run, tmp_path):
    out = tmp_path / "out"
    code, said, _ = run("--figure", 4, "--budget", "full", "--seeds", 1, "--workers", 2, "--out", out, "--list")
    assert code == 0
    assert "sac-works-random-21-s0" in said
    assert "8 jobs to do in" in said
    assert "hours on 2 cores" in said
    assert not out.exists()


def test_what_is_done_is_not_counted(run, tmp_path):
    write_trial(tmp_path, trial_of(moves=1000), [0.1, 0.2])
    small = ("--figure", 4, "--algorithms", "ppo", "--variants", "paper", "--moves", 1000, "--terrains", 10, "--out", tmp_path)
    assert "2 jobs to do in" in run(*small, "--list")[1].replace("\n", " ")
    code, said, _ = run(*small, "--seeds", 1, "--list")
    assert (code, "all 1 jobs are done" in said.replace("\n", " ")) == (0, True)


@pytest.mark.parametrize(
    ("options", "code", "part"),
    [
        (("--figure", 4, "--algorithms", "ppo,dqn"), 2, "no algorithm 'dqn'; choose of: a2c, ppo, rainbow, sac"),
        (("--figure", 4, "--algorithms", "ppo", "--variants", "wurks,paper"), 2, "no variant 'wurks'"),
        (("--figure", 4, "--algorithms", "ppo", "--moves", 2000), 2, "was begun with 1,000 moves"),
        (("--figure", 4, "--redraw", "nowhere"), 2, "nowhere holds none of: figure4*.jsonl"),
        (("--figure", 4, "--draw", "--human-level", "nowhere.json"), 1, "nowhere.json: no such file"),
        (("--figure", 3), 2, "'3' is not one of"),
    ],
)
def test_a_mistake_is_one_sentence(run, tmp_path, options, code, part):
    write_trial(tmp_path, trial_of(moves=1000), [0.1, 0.2])
    found, out, err = run(*options, "--out", tmp_path)
    assert (found, out) == (code, "")
    assert part in err
    assert err.count("\n") == 1


def test_two_runs_in_a_folder_are_refused(run, tmp_path, monkeypatch):
    monkeypatch.setattr("marsexplorer.paper.schedule.LOCK_PATIENCE_S", 0)
    with lock(tmp_path):
        code, _, err = run("--figure", 4, "--algorithms", "ppo", "--out", tmp_path)
    assert (code, err) == (1, f"marsexplorer: another run is at work in {tmp_path}; wait for it, or give another --out\n")


PICTURES = ("figure4-moves.png", "figure4-cpu.png", "figure4-endings.png")
TABLES = ("figure4.csv", "figure4.jsonl")


@pytest.fixture
def exported(run, tmp_path):
    """The folder of an export of two trainings whose logs are in tmp_path / "logs"."""
    for seed in range(2):
        write_trial(tmp_path / "logs", trial_of(seed=seed), [number / 300 for number in range(120)])
    code, said, _ = run("--figure", 4, "--export", tmp_path / "data", "--out", tmp_path / "logs")
    assert (code, "figure4.jsonl: " in said.replace("\n", "")) == (0, True)
    return tmp_path / "data"


def test_pictures_and_tables_are_drawn_from_an_export(run, exported, tmp_path):
    assert (exported / "figure4.jsonl").stat().st_size < 10_000
    code, said, _ = run("--figure", 4, "--redraw", exported, "--out", tmp_path / "again")
    assert code == 0
    assert "0.397 ± 0.000" in said
    assert "No line for people" in said
    assert {path.name for path in (tmp_path / "again").iterdir()} == {*PICTURES, *TABLES}


@pytest.mark.long
def test_from_an_export_comes_what_comes_from_the_logs(run, exported, tmp_path):
    logs, again = tmp_path / "logs", tmp_path / "again"
    drawn = run("--figure", 4, "--draw", "--out", logs)[1]
    redrawn = run("--figure", 4, "--redraw", exported, "--out", again)[1]
    assert redrawn.replace(str(again), str(logs)) == drawn
    assert all((again / name).read_bytes() == (logs / name).read_bytes() for name in (*PICTURES, *TABLES))


def report(**changes):
    score = {"mean": 0.93, "interval": [0.92, 0.94]}
    figures = [{"name": "all", "players": 12, "score": None}, {"name": "protocol", "players": 10, "score": score}]
    group = {"kind": "human", "primary": "protocol", "figures": figures}
    protocol = {"config": EnvConfig().to_dict()}
    return {
        "format": "marsexplorer-report-1",
        "study": "dunes",
        "synthetic": False,
        "status": "closed",
        "protocol": protocol,
        "groups": [group],
    } | changes


def test_the_human_line_comes_from_a_closed_study(tmp_path):
    path = tmp_path / "report.json"
    path.write_text(json.dumps(report()))
    found = read_human_level(path)
    assert (found.study, found.players, found.mean, found.low, found.high) == ("dunes", 10, 0.93, 0.92, 0.94)


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"status": "open"}, "only a closed study"),
        ({"synthetic": True}, "is of scripts"),
        ({"format": "another"}, "is no report"),
        ({"groups": []}, "nobody has played"),
        ({"protocol": {"config": EnvConfig.of("1-1-1", 21).to_dict()}}, "is of a study on level 1-1-1, 21x21"),
    ],
)
def test_nothing_else_gives_a_human_line(tmp_path, changes, part):
    path = tmp_path / "report.json"
    path.write_text(json.dumps(report(**changes)))
    with pytest.raises(ValueError, match=part):
        read_human_level(path)
