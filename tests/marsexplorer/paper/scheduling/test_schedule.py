"""Jobs in processes: all at once, stopped and gone on with, killed, failing; and one run in a folder at a time."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from marsexplorer.paper.scheduling.forecast import Course, Forecast, duration
from marsexplorer.paper.scheduling.schedule import BusyError, Failure, Schedule, lock
from tests.support.paper_jobs import Counting
from tests.support.servers import eventually

ROOT = Path(__file__).parents[4]
FOREVER = 100_000


def run(jobs, folder, on_change=None, workers=2):
    with lock(folder) as descriptor:
        schedule = Schedule(jobs, folder, workers, on_change)
        return schedule.run(descriptor), schedule.forecast


def numbers(folder, job, file="result"):
    return [int(word) for word in (folder / job.name / file).read_text().split()]


def test_a_job_that_fails_or_whose_process_dies_leaves_the_others_running(tmp_path):
    jobs = [Counting("bad", trouble="fails"), Counting("killed", trouble="dies"), Counting("good")]
    failures, forecast = run(jobs, tmp_path)
    assert failures == [Failure("bad", "ValueError: this job fails")]
    assert "and says more" in (tmp_path / "bad" / "error.txt").read_text()
    assert [numbers(tmp_path, job) for job in jobs[1:]] == [list(range(20))] * 2
    assert (forecast.done, forecast.cpu_left) == (2, 0)


def test_ctrl_c_saves_every_job_and_the_next_run_goes_on(tmp_path):
    jobs = [Counting("one", FOREVER), Counting("two", FOREVER), Counting("three", FOREVER)]

    def interrupt(forecast):
        if sum(course.share > 0 for course in forecast.courses.values()) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(jobs, tmp_path, interrupt)
    saved = numbers(tmp_path, jobs[0], "state")
    assert saved == list(range(len(saved)))
    assert not (tmp_path / "three").exists()
    shorter = [Counting("one", len(saved) + 5), Counting("three", 5)]
    assert run(shorter, tmp_path)[0] == []
    assert numbers(tmp_path, shorter[0]) == list(range(len(saved) + 5))
    assert run(shorter, tmp_path, lambda forecast: pytest.fail("nothing was to do"))[0] == []


PROGRAM = """
import sys
from pathlib import Path
from tests.marsexplorer.paper.scheduling.test_schedule import FOREVER, Counting, run
if __name__ == "__main__":
    run([Counting("one", FOREVER), Counting("two", FOREVER)], Path(sys.argv[1]))
"""


def test_when_the_run_is_killed_its_processes_save_and_free_the_folder(tmp_path):
    program, folder = tmp_path / "program.py", tmp_path / "out"
    program.write_text(PROGRAM)
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen([sys.executable, program, folder], env=env, start_new_session=True)
    eventually(lambda: (folder / "one").is_dir() and (folder / "two").is_dir())
    with pytest.raises(BusyError, match="another run is at work in"), lock(folder, patience_s=0):
        pass
    process.send_signal(signal.SIGKILL)
    process.wait()
    with lock(folder, patience_s=60):
        assert all(numbers(folder, Counting(name), "state") for name in ("one", "two"))


def test_the_forecast_follows_what_is_measured():
    forecast = Forecast(2, {name: Course("a", 1000.0, before=0.0) for name in "pqrs"})
    assert (forecast.cpu_left, forecast.seconds_left) == (4000, 2000)
    for name in "pq":
        forecast.report(name, 1.0, 3000.0, 3000.0)
        forecast.end(name, is_done=True)
    assert forecast.done == 2
    assert forecast.cpu_left == pytest.approx(6000, rel=0.03)
    assert forecast.seconds_left == pytest.approx(3000, rel=0.03)
    forecast.report("r", 0.5, 1500.0, 3000.0)
    assert forecast.cpu_left == pytest.approx(4500, rel=0.03)


def test_a_job_that_goes_on_is_not_taken_for_a_fast_one():
    forecast = Forecast(1, {"p": Course("a", 1000.0), "q": Course("a", 1000.0, before=0.0)})
    forecast.report("p", 0.9, 1.0, 1.0)
    forecast.report("p", 1.0, 100.0, 100.0)
    assert forecast.cpu_left == pytest.approx(1000, rel=0.03)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0, "1 second"),
        (7.4, "7 seconds"),
        (44, "40 seconds"),
        (100, "2 minutes"),
        (1560, "26 minutes"),
        (26640, "7.4 hours"),
    ],
)
def test_durations_are_in_words(seconds, words):
    assert duration(seconds) == words
