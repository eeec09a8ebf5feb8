"""A TorchRL rollout of MarsExplorer, with the valid moves in the tensordict.

pip install '.[mars]' torchrl
python examples/torchrl_rollout.py --steps 200
"""

import argparse

import gymnasium
import numpy as np
import torch
from torchrl.envs import GymWrapper, TransformedEnv
from torchrl.envs.transforms import ActionMask, StepCounter


class WithMask(gymnasium.Wrapper):
    """Add `action_mask`, int8[4], to the observation for TorchRL's ActionMask."""

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        mask = gymnasium.spaces.MultiBinary(4)
        self.observation_space = gymnasium.spaces.Dict(
            {"observation": env.observation_space, "action_mask": mask}
        )

    def _both(self, observation: np.ndarray) -> dict[str, np.ndarray]:
        return {
            "observation": observation,
            "action_mask": self.unwrapped.action_masks().astype(np.int8),
        }

    def reset(self, **given):
        """Start an episode."""
        observation, info = self.env.reset(**given)
        return self._both(observation), info

    def step(self, action):
        """Make a move."""
        observation, *rest = self.env.step(action)
        return self._both(observation), *rest


def main() -> None:
    """Play random valid moves and print what was discovered."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=200, help="moves to make")
    parser.add_argument("--level", default="random")
    parser.add_argument("--size", type=int, default=21)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    torch.manual_seed(options.seed)
    mars = gymnasium.make("marsexplorer:MarsExplorer-v0", level=options.level, size=options.size)
    env = TransformedEnv(GymWrapper(WithMask(mars), categorical_action_encoding=True), ActionMask())
    env.append_transform(StepCounter())
    env.set_seed(options.seed)
    rollout = env.rollout(options.steps, break_when_any_done=False)
    coverage = (rollout["next", "observation"] > 0).float().mean(dim=(-2, -1))
    invalid = int((rollout["next", "reward"] < -1).sum())
    print(
        f"{len(rollout)} moves, {invalid} of them invalid, mean return a move "
        f"{float(rollout['next', 'reward'].mean()):.2f}"
    )
    print(
        f"best coverage {float(coverage.max()):.1%}; keys: "
        f"{', '.join(sorted(map(str, rollout.keys())))}"
    )


if __name__ == "__main__":
    main()
