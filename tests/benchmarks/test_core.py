"""How fast the rules are, and how often a drawn terrain counts. Absolute figures are printed; only ratios of one run gate."""

import time

import gymnasium
import numpy as np
import pytest

import marsexplorer  # noqa: F401  # registers the environment
from marsexplorer.compiled import kernel
from marsexplorer.config import LEVELS, EnvConfig
from marsexplorer.terrain import attempts
from marsexplorer.world import Worlds

pytestmark = pytest.mark.bench


@kernel
def random_valid(codes, places, actions, state):
    """Fill actions with one valid move a world, from a xorshift generator; codes uint8[num, rows, cols]."""
    rows, cols = codes.shape[1], codes.shape[2]
    for i in range(actions.shape[0]):
        row, col = np.int64(places[i] >> np.uint64(32)), np.int64(places[i] & np.uint64(0xFFFFFFFF))
        x = state[0]
        x ^= x << np.uint64(13)
        x ^= x >> np.uint64(7)
        x ^= x << np.uint64(17)
        state[0] = x
        first = np.int64(x >> np.uint64(62))
        for k in range(4):
            a = (first + k) & 3
            r, c = row + (a == 2) - (a == 0), col + (a == 1) - (a == 3)
            if 0 <= r < rows and 0 <= c < cols and codes[i, r, c] != 3:
                actions[i] = a
                break


def nanoseconds_a_step(config, num, rounds, blind=False):
    """CPU nanoseconds of one world's step in a stack, autoreset and observation codes included, choice of moves excluded."""
    worlds, actions = Worlds(config, num), np.zeros(num, np.int64)
    state = np.array([88172645463325252], np.uint64)
    rng = np.random.default_rng(0)
    worlds.start(np.arange(num))
    spent = 0.0
    for number in range(rounds + rounds // 10):
        if blind:
            actions[:] = rng.integers(0, 4, num)
        else:
            random_valid(worlds.codes, np.ascontiguousarray(worlds.scalars[:, 0]), actions, state)
        began = time.process_time()
        worlds.step_on(actions)
        if number >= rounds // 10:
            spent += time.process_time() - began
    return spent / rounds / num * 1e9


def test_steps_per_cpu_second():
    print("\n\n| worlds | size | moves | million steps per CPU second |\n|---|---|---|---|")
    for num, size, rounds in ((1024, 21, 1500), (64, 21, 8000), (1024, 42, 1000), (1024, 84, 600)):
        rate = 1e3 / nanoseconds_a_step(EnvConfig.of("random", size), num, rounds)
        print(f"| {num:,} | {size}x{size} | random valid | {rate:.1f} |")
    blind = nanoseconds_a_step(EnvConfig(), 1024, 500, blind=True)
    print(f"| 1,024 | 21x21 | blind random (ends after about 4) | {1e3 / blind:.1f} |")


def test_a_step_at_84_costs_at_most_half_more_than_at_21():
    fresh = {size: min(nanoseconds_a_step(EnvConfig.of("random", size), 1024, 300) for _ in range(3)) for size in (21, 84)}
    print(f"\n84x84 over 21x21: {fresh[84] / fresh[21]:.2f}")
    assert fresh[84] <= 1.5 * fresh[21]


def test_one_world_and_gymnasium():
    worlds, actions = Worlds(EnvConfig()), np.zeros(1, np.int64)
    worlds.start([1])
    began, count = time.process_time(), 0
    for _ in range(20_000):
        for move in (1, 3):
            actions[0] = move
            worlds.step_on(actions)
            count += 1
    alone = count / (time.process_time() - began)
    env = gymnasium.make("MarsExplorer-v0", observation="uint8")
    open_field = {"terrain": np.zeros((21, 21), bool)}
    env.reset(options=open_field)
    began = time.process_time()
    for number in range(40_000):
        if number % 400 == 0:
            env.reset(options=open_field)
        env.step(1 if number % 2 == 0 else 3)
    made = 40_000 / (time.process_time() - began)
    print(f"\none world: {alone / 1e6:.2f} M steps per CPU second; through gymnasium.make: {made:,.0f}")


def test_memory_of_a_world():
    small = Worlds(EnvConfig(), 1000)
    assert small.scalars.base.nbytes / 1000 < 1500
    print(f"\nmemory of a world at 21x21: {small.scalars.base.nbytes / 1000:.0f} bytes without its observation")


def test_acceptance_of_draws():
    print("\n\n| level | 21x21 | 42x42 | 84x84 |\n|---|---|---|---|")
    for name in (name for name in LEVELS if not name.endswith("-2")):
        rates = []
        for size, seeds in ((21, 1000), (42, 400), (84, 150)):
            config = EnvConfig.of(name, size)
            rates.append(seeds / sum(attempts(config, seed) for seed in range(seeds)))
        print(f"| {name} | " + " | ".join(f"{100 * rate:.0f} %" for rate in rates) + " |")
