"""FrozenLake that adds up what it costs by itself, in each started process."""

import os
import time
from contextlib import suppress
from pathlib import Path

from gymnasium.envs.toy_text.frozen_lake import FrozenLakeEnv

STARTED = os.getpid()
"""The process that imported this; one that it forks is not another started one."""
SECONDS = [0.0]


def _timed(method):
    """The method, whose processor time counts as the environment's."""

    def call(self, *arguments, **keywords):
        began = time.process_time()
        try:
            return method(self, *arguments, **keywords)
        finally:
            SECONDS[0] += time.process_time() - began
            if method.__name__ in ("reset", "close") and os.getpid() == STARTED:
                with suppress(PermissionError):  # of a confined process, which steps little
                    Path(__file__).with_name(f"seconds-{STARTED}").write_text(str(SECONDS[0]))

    return call


class TimedLake(FrozenLakeEnv):
    """FrozenLake, whose steps, pictures and beginnings are timed."""

    __init__ = _timed(FrozenLakeEnv.__init__)
    reset = _timed(FrozenLakeEnv.reset)
    step = _timed(FrozenLakeEnv.step)
    render = _timed(FrozenLakeEnv.render)
    close = _timed(FrozenLakeEnv.close)
