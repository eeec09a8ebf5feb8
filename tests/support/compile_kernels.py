"""`python -m tests.support.compile_kernels`: compile what is compiled once, before several test processes do it side by side.

The first process that compiles for long says so on stderr, which some tests read.
"""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load, names
from marsexplorer.terrain import generate, next_seed
from marsexplorer.vector import MarsExplorerVector
from marsexplorer.world import Worlds

CONFIG = EnvConfig.of("random", (6, 8))


def compile_kernels():
    """Compile the rules, then what stands on them in two processes: about as long as half of it takes in one."""
    Episode.begin(CONFIG, seed=1).step(1)
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        for part in [pool.submit(compile_policies), pool.submit(compile_stacks)]:
            part.result()


def compile_policies():
    """Play a short episode with each policy, one that looks ahead, and a move where one rule is priced, not three."""
    for name in names():
        play(load(name), CONFIG)
    play(load("lookahead"), EnvConfig.of("random", 14))
    load("ppo").act(Episode.begin(EnvConfig.of("random", 84), seed=1).codes)


def play(policy, config):
    """Play an episode to its end."""
    episode = Episode.begin(config, seed=1)
    policy.reset(1)
    while not episode.ended:
        episode.step(policy.act(episode.codes))


def compile_stacks():
    """Begin on each kind of terrain, and step and play stacks."""
    for level in ("building", "cave"):
        Episode.begin(EnvConfig.of(level, (6, 8)), seed=1)
    envs = MarsExplorerVector(num_envs=2, level="random", size=(6, 8))
    envs.reset(seed=1)
    envs.step(envs.action_space.sample())
    envs.action_masks()
    generate(CONFIG, next_seed(1))
    worlds = Worlds(CONFIG, 2)
    worlds.start(np.arange(2))
    worlds.step_autoreset(np.zeros(2, np.int64))


if __name__ == "__main__":
    compile_kernels()
