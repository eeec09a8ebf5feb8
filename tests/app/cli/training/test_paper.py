"""`marsexplorer paper` as people type it: what it would do, what it refuses, what it draws and exports."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from app.cli.main import main
from app.cli.training.paper_results import read_human_level
from marsexplorer.config import EnvConfig
from marsexplorer.paper.scheduling.schedule import lock
from tests.support.paper_logs import trial_of, write_trial
from tests.support.servers import eventually

ROOT = Path(__file__).parents[4]


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
    code, said, _ = run(
        "--figure", 4, "--budget", "full", "--seeds", 1, "--workers", 2, "--out", out, "--list"
    )
    assert code == 0
    assert "sac-works-random-21-s0" in said
    assert "8 jobs to do in" in said
    assert re.search(r"about \d+ (minutes|hours) on 2 cores", said.replace("\n", " "))
    assert not out.exists()


def test_what_is_done_is_not_counted(run, tmp_path):
    write_trial(tmp_path, trial_of(moves=1000), [0.1, 0.2])
    small = (
        "--figure",
        4,
        "--algorithms",
        "ppo",
        "--variants",
        "paper",
        "--moves",
        1000,
        "--terrains",
        10,
        "--out",
        tmp_path,
    )
    assert "2 jobs to do in" in run(*small, "--list")[1].replace("\n", " ")
    code, said, _ = run(*small, "--seeds", 1, "--list")
    assert (code, "all 1 jobs are done" in said.replace("\n", " ")) == (0, True)


def test_without_tianshou_three_algorithms_are_refused_before_anything_is_trained(
    run, tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules, "tianshou", None)
    code, _, err = run("--figure", 4, "--algorithms", "ppo,sac,a2c", "--out", tmp_path / "out")
    assert (code, err.count("\n")) == (2, 1)
    assert (
        "what trains A2C, in place of A3C, discrete SAC is not installed here: run `make paper`"
        in err
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "code", "part"),
    [
        (
            ("--figure", 4, "--algorithms", "ppo,dqn"),
            2,
            "no algorithm 'dqn'; choose of: a2c, ppo, rainbow, sac",
        ),
        (
            ("--figure", 4, "--algorithms", "ppo", "--variants", "wurks,paper"),
            2,
            "no variant 'wurks'",
        ),
        (("--figure", 4, "--algorithms", "ppo", "--moves", 2000), 2, "was begun with 1,000 moves"),
        (("--figure", 4, "--redraw", "nowhere"), 2, "nowhere holds none of: figure4*.jsonl"),
        (
            ("--figure", 4, "--draw", "--human-level", "nowhere.json"),
            1,
            "nowhere.json: no such file",
        ),
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
    monkeypatch.setattr("marsexplorer.paper.scheduling.schedule.LOCK_PATIENCE_S", 0)
    with lock(tmp_path):
        code, _, err = run("--figure", 4, "--algorithms", "ppo", "--out", tmp_path)
    assert (code, err) == (
        1,
        f"marsexplorer: another run is at work in {tmp_path}; wait for it, or give another --out\n",
    )


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
    assert all(
        (again / name).read_bytes() == (logs / name).read_bytes() for name in (*PICTURES, *TABLES)
    )


def report(**changes):
    score = {"mean": 0.93, "interval": [0.92, 0.94]}
    figures = [
        {"name": "all", "players": 12, "score": None},
        {"name": "protocol", "players": 10, "score": score},
    ]
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
    assert (found.study, found.players, found.mean, found.low, found.high) == (
        "dunes",
        10,
        0.93,
        0.92,
        0.94,
    )


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"status": "open"}, "only a closed study"),
        ({"synthetic": True}, "is of scripts"),
        ({"format": "another"}, "is no report"),
        ({"groups": []}, "nobody has played"),
        (
            {"protocol": {"config": EnvConfig.of("1-1-1", 21).to_dict()}},
            "is of a study on level 1-1-1, 21x21",
        ),
    ],
)
def test_nothing_else_gives_a_human_line(tmp_path, changes, part):
    path = tmp_path / "report.json"
    path.write_text(json.dumps(report(**changes)))
    with pytest.raises(ValueError, match=part):
        read_human_level(path)


def heed_control_c():
    """Undo what a shell does to whatever it starts in the background: there Ctrl-C is ignored, by children as well."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Command:
    """The command in a process of its own, training two seeds of PPO."""

    def __init__(self, out):
        self.out = out
        options = (
            "--algorithms",
            "ppo",
            "--variants",
            "paper",
            "--seeds",
            "2",
            "--moves",
            "8000",
            "--terrains",
            "4",
        )
        self.process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "app.cli",
                "paper",
                "--figure",
                "4",
                *options,
                "--out",
                str(out),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            start_new_session=True,
            preexec_fn=heed_control_c,
        )

    def folders(self):
        return [self.out / f"ppo-paper-random-21-s{seed}" for seed in range(2)]

    def wait_until_training(self):
        eventually(lambda: all(folder.is_dir() for folder in self.folders()), 120)

    def interrupt(self):
        """Press Ctrl-C, which a terminal sends to all processes, and return (code, stdout, stderr)."""
        os.killpg(self.process.pid, signal.SIGINT)
        return self.end()

    def end(self):
        """Return (code, stdout, stderr) of its end."""
        try:
            out, err = self.process.communicate(timeout=300)
        finally:
            if self.process.poll() is None:
                os.killpg(self.process.pid, signal.SIGKILL)
        return self.process.returncode, out, err


def without_time(folder):
    """The lines of the logs and of the table without what a clock says."""
    paths = [*sorted(folder.glob("*/log.jsonl")), folder / "figure4.jsonl"]
    lines = [json.loads(line) for path in paths for line in path.read_text().splitlines()]
    return [
        {name: value for name, value in line.items() if name not in ("cpu_s", "cpu_minutes")}
        for line in lines
    ]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a run that nothing disturbed."""
    folder = tmp_path_factory.mktemp("whole")
    code, out, err = Command(folder).end()
    assert code == 0, err
    assert "2 jobs to do in" in err
    assert "8 k" in out
    return folder


@pytest.mark.long
def test_after_ctrl_c_the_same_command_goes_on_to_the_same_table(whole, tmp_path):
    command = Command(tmp_path)
    command.wait_until_training()
    code, out, err = command.interrupt()
    assert (code, out, "Traceback" in err) == (130, "", False)
    assert (
        f"the jobs are saved in {tmp_path}. The same command goes on: marsexplorer paper --figure 4"
        in err
    )
    assert all((folder / "checkpoint.pt").is_file() for folder in command.folders())
    command = Command(tmp_path)
    assert "2 jobs to do in" in command.process.stderr.readline()
    assert command.interrupt()[0] == 130
    code, _, err = Command(tmp_path).end()
    assert (code, "2 jobs to do in" in err) == (0, True)
    assert without_time(tmp_path) == without_time(whole)
    assert "all 2 jobs are done" in Command(tmp_path).end()[2]


@pytest.mark.long
def test_after_kill_9_the_same_command_goes_on_to_the_same_table(whole, tmp_path):
    command = Command(tmp_path)
    command.wait_until_training()
    command.process.send_signal(signal.SIGKILL)
    command.end()
    with lock(tmp_path, patience_s=120):  # the processes that it had notice, save and end
        assert all((folder / "checkpoint.pt").is_file() for folder in command.folders())
    assert Command(tmp_path).end()[0] == 0
    assert without_time(tmp_path) == without_time(whole)
