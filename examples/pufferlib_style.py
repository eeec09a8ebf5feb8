"""MarsExplorer with PufferLib's buffers: it writes to the trainer's own memory.

pip install '.[mars]' torch
python examples/pufferlib_style.py --steps 200000

The class has the buffers, num_agents, spaces, reset and step of pufferlib.PufferEnv. It does not
derive from it, so that the script runs without PufferLib.
"""

import argparse
import time

import gymnasium
import numpy as np
import torch


def buffers(num_agents: int, shape: tuple[int, ...]) -> dict[str, torch.Tensor]:
    """A trainer's memory, allocated once and pinned if a GPU reads it."""
    tensors = {
        "observations": torch.zeros((num_agents, *shape), dtype=torch.uint8),
        "rewards": torch.zeros(num_agents),
        "terminals": torch.zeros(num_agents, dtype=torch.bool),
        "truncations": torch.zeros(num_agents, dtype=torch.bool),
        "masks": torch.ones((num_agents, 4), dtype=torch.bool),
    }
    return (
        {name: tensor.pin_memory() for name, tensor in tensors.items()}
        if torch.cuda.is_available()
        else tensors
    )


class PufferMars:
    """A stack of environments that writes everything of a step into `buf`.

    Observations, rewards, terminals, truncations and masks.
    """

    def __init__(
        self, num_agents: int, level: str, size: int, buf: dict[str, torch.Tensor]
    ) -> None:
        self.num_agents, self.buf = num_agents, buf
        self.envs = gymnasium.make_vec(
            "marsexplorer:MarsExplorer-v0",
            num_agents,
            "vector_entry_point",
            level=level,
            size=size,
            observation="uint8",
            autoreset_mode="SameStep",
            out=buf["observations"],
        )
        self.single_observation_space, self.single_action_space = (
            self.envs.single_observation_space,
            self.envs.single_action_space,
        )

    def reset(self, seed: int = 0) -> tuple[torch.Tensor, list[dict[str, float]]]:
        """Start environment i on seed + i; return the observations' buffer and no infos."""
        self.envs.reset(seed=seed)
        self._write_masks()
        return self.buf["observations"], []

    def step(self, actions: np.ndarray):
        """Make a move each; return PufferEnv.step's buffers, and means of ended episodes."""
        _, rewards, terminated, truncated, info = self.envs.step(actions)
        self.buf["rewards"].copy_(torch.from_numpy(rewards))
        self.buf["terminals"].copy_(torch.from_numpy(terminated))
        self.buf["truncations"].copy_(torch.from_numpy(truncated))
        self._write_masks()
        infos = []
        if "final_obs" in info:
            ended, final = info["_final_obs"], info["final_info"]
            infos = [{name: float(final[name][ended].mean()) for name in ("score", "coverage")}]
        return (
            self.buf["observations"],
            self.buf["rewards"],
            self.buf["terminals"],
            self.buf["truncations"],
            infos,
        )

    def _write_masks(self) -> None:
        self.buf["masks"].copy_(torch.from_numpy(self.envs.unwrapped.action_masks()))

    def close(self) -> None:
        """End the environments."""
        self.envs.close()


def main() -> None:
    """Play random valid moves and print the rate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--steps", type=int, default=1_000_000, help="moves of all environments together"
    )
    parser.add_argument("--num-envs", type=int, default=1024)
    parser.add_argument("--level", default="random")
    parser.add_argument("--size", type=int, default=21)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    torch.manual_seed(options.seed)
    buf = buffers(options.num_envs, (options.size, options.size))
    puffer = PufferMars(options.num_envs, options.level, options.size, buf)
    codes, _ = puffer.reset(options.seed)
    moves, invalid, scores = 0, 0, []
    began = time.perf_counter()
    while moves < options.steps:
        actions = torch.rand(buf["masks"].shape).masked_fill_(~buf["masks"], -1).argmax(dim=1)
        codes, rewards, _, _, infos = puffer.step(actions.numpy())
        moves += options.num_envs
        invalid += int((rewards < -1).sum())
        scores += [info["score"] for info in infos]
    seconds = time.perf_counter() - began
    puffer.close()
    assert codes.data_ptr() == buf["observations"].data_ptr()
    rovers = int((codes == 2).sum())
    print(
        f"{moves:,} moves, {invalid} of them invalid, {moves / seconds:,.0f} a second, {rovers} "
        "rovers in the given memory"
    )
    print(
        f"mean score of the episodes that ended {np.mean(scores):.3f}"
        if scores
        else "no episode has ended"
    )


if __name__ == "__main__":
    main()
