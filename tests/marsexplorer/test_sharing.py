"""Threads that share a step: they change no result, sleep, end with their stack, and are missed by no forked process."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from marsexplorer.config import EnvConfig
from marsexplorer.vector import MarsExplorerVector
from marsexplorer.world import Worlds

SMALL = EnvConfig.of("random", (6, 9))


def played(num, num_threads, steps=25, pause_s=0.0):
    """Return the codes, rewards and outcomes of a stack after random moves, most of which soon end an episode."""
    worlds, rng, rewards = Worlds(SMALL, num, num_threads), np.random.default_rng(3), []
    worlds.start(np.arange(num))
    for _ in range(steps):
        time.sleep(pause_s)
        rewards.append(worlds.step_autoreset(rng.integers(0, 4, num)).copy())
    worlds.close()
    return worlds.codes, np.array(rewards), worlds.outcomes


def assert_same(one, other):
    for mine, its in zip(one, other, strict=True):
        assert (mine == its).all()


@pytest.mark.parametrize("num_threads", [2, 3])
@pytest.mark.parametrize("num", [1, 3, 1100])
def test_any_number_of_threads_gives_the_same_worlds(num, num_threads):
    assert_same(played(num, 1), played(num, num_threads))


def test_threads_that_sleep_between_steps_wake_for_each():
    assert_same(played(300, 1), played(300, 2, pause_s=0.005))


def test_stacks_in_several_threads_at_once_do_not_meet():
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda _: played(600, 2), range(8)))
    for result in results:
        assert_same(played(600, 1), result)


def test_observations_of_the_state_matrix_are_written_by_all_threads():
    alone, shared = (MarsExplorerVector(500, size=(6, 9), num_threads=count) for count in (1, 2))
    rng = np.random.default_rng(3)
    assert_same(alone.reset(seed=7)[:1], shared.reset(seed=7)[:1])
    for _ in range(10):
        actions = rng.integers(0, 4, 500)
        assert_same(alone.step(actions)[:4], shared.step(actions)[:4])
    shared.close()


def workers():
    return [thread for thread in threading.enumerate() if thread.name == "marsexplorer"]


def test_a_stack_that_is_gone_takes_its_threads_along():
    before = len(workers())
    worlds = Worlds(SMALL, 300, 3)
    assert len(workers()) == before
    worlds.start(np.arange(300))
    worlds.step_autoreset(np.ones(300, np.int64))
    assert len(workers()) == before + 2
    del worlds
    gc.collect()
    assert len(workers()) == before


@pytest.mark.skipif(sys.platform != "linux", reason="reads a thread's CPU time from /proc")
def test_the_other_thread_does_work_and_none_while_nobody_steps():
    worlds = Worlds(SMALL, 4000, 2)
    worlds.start(np.arange(4000))
    actions = np.ones(4000, np.int64)
    worlds.step_autoreset(actions)
    (worker,) = (thread for thread in workers())

    def spent_ns():
        return int(Path(f"/proc/self/task/{worker.native_id}/schedstat").read_text().split()[0])

    began, until = spent_ns(), time.monotonic() + 30
    while spent_ns() < began + 20e6 and time.monotonic() < until:
        worlds.step_autoreset(actions)
    assert spent_ns() > began + 20e6
    time.sleep(0.05)
    began = spent_ns()
    time.sleep(0.3)
    assert spent_ns() < began + 1e6
    worlds.close()


FORKS = """
import os, sys, numpy
from marsexplorer.config import EnvConfig
from marsexplorer.world import Worlds
worlds = Worlds(EnvConfig.of("random", (6, 9)), 500, 2)
worlds.start(numpy.arange(500))
actions = numpy.ones(500, numpy.int64)
worlds.step_autoreset(actions)
child = os.fork()
for action in (2, 1, 0):
    actions[:] = action
    worlds.step_autoreset(actions)
os.write(1, b"%d\\n" % worlds.codes.sum())
if child:
    assert os.waitpid(child, 0)[1] == 0
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
def test_a_forked_process_goes_on_with_its_one_thread():
    command = [sys.executable, "-W", "ignore", "-c", FORKS]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    parent, child = done.stdout.split()
    assert parent == child


FOR_EVER = """
import signal, numpy
signal.signal(signal.SIGINT, signal.default_int_handler)
from marsexplorer.config import EnvConfig
from marsexplorer.world import Worlds
worlds = Worlds(EnvConfig.of("random", (6, 9)), 4000, 2)
worlds.start(numpy.arange(4000))
actions = numpy.ones(4000, numpy.int64)
worlds.step_autoreset(actions)
print("begun", flush=True)
while True:
    worlds.step_autoreset(actions)
"""


def test_ctrl_c_ends_a_process_that_steps_on_several_threads():
    with subprocess.Popen(
        [sys.executable, "-c", FOR_EVER], stdout=-1, stderr=-1, text=True
    ) as process:
        assert process.stdout.readline() == "begun\n"
        time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    assert "KeyboardInterrupt" in errors
    assert process.returncode in (130, -signal.SIGINT)
