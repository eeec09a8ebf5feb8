"""Compiling takes long once: it is said once, and nothing is left to compile."""

import fcntl
import os
import subprocess
import sys
from contextlib import contextmanager
from functools import partial

import pytest

from marsexplorer import compiled

FIRST_STEP = """
import sys
import gymnasium
assert "marsexplorer" not in sys.modules
env = gymnasium.make("marsexplorer:MarsExplorer-v0", size=(9, 14))
observation, info = env.reset(seed=3)
env.step(1)
envs = gymnasium.make_vec("marsexplorer:MarsExplorer-v0", 2, "vector_entry_point", size=(9, 14))
observations, _ = envs.reset(seed=3)
assert observation.shape == (9, 14) and observations.shape == (2, 9, 14)
assert (observation == observations[0]).all()
"""


def first_step(**env):
    """What a process that makes the environment writes to stderr up to its first step."""
    command = [sys.executable, "-W", "error", "-c", FIRST_STEP]
    return subprocess.run(
        command, env=os.environ | env, capture_output=True, text=True, check=True
    ).stderr


@pytest.mark.timeout(120)
def test_a_cold_start_says_that_it_compiles_and_a_warm_one_says_nothing(tmp_path):
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-W", "error", "-c", FIRST_STEP]
    with subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True) as cold:
        assert "compiling the rules" in cold.stderr.readline()
        cold.kill()
    # The first one fills the cache of this checkout, where it is empty.
    assert not first_step() or not first_step()


@pytest.mark.timeout(240)
def test_nothing_is_left_to_compile_once_every_kernel_has_been_called():
    command = [sys.executable, "-W", "error", "-m", "marsexplorer.warmup"]
    run = partial(subprocess.run, command, capture_output=True, text=True, check=True)
    assert run().stderr in ("", f"{compiled.NOTICE}\n")  # it fills the cache of this checkout
    assert run().stderr == ""


@pytest.mark.long
def test_a_cold_start_says_it_once_and_leaves_nothing_to_compile(tmp_path):
    printed = [first_step(NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2)]
    assert printed[0].count("compiling the rules") == 1
    assert len(printed[0].splitlines()) == 1
    assert printed[1] == ""


DOUBLED = """
import numpy as np
from marsexplorer.compiled import kernel

@kernel
def double(number):
    return 2 * number

if __name__ == "__main__":
    import doubled, sys
    print("calls", flush=True)
    assert doubled.double(np.dtype(sys.argv[1]).type(3)) == 6
"""


@contextmanager
def doubling(folder, kind):
    """A process that calls a kernel of a module in the folder, for one type of number."""
    env = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(folder)}
    command = [sys.executable, "-W", "error", folder / "doubled.py", kind]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=env, **pipes) as process:
        assert process.stdout.readline() == "calls\n"
        yield process


def test_a_process_compiles_when_no_other_does_and_both_find_what_either_has_compiled(tmp_path):
    (tmp_path / "doubled.py").write_text(DOUBLED)
    with doubling(tmp_path, "int64") as first:
        assert compiled.NOTICE in first.communicate()[1]
    (lock,) = (tmp_path / "cache").rglob("compiling.lock")
    with doubling(tmp_path, "float64") as second:
        with lock.open() as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            with doubling(tmp_path, "int64") as warm:
                assert warm.communicate()[1] == "", "what is compiled waits for nobody"
            assert second.poll() is None
        assert compiled.NOTICE in second.communicate()[1]
    for kind in ("int64", "float64"):
        with doubling(tmp_path, kind) as warm:
            assert warm.communicate()[1] == ""


def test_no_garbage_is_looked_for_while_a_kernel_compiles_and_afterwards_it_is(tmp_path):
    code = """
import gc
from marsexplorer.compiled import compiling
depths = []
gc.callbacks.append(lambda phase, info: depths.append(compiling._depth))
import marsexplorer.warmup
marsexplorer.warmup.step_once()
print(len(depths) > 0, max(depths), gc.isenabled())
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
        check=True,
        capture_output=True,
        text=True,
    )
    assert done.stdout.split() == ["True", "0", "True"]
