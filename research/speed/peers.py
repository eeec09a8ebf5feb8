"""Other environments in the same run, whichever are installed.

Each runs in a process of its own, with random moves, resets included; ours with valid
moves, for blind ones end an episode after four steps.

`python -m research.speed.peers NAME SECONDS` prints steps and CPU seconds of one of them.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from subprocess import CalledProcessError, TimeoutExpired, run
from typing import Any

import numpy as np

from marsexplorer.config import EnvConfig
from research.speed.core import RATE, moves_of, replay
from research.speed.figures import Figure

PATIENCE_S = 120.0
"""How long a peer may take in all before it counts as failed."""

Play = Callable[[], Callable[[], int]]
"""Makes an environment and returns what makes some moves in it and says how many."""


@dataclass(frozen=True)
class Peer:
    """name and module as imported, what pip installs, and what is played."""

    name: str
    module: str
    package: str
    play: Play


def single(env: Any) -> Callable[[], int]:
    """A function of 5,000 random moves in a gymnasium environment from seed 0 on.

    It resets the environment when it ends.
    """
    moves = np.random.default_rng(0).integers(0, env.action_space.n, 5000).tolist()
    return partial(replay, env, moves)


def frozen_lake() -> Callable[[], int]:
    """Make FrozenLake 4x4 of Gymnasium's toy texts."""
    import gymnasium

    return single(gymnasium.make("FrozenLake-v1"))


def minigrid() -> Callable[[], int]:
    """Make MiniGrid's four rooms, 19x19, its own 7x7 egocentric observation."""
    import gymnasium
    import minigrid  # noqa: F401  # registers

    return single(gymnasium.make("MiniGrid-FourRooms-v0"))


def crafter() -> Callable[[], int]:
    """Make Crafter, 64x64 pixels."""
    import crafter

    env = crafter.Env()
    moves = np.random.default_rng(0).integers(0, env.action_space.n, 100).tolist()
    env.reset()

    def play_some() -> int:
        for move in moves:
            if env.step(move)[2]:
                env.reset()
        return len(moves)

    return play_some


def envpool() -> Callable[[], int]:
    """Make FrozenLake of EnvPool, 1,024 at once on one thread of its own."""
    import envpool

    envs = envpool.make("FrozenLake-v1", env_type="gymnasium", num_envs=1024, num_threads=1)
    envs.reset()
    moves = np.random.default_rng(0).integers(0, 4, (20, 1024)).astype(np.int32)

    def play_some() -> int:
        for row in moves:
            envs.step(row)
        return int(moves.size)

    return play_some


def ours(num: int) -> Callable[[], int]:
    """Make MarsExplorer through Gymnasium, one environment or a stack.

    uint8 codes, random valid moves
    """
    import gymnasium

    moves = moves_of(EnvConfig(), num, 20_000 if num == 1 else 1000)
    if num == 1:
        env = gymnasium.make("MarsExplorer-v0", observation="uint8")
        return lambda: replay(env, moves[:, 0].tolist())
    envs = gymnasium.make_vec(
        "MarsExplorer-v0", num, observation="uint8", autoreset_mode="SameStep"
    )

    def play_some() -> int:
        envs.reset(seed=0)
        for row in moves:
            envs.step(row)
        return int(moves.size)

    return play_some


PEERS = (
    Peer("MarsExplorer, gymnasium.make", "marsexplorer", "", lambda: ours(1)),
    Peer("MarsExplorer, gymnasium.make_vec, 1,024", "marsexplorer", "", lambda: ours(1024)),
    Peer("FrozenLake, gymnasium.make", "gymnasium", "gymnasium", frozen_lake),
    Peer("MiniGrid FourRooms", "minigrid", "minigrid", minigrid),
    Peer("Crafter", "crafter", "crafter", crafter),
    Peer("EnvPool FrozenLake, 1,024", "envpool", "envpool", envpool),
)


def measure(peer: Peer, seconds: float) -> Figure:
    """A peer's steps per CPU second, or a note that says why there are none."""
    rate, note = None, ""
    command = [
        sys.executable,
        "-W",
        "ignore",
        "-m",
        "research.speed.peers",
        peer.name,
        str(seconds),
    ]
    try:
        if find_spec(peer.module) is None:
            note = f"not installed: pip install {peer.package}"
        else:
            done = run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
            steps, spent = done.stdout.split()[-2:]
            rate = int(steps) / float(spent)
    except TimeoutExpired:
        note = f"did not end within {PATIENCE_S:.0f} s"
    except CalledProcessError as error:
        message = (error.stderr.strip().splitlines() or ["it said nothing"])[-1]
        note = f"failed: {message[:100]}"
    return Figure("peers", peer.name, rate, RATE, note=note)


def timed(some: Callable[[], int], seconds: float) -> tuple[int, float]:
    """Steps made and CPU seconds of all threads, after one round to warm up."""
    some()
    steps, began = 0, time.process_time()
    while (spent := time.process_time() - began) < seconds:
        steps += some()
    return steps, spent


if __name__ == "__main__":
    chosen = next(peer for peer in PEERS if peer.name == sys.argv[1])
    print(*timed(chosen.play(), float(sys.argv[2])))
