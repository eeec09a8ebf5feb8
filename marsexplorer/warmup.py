"""Call every kernel once, in the order in which players need them.

`python -m marsexplorer.warmup` compiles them all, so that no later process has to.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from marsexplorer.config import MAP, OTHER_LEVELS, EnvConfig
from marsexplorer.episode import Episode, replay
from marsexplorer.policies import load, names
from marsexplorer.terrain import generate, next_seed
from marsexplorer.vector import MarsExplorerVector
from marsexplorer.world import Worlds

SMALL = EnvConfig.of("random", (6, 8))


def step_once() -> None:
    """Begin an episode on the paper's terrain, make a move, and replay it."""
    episode = Episode.begin(EnvConfig.of("random", 5), seed=0)
    episode.step(0)
    replay(episode.record())


def begin(level: str) -> None:
    Episode.begin(EnvConfig.of(level, (6, 8)), seed=1)


def play(name: str, config: EnvConfig = SMALL) -> None:
    """Let a policy play an episode."""
    episode, policy = Episode.begin(config, seed=1), load(name)
    policy.reset(1)
    while not episode.ended:
        episode.step(policy.act(episode.codes))


def decide_on_large_board(name: str) -> None:
    """Decide on a board so large that only one rule is priced."""
    load(name).act(Episode.begin(EnvConfig.of("random", 84), seed=1).codes)


def step_stacks() -> None:
    """Step environments side by side, and draw terrains without an episode."""
    for mode in ("NextStep", "SameStep"):
        envs = MarsExplorerVector(num_envs=2, level="random", size=(6, 8), autoreset_mode=mode)
        envs.reset(seed=1)
        envs.step(envs.action_space.sample())
        envs.action_masks()
    generate(SMALL, next_seed(1))
    worlds = Worlds(SMALL, 2)
    worlds.start(np.arange(2))
    worlds.step_autoreset(np.zeros(2, np.int64))


def warmups() -> list[Callable[[], None]]:
    """The calls: the rules, the shipped policy, the other levels, and the rest."""
    best, *others = names()
    levels = (name for name in OTHER_LEVELS if name != MAP)
    return [
        step_once,
        partial(play, best),
        partial(decide_on_large_board, best),
        *(partial(begin, level) for level in levels),
        *(partial(play, name) for name in others),
        partial(play, "lookahead", EnvConfig.of("random", 14)),
        step_stacks,
    ]


if __name__ == "__main__":
    for warmup in warmups():
        warmup()
