"""MarsExplorer in the style of EnvPool: send() a batch's moves, recv() a batch.

pip install '.[mars]'
python examples/envpool_style.py --steps 200000

While the policy decides for one batch, threads step the others: the compiled rules hold no lock of
the interpreter. Nothing of EnvPool is needed, whose environments are its own, in C++.
"""

import argparse
import queue
import time
from concurrent.futures import ThreadPoolExecutor

import gymnasium
import numpy as np


class AsyncPool:
    """`num_envs` environments in batches of `batch_size`, with EnvPool's methods."""

    def __init__(self, num_envs: int, batch_size: int, num_threads: int, **options) -> None:
        if num_envs % batch_size:
            raise ValueError(
                f"num_envs must be a multiple of batch_size, got {num_envs} and {batch_size}"
            )
        self.num_envs, self.batch_size = num_envs, batch_size
        settings = {
            "id": "marsexplorer:MarsExplorer-v0",
            "vectorization_mode": "vector_entry_point",
            "observation": "uint8",
            "autoreset_mode": "SameStep",
        }
        self.stacks = [
            gymnasium.make_vec(num_envs=batch_size, **settings, **options)
            for _ in range(num_envs // batch_size)
        ]
        self._threads, self._ready = ThreadPoolExecutor(num_threads), queue.SimpleQueue()

    def _work(self, index: int, act) -> None:
        try:
            observations, *rest, info = act()
            rewards, terminated, truncated = rest or (
                np.zeros(self.batch_size),
                *np.zeros((2, self.batch_size), bool),
            )
            first = index * self.batch_size
            info["env_id"] = np.arange(first, first + self.batch_size)
            self._ready.put((observations, rewards, terminated, truncated, info))
        except Exception as error:  # raised by recv, as nobody waits for the thread itself
            self._ready.put(error)

    def async_reset(self, seed: int = 0) -> None:
        """Start every environment, environment i on seed + i; recv() returns the batches."""
        for k, stack in enumerate(self.stacks):
            self._threads.submit(
                self._work, k, lambda stack=stack, k=k: stack.reset(seed=seed + k * self.batch_size)
            )

    def recv(self):
        """A batch that is ready: observations, rewards, terminated, truncated, info.

        info["env_id"] lists the environments.

        The observations and infos are valid until the moves of this batch are sent.
        """
        came = self._ready.get()
        if isinstance(came, Exception):
            raise came
        return came

    def send(self, actions: np.ndarray, env_id: np.ndarray) -> None:
        """Step the batch of these environments, in the background."""
        index = int(env_id[0]) // self.batch_size
        self._threads.submit(self._work, index, lambda: self.stacks[index].step(actions))

    def step(self, actions: np.ndarray, env_id: np.ndarray):
        """Send moves and return a batch that is ready."""
        self.send(actions, env_id)
        return self.recv()

    def valid(self, env_id: np.ndarray) -> np.ndarray:
        """Return bool[batch_size, 4], the valid moves of a batch that was received."""
        return self.stacks[int(env_id[0]) // self.batch_size].unwrapped.action_masks()

    def close(self) -> None:
        """End the threads."""
        self._threads.shutdown()


def main() -> None:
    """Play random valid moves and print the rate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--steps", type=int, default=1_000_000, help="moves of all environments together"
    )
    parser.add_argument("--num-envs", type=int, default=2048)
    parser.add_argument("--batch-size", type=int, default=1024)
    parser.add_argument("--num-threads", type=int, default=2)
    parser.add_argument("--level", default="random")
    parser.add_argument("--size", type=int, default=21)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    pool = AsyncPool(
        options.num_envs,
        options.batch_size,
        options.num_threads,
        level=options.level,
        size=options.size,
    )
    rng, moves, invalid, scores = np.random.default_rng(options.seed), 0, 0, []
    pool.async_reset(options.seed)
    began = time.perf_counter()
    while moves < options.steps:
        info = pool.recv()[-1]
        if "final_obs" in info:
            ended = info["_final_obs"]
            scores += info["final_info"]["score"][ended].tolist()
            invalid += int(
                np.isin(info["final_info"]["outcome"][ended], ("collided", "out_of_bounds")).sum()
            )
        valid = pool.valid(info["env_id"])
        actions = np.where(valid, rng.random(valid.shape), -1).argmax(axis=1)
        pool.send(actions, info["env_id"])
        moves += len(actions)
    seconds = time.perf_counter() - began
    pool.close()
    mean = f", mean score {np.mean(scores):.3f}" if scores else ""
    print(
        f"{moves:,} moves, {invalid} of them invalid, {moves / seconds:,.0f} a second, "
        f"{len(scores)} episodes ended{mean}"
    )


if __name__ == "__main__":
    main()
