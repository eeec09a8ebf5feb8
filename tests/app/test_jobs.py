"""The runner of jobs, with real processes: turns, limits, deaths, failures."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest

from humanplay import jobs as module
from humanplay.jobs import JobError, Jobs, JobsFullError
from tests.support import job_functions as functions
from tests.support.servers import eventually

pytestmark = pytest.mark.timeout(120)


PROCESS = module._Process
"""Taken before the tests' own are put in its place."""


@pytest.fixture(autouse=True)
def real_workers(monkeypatch):
    monkeypatch.setattr(module, "_Process", PROCESS)


@pytest.fixture
def jobs():
    with Jobs(1) as runner:
        yield runner


def runs(process):
    """Whether a process or a thread of it runs; it may be a zombie of somebody else.

    Until the last thread has gone its files are open, and nobody can be told of its end.
    """
    with suppress(OSError), Path(f"/proc/{process}/stat").open() as file:
        is_zombie = file.read().rpartition(") ")[2][0] == "Z"
        return not is_zombie or len([*Path(f"/proc/{process}/task").iterdir()]) > 1
    return False


def test_a_job_returns_raises_and_reports_from_a_process_of_its_own(jobs):
    reports = []
    assert jobs.submit(functions.add, 1, 2).result() == 3
    assert jobs.submit(functions.pid).result() != os.getpid()
    assert jobs.submit(functions.count, 3, on_progress=lambda *at: reports.append(at)).result() == 3
    assert reports == [(1, 3), (2, 3), (3, 3)]
    with pytest.raises(ValueError, match="cannot be done"):
        jobs.submit(functions.fail, Path(os.devnull)).result()
    assert asyncio.run(jobs.run(functions.add, 2, 2)) == 4


def test_an_owner_with_thirty_jobs_does_not_starve_another(jobs):
    order = []
    first = jobs.submit(functions.sleep, 0.5)
    many = [jobs.submit(functions.add, 1, n, owner="many") for n in range(30)]
    one = jobs.submit(functions.add, 1, 1, owner="one")
    for name, futures in (("many", many), ("one", [one])):
        for future in futures:
            future.add_done_callback(lambda _, name=name: order.append(name))
    first.result()
    for future in (*many, one):
        future.result()
    assert order.index("one") <= 1


def test_no_owner_takes_all_workers_and_too_many_that_wait_are_refused():
    with Jobs(2, per_owner=1, most_waiting=2) as jobs:
        slow = jobs.submit(functions.sleep, 600, owner="greedy")
        eventually(slow.running)
        waiting = [jobs.submit(functions.add, 1, n, owner="greedy") for n in range(2)]
        with pytest.raises(JobsFullError, match="ask again in 5 s"):
            jobs.submit(functions.add, 1, 3, owner="greedy")
        assert jobs.submit(functions.add, 1, 1, owner="other").result(60) == 2
        assert not any(future.running() or future.done() for future in waiting)
        assert jobs.waiting() == 2


def test_a_job_that_takes_too_long_is_ended_with_what_it_began_and_the_next_one_runs(
    jobs, tmp_path
):
    began = tmp_path / "pid"
    late = jobs.submit(functions.begin_another, began, limit_s=3)
    with pytest.raises(JobError, match="took longer than 3 s"):
        late.result(60)
    eventually(lambda: not runs(int(began.read_text())))
    assert jobs.submit(functions.add, 1, 2).result() == 3


def test_a_failure_is_remembered_and_equal_jobs_are_one(jobs, tmp_path):
    tried = tmp_path / "tried"
    for _ in range(3):
        with pytest.raises(ValueError, match="cannot be done"):
            jobs.submit(functions.fail, tried, key="a").result()
    assert tried.read_text() == "tried\n"
    with pytest.raises(ValueError, match="cannot be done"):
        jobs.submit(functions.fail, tried, key="b").result()
    assert tried.read_text() == "tried\ntried\n"
    slow = jobs.submit(functions.sleep, 0.2, key="c")
    assert jobs.submit(functions.sleep, 0.2, key="c") is slow
    slow.result()
    assert jobs.submit(functions.add, 1, 2, key="c").result() == 3, "what was done is not kept"


def test_a_worker_that_dies_fails_its_own_job_alone():
    with Jobs(2) as jobs:
        other = jobs.submit(functions.sleep, 1)
        killed = jobs.submit(functions.die)
        after = [jobs.submit(functions.add, 1, n) for n in range(3)]
        with pytest.raises(JobError, match=r"ended early, with code -9; ask again$"):
            killed.result()
        with pytest.raises(JobError, match=r"with code -9; ask again in 10 minutes$"):
            jobs.submit(functions.die, key="remembered").result()
        assert other.result() == "slept"
        assert [future.result() for future in after] == [1, 2, 3]
        idle = jobs.submit(functions.pid).result()
        os.kill(idle, signal.SIGKILL)
        eventually(lambda: not runs(idle))
        assert jobs.submit(functions.add, 1, 2).result() == 3


def test_closing_ends_what_runs_and_what_waits_at_once():
    jobs = Jobs(1)
    worker = jobs.submit(functions.pid).result()
    running, waiting = jobs.submit(functions.sleep, 600), jobs.submit(functions.sleep, 600)
    eventually(running.running)
    began = time.monotonic()
    jobs.close()
    assert time.monotonic() - began < 10
    for future in (running, waiting):
        with pytest.raises(JobError, match="closed before this was done"):
            future.result(0)
    assert not runs(worker)
    with pytest.raises(JobsFullError, match="closing"):
        jobs.submit(functions.add, 1, 2)
    assert not [thread for thread in threading.enumerate() if thread.name == "jobs"]


COMMAND = """
import sys
from humanplay.jobs import Jobs
from tests.support import job_functions as functions
with Jobs(1) as jobs:
    print(jobs.submit(functions.pid).result(), flush=True)
    jobs.submit(functions.sleep, 600).result()
"""


@pytest.mark.parametrize("ends", [signal.SIGINT, signal.SIGKILL])
def test_ctrl_c_and_a_kill_of_the_runner_end_its_workers(ends):
    command = subprocess.Popen(
        [sys.executable, "-c", COMMAND], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    worker = int(command.stdout.readline())
    time.sleep(
        0.5
    )  # until it waits: Python loses a signal that comes in the moment before a lock is waited for
    os.killpg(command.pid, ends)  # as a terminal does
    _, stderr = command.communicate(timeout=60)
    eventually(lambda: not runs(worker))
    assert stderr.count("Traceback") == (ends == signal.SIGINT), "the worker says nothing"


def test_a_job_that_comes_as_its_worker_stops_waiting_is_done(monkeypatch):
    monkeypatch.setattr("humanplay.jobs.IDLE_S", 0)
    with Jobs(1) as jobs:
        assert jobs.submit(functions.add, 1, 2).result(timeout=30) == 3


def test_idle_workers_end(monkeypatch):
    monkeypatch.setattr("humanplay.jobs.IDLE_S", 0.2)
    with Jobs(1) as jobs:
        worker = jobs.submit(functions.pid).result()
        eventually(lambda: not runs(worker))
        assert jobs.submit(functions.pid).result() != worker
