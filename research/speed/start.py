"""From the first import to the first step, in a new process: cold and warm.

Cold: with nothing compiled.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

from research.speed.figures import Figure

FIRST_STEP = """
import time
began = time.perf_counter()
import gymnasium
import marsexplorer
env = gymnasium.make("MarsExplorer-v0")
env.reset(seed=0)
env.step(1)
print(time.process_time(), time.perf_counter() - began)
"""
FIRST_STACK = """
import time
began = time.perf_counter()
import gymnasium, numpy
import marsexplorer
envs = gymnasium.make_vec(
    "MarsExplorer-v0", 1024, observation="uint8", autoreset_mode="SameStep"
)
envs.reset(seed=0)
envs.step(numpy.ones(1024, int))
print(time.process_time(), time.perf_counter() - began)
"""
COLD_S, WARM_S = 8.0, 1.0
"""CPU seconds at most, cold and warm, interpreter included."""


def seconds(code: str, cache: str, python: str = sys.executable) -> tuple[float, float]:
    """(CPU, wall) seconds of a fresh process with the cache folder `cache`."""
    env = os.environ | {"NUMBA_CACHE_DIR": cache, "PYTHONWARNINGS": "ignore"}
    done = subprocess.run([python, "-c", code], env=env, capture_output=True, text=True, check=True)
    worked, wall = done.stdout.split()
    return float(worked), float(wall)


def first_steps(quick: bool = False) -> list[Figure]:
    """CPU seconds from the interpreter's start to a first step, cold and warm.

    One environment, and a stack of 1,024.

    Warm is the median of three.
    """
    figures = []
    for name, code in (("gymnasium.make", FIRST_STEP), ("make_vec, 1,024", FIRST_STACK)):
        with tempfile.TemporaryDirectory() as cache:
            cold = seconds(code, cache)
            warm = sorted(seconds(code, cache) for _ in range(1 if quick else 3))
        timings = (("cold", COLD_S, cold), ("warm", WARM_S, warm[len(warm) // 2]))
        for state, target, (worked, wall) in timings:
            label, note = f"import to first step, {name}, {state}", f"{wall:.2f} s by the clock"
            figure = Figure("start", label, worked, "CPU s", target=target, at_most=True, note=note)
            figures.append(figure)
    return figures
