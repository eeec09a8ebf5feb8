"""What a version must do, run by `research.compatibility` in its environment.

Prints a word for each thing done.
"""

import copy
import pickle
import sys
import warnings

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

warnings.simplefilter("ignore")
ID = "marsexplorer:MarsExplorer-v0"


def checker() -> None:
    """Gymnasium's own check."""
    check_env(gymnasium.make(ID, size=(6, 9)).unwrapped)


def copies() -> None:
    """Copies play on as the original."""
    env = gymnasium.make(ID)
    env.reset(seed=1)
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert (twin.step(1)[0] == copy.deepcopy(env).step(1)[0]).all()


def stack() -> None:
    """The stack answers as Gymnasium's own."""
    ours = gymnasium.make_vec(ID, 3, size=(6, 9))
    theirs = SyncVectorEnv([lambda: gymnasium.make(ID, size=(6, 9))] * 3)
    rng = np.random.default_rng(0)
    assert (ours.reset(seed=2)[0] == theirs.reset(seed=2)[0]).all()
    for _ in range(100):
        actions = rng.integers(0, 4, 3)
        for one, other in zip(ours.step(actions)[:4], theirs.step(actions)[:4], strict=True):
            assert np.array_equal(one, other)


def wrapper() -> None:
    """A vector wrapper takes the stack."""
    envs = RecordEpisodeStatistics(gymnasium.make_vec(ID, 3, size=(6, 9)))
    envs.reset(seed=0)
    for _ in range(50):
        envs.step(np.zeros(3, np.int64))


def torchrl() -> None:
    """A rollout of TorchRL."""
    from torchrl.envs import GymEnv

    assert GymEnv(ID).rollout(20).shape[0] >= 1


def tianshou() -> None:
    """An episode in Tianshou's vector environment."""
    from tianshou.env import DummyVectorEnv

    envs = DummyVectorEnv([lambda: gymnasium.make(ID)] * 2)
    envs.seed([1, 2])
    envs.reset()
    assert envs.step(np.array([1, 2]))[0].shape == (2, 21, 21)


if __name__ == "__main__":
    for name in sys.argv[1:]:
        globals()[name]()
        print(name, flush=True)
