"""Steps per CPU second of the core: alone, through Gymnasium, on two threads.

Moves are recorded first and played back under the clock, so choosing them costs nothing: the same
seeds and the same moves give the same episodes. Every rate is the median of several repeats, each
after a tenth of its rounds to warm up. CPU time counts, so that a busy machine matters little; only
the comparison of threads needs the wall clock, and an idle machine.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from humanplay.jobs import cores
from marsexplorer.compiled import kernel
from marsexplorer.config import EnvConfig
from marsexplorer.observation import is_valid
from marsexplorer.world import Worlds
from research.speed.figures import Figure

RATE = "steps/CPU s"
SIZES = (21, 42, 84)
STACKS = (1, 64, 1024, 8192)
TARGETS = {(1, 21): 1e6, (1024, 21): 12e6}
"""(worlds, side) -> steps per CPU second that are wanted."""

STEPS = 4_000_000
"""Moves of one repeat, about a third of a second at full speed."""

ROUNDS = 450
"""Fewest moves of each world in a repeat: an episode of random moves at 21x21, for its beginning
costs more than its end.
"""


@kernel
def choose(codes, places, actions, state):  # type: ignore[no-untyped-def]  # numba infers it
    """Fill actions with one valid move a world, from a xorshift generator.

    codes    uint8[num, rows, cols]
    places   uint64[num], row and col in 32 bits each
    actions  int64[num]
    state    uint64[1], of the generator
    """
    for i in range(actions.shape[0]):
        row, col = np.int64(places[i] >> np.uint64(32)), np.int64(places[i] & np.uint64(0xFFFFFFFF))
        number = state[0]
        number ^= number << np.uint64(13)
        number ^= number >> np.uint64(7)
        number ^= number << np.uint64(17)
        state[0] = number
        first = np.int64(number >> np.uint64(62))
        for k in range(4):
            a = (first + k) & 3
            if is_valid(codes[i], row, col, a):  # type: ignore[no-untyped-call]
                actions[i] = a
                break


def started(config: EnvConfig, num: int) -> Worlds:
    """Return a stack on seeds 0, 1, ..."""
    worlds = Worlds(config, num)
    worlds.start(np.arange(num))
    worlds.last_codes.fill(0)  # its pages are touched before any clock runs
    return worlds


def moves_of(config: EnvConfig, num: int, rounds: int, blind: bool = False) -> NDArray[np.int64]:
    """Random moves for a stack on seeds 0, 1, ...: int64[rounds, num].

    Valid ones unless `blind`.
    """
    if blind:
        return np.random.default_rng(0).integers(0, 4, (rounds, num))
    worlds, moves = started(config, num), np.zeros((rounds, num), np.int64)
    state = np.array([88172645463325252], np.uint64)
    for row in moves:
        choose(worlds.codes, np.ascontiguousarray(worlds.scalars[:, 0]), row, state)  # type: ignore[no-untyped-call]
        worlds.step_autoreset(row)
    return moves


def play(worlds: Worlds, moves: NDArray[np.int64]) -> None:
    """Make the moves, one Python call a round."""
    step = worlds.step_autoreset
    for row in moves:
        step(row)


def steps_per_cpu_second(
    config: EnvConfig, num: int, steps: int = STEPS, blind: bool = False, repeats: int = 3
) -> float:
    """The rate of a stack with reset, terrain and observation codes included.

    steps  moves a repeat in all
    """
    rounds = max(ROUNDS, min(steps // num, 200_000))
    moves = moves_of(config, num, rounds, blind)
    warm, rates = rounds // 10, []
    for _ in range(repeats):
        worlds = started(config, num)
        play(worlds, moves[:warm])
        began = time.process_time()
        play(worlds, moves[warm:])
        rates.append((rounds - warm) * num / (time.process_time() - began))
    return median(rates)


def replay(env: Any, moves: Sequence[int]) -> int:
    """Make moves recorded for one world in an environment from seed 0; count them."""
    env.reset(seed=0)
    for move in moves:
        _, _, terminated, truncated, _ = env.step(move)
        if terminated or truncated:
            env.reset()
    return len(moves)


def gymnasium_rate(observation: str, steps: int = 100_000, repeats: int = 3) -> float:
    """Steps per CPU second through gymnasium.make at 21x21, resets included.

    Random valid moves.
    """
    import gymnasium

    moves = moves_of(EnvConfig(), 1, steps)[:, 0].tolist()
    rates = []
    for _ in range(repeats):
        env = gymnasium.make("MarsExplorer-v0", observation=observation)
        began = time.process_time()
        replay(env, moves)
        rates.append(steps / (time.process_time() - began))
    return median(rates)


def vector_share(
    num: int = 1024, blind: bool = False, rounds: int = ROUNDS, repeats: int = 5
) -> tuple[float, float]:
    """Steps per CPU second through gymnasium.make_vec, and the share of the stack's.

    uint8 codes; the bare stack is measured in the same run.

    Both make the same moves in turn, 21x21.
    """
    import gymnasium

    moves, worlds = moves_of(EnvConfig(), num, rounds, blind), started(EnvConfig(), num)
    shares, rates = [], []
    envs = gymnasium.make_vec(
        "MarsExplorer-v0", num, observation="uint8", autoreset_mode="SameStep"
    )
    for _ in range(repeats):
        worlds.start(np.arange(num))
        began = time.process_time()
        play(worlds, moves)
        alone = time.process_time() - began
        envs.reset(seed=0)
        began = time.process_time()
        for row in moves:
            envs.step(row)
        spent = time.process_time() - began
        rates.append(moves.size / spent)
        shares.append(alone / spent)
    return median(rates), median(shares)


def threads_ratio(num: int = 8192, rounds: int = 150, repeats: int = 7) -> tuple[float, float]:
    """The work of two threads over that of one, and one thread's share of a core.

    Each thread has worlds of its own. The second number is 1 on an idle machine; well below, the
    first says little.
    """
    moves = moves_of(EnvConfig(), num, rounds)
    stacks = [started(EnvConfig(), num) for _ in range(2)]
    ratios, shares = [], []
    for _ in range(repeats):
        for worlds in stacks:
            worlds.start(np.arange(num))
        began, worked = time.perf_counter(), time.process_time()
        play(stacks[0], moves)
        alone = time.perf_counter() - began
        shares.append((time.process_time() - worked) / alone)
        stacks[0].start(np.arange(num))
        threads = [threading.Thread(target=play, args=(worlds, moves)) for worlds in stacks]
        began = time.perf_counter()
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        ratios.append(2 * alone / (time.perf_counter() - began))
    return median(ratios), median(shares)


def bytes_of_a_world(config: EnvConfig) -> float:
    """Return the memory that a world takes without its observation, in bytes."""
    base = Worlds(config, 100).scalars.base
    assert base is not None
    return base.nbytes / 100


def stack(num: int, side: int, steps: int, repeats: int) -> Figure:
    """Return the rate of `num` worlds of level random, `side` cells a side."""
    rate = steps_per_cpu_second(EnvConfig.of("random", side), num, steps, repeats=repeats)
    return Figure("core", f"{num:,}", rate, RATE, f"{side}x{side}", TARGETS.get((num, side)))


def blind(steps: int, repeats: int) -> Figure:
    """Return the rate of blind random moves."""
    rate = steps_per_cpu_second(EnvConfig(), 1024, steps, blind=True, repeats=repeats)
    note = "an episode ends after about four moves"
    return Figure("core", "1,024, blind moves", rate, RATE, "21x21", note=note)


def made(observation: str, steps: int, repeats: int) -> Figure:
    """Return the rate through gymnasium.make; the target is that of codes."""
    rate = gymnasium_rate(observation, steps, repeats)
    target = 4e5 if observation == "uint8" else None
    return Figure("gymnasium", f"gymnasium.make, {observation}", rate, RATE, target=target)


def made_vector(is_blind: bool, repeats: int) -> Figure:
    """The rate through gymnasium.make_vec, with its share of the bare stack's."""
    rounds = ROUNDS // 3 if is_blind else ROUNDS
    rate, share = vector_share(blind=is_blind, rounds=rounds, repeats=repeats)
    name = f"gymnasium.make_vec, 1,024, uint8{', blind moves' if is_blind else ''}"
    target, note = 2.5e6 if is_blind else None, f"{share:.2f} of the bare stack in the same run"
    return Figure("gymnasium", name, rate, RATE, target=target, note=note)


def threads(repeats: int) -> Figure:
    """Return what a second thread brings, with a note on how idle the machine was."""
    others = os.getloadavg()[0] - 1 if hasattr(os, "getloadavg") else 0.0
    ratio, share = threads_ratio(repeats=repeats)
    busy = share < 0.95 or others > 0.5
    note = f"{cores()} cores, {'BUSY: measure again when idle' if busy else 'idle'}"
    name = "two threads over one, 8,192 worlds each"
    return Figure("threads", name, ratio, "times", target=1.6, note=note)


def memory(side: int) -> Figure:
    """Return the bytes a world takes without its observation."""
    taken, target = bytes_of_a_world(EnvConfig.of("random", side)), 1500.0 if side == 21 else None
    name = f"a world at {side}x{side}, without its observation"
    return Figure("memory", name, taken, "bytes", target=target, at_most=True)


def measures(quick: bool = False) -> list[Callable[[], Figure]]:
    """Return what measures the core's table, in its order."""
    steps, repeats = (STEPS // 8, 1) if quick else (STEPS, 3)
    return [
        *(partial(stack, num, side, steps, repeats) for num in STACKS for side in SIZES),
        partial(blind, steps // 4, repeats),
        *(partial(made, observation, steps // 40, repeats) for observation in ("uint8", "float32")),
        *(partial(made_vector, is_blind, 3 if quick else 7) for is_blind in (False, True)),
        partial(threads, 3 if quick else 7),
        *(partial(memory, side) for side in SIZES),
    ]
