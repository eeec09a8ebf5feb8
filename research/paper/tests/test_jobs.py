"""Jobs run in processes: a failure leaves the others, and a killed run no process."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from research.paper.jobs import ERROR_FILE, BusyError, lock, run_jobs
from research.paper.tests import test_jobs  # processes find the jobs' class by this name

ROOT = Path(__file__).parents[3]


@dataclass(frozen=True)
class Counting:
    """Writes its result after some hundredths of a second; trouble: "fails" or "dies"."""

    name: str
    steps: int = 5
    trouble: str = ""

    def is_done(self, folder):
        return (folder / self.name / "result").is_file()

    def run(self, folder, on_progress):
        (folder / self.name).mkdir(parents=True, exist_ok=True)
        (folder / self.name / "pid").write_text(str(os.getpid()))
        if self.trouble == "fails":
            raise ValueError("this job fails\nand says more")
        if self.trouble == "dies":
            os.kill(os.getpid(), signal.SIGKILL)
        for step in range(self.steps):
            time.sleep(0.01)
            on_progress((step + 1) / self.steps)
        (folder / self.name / "result").write_text(os.environ["OMP_NUM_THREADS"])


def test_a_job_that_fails_or_dies_leaves_the_others_running_and_what_is_done_stays_done(tmp_path):
    jobs = [
        test_jobs.Counting("bad", trouble="fails"),
        test_jobs.Counting("killed", trouble="dies"),
        test_jobs.Counting("good"),
    ]
    done = []
    failures = run_jobs(jobs, tmp_path, 2, lambda *each: done.append(each))
    assert failures == {
        "bad": "ValueError: this job fails",
        "killed": "its process ended with code -9",
    }
    assert "and says more" in (tmp_path / "bad" / ERROR_FILE).read_text()
    assert ((tmp_path / "good" / "result").read_text(), done[-1]) == ("1", (100, 300))
    assert run_jobs(jobs[2:], tmp_path, 2, lambda *each: pytest.fail("nothing was to do")) == {}


def is_alive(pid):
    try:
        return "zombie" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


PROGRAM = """
import sys
from pathlib import Path
from research.paper.jobs import run_jobs
from research.paper.tests.test_jobs import Counting
if __name__ == "__main__":
    run_jobs([Counting("one", 10**6)], Path(sys.argv[1]), 1, lambda done, total: None)
"""


def test_when_the_run_is_killed_its_processes_end_and_the_folder_is_free(tmp_path):
    program, folder = tmp_path / "program.py", tmp_path / "out"
    program.write_text(PROGRAM)
    env = os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'app'}"}
    run = subprocess.Popen([sys.executable, program, folder], env=env, start_new_session=True)
    pid, deadline = folder / "one" / "pid", time.monotonic() + 60
    while not (pid.is_file() and pid.read_text()) and time.monotonic() < deadline:
        time.sleep(0.05)
    with pytest.raises(BusyError, match="another run is at work in"), lock(folder):
        pass
    run.send_signal(signal.SIGKILL)
    run.wait()
    while is_alive(pid.read_text()) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not is_alive(pid.read_text())
    with lock(folder):
        assert not (folder / "one" / "result").exists()
