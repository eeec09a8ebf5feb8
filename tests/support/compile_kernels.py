"""`python -m tests.support.compile_kernels`: compile what is compiled once, before several test processes do it side by side.

The first process that compiles for long says so on stderr, which some tests read.
"""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load, names
from marsexplorer.vector import MarsExplorerVector

CONFIG = EnvConfig.of("random", (6, 8))


def compile_kernels():
    """Compile the rules, then what stands on them in two processes: about as long as half of it takes in one."""
    Episode.begin(CONFIG, seed=1).step(1)
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        for part in [pool.submit(compile_policies), pool.submit(compile_stacks)]:
            part.result()


def compile_policies():
    """Play a short episode with each policy."""
    for name in names():
        episode, policy = Episode.begin(CONFIG, seed=1), load(name)
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


if __name__ == "__main__":
    compile_kernels()
