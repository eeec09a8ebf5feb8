"""`python -m tests.support.compile_kernels`: compile what is compiled once, before several test processes do it side by side.

These are the kernels and the modules: Python may have been told not to keep what it has compiled (`PYTHONDONTWRITEBYTECODE`),
and a command that is started by a test would compile the whole app. The first process that compiles for long says so on
stderr, which some tests read.
"""

import compileall
from pathlib import Path

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation import INFORMED, evaluate
from marsexplorer.policies import load, names
from marsexplorer.policies.priced import TUNED
from marsexplorer.training.priced_episodes import PricedEpisodes
from marsexplorer.vector import MarsExplorerVector


def compile_kernels():
    """Play a short episode with each policy, in a vector environment and by the informed planner."""
    config = EnvConfig.of("random", (6, 8))
    for name in names():
        if name == "ppo-paper":  # plays one size alone, and compiles nothing of its own
            continue
        episode, policy = Episode.begin(config, seed=1), load(name)
        policy.reset(1)
        while not episode.ended:
            episode.step(policy.act(episode.codes))
    for level in ("building", "cave"):
        Episode.begin(EnvConfig.of(level, (6, 8)), seed=1)
    envs = MarsExplorerVector(num_envs=2, level="random", size=(6, 8))
    envs.reset(seed=1)
    envs.step(envs.action_space.sample())
    evaluate([INFORMED], config, 2, 1, workers=1)
    PricedEpisodes(config, [1]).play(TUNED)


def compile_modules():
    """Keep the modules of the packages compiled, where they have changed."""
    for package in ("app", "marsexplorer"):
        compileall.compile_dir(Path(__file__).parents[2] / package, quiet=1)


if __name__ == "__main__":
    compile_modules()
    compile_kernels()
