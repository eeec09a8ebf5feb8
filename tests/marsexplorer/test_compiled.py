"""Compiling takes long once: it is said once, and nothing is left to compile."""

import os
import subprocess
import sys

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
    """Return what a process that makes the environment by its module and id writes to stderr until its first steps."""
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


@pytest.mark.long
def test_a_cold_start_says_it_once_and_leaves_nothing_to_compile(tmp_path):
    said = [first_step(NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2)]
    assert said[0].count("compiling the rules") == 1
    assert len(said[0].splitlines()) == 1
    assert said[1] == ""


def test_compiling_for_long_is_said_once(capsys, monkeypatch):
    monkeypatch.setattr(compiled, "NOTICE_AFTER_S", 0.01)
    notice = compiled.CompilationNotice()
    for _ in range(2):
        for _ in range(2):  # one compilation inside another
            notice.on_start(None)
        notice._timer.join()
        for _ in range(2):
            notice.on_end(None)
    assert capsys.readouterr().err.splitlines() == [compiled.NOTICE]
