"""MaskablePPO of sb3-contrib on MarsExplorer, with invalid moves masked and a small convolutional network.

    pip install . stable-baselines3 sb3-contrib
    python examples/sb3_maskable_ppo.py --steps 4096 --out mine.zip

The file can be evaluated and served without Stable-Baselines3:

    marsexplorer evaluate --policy mine.zip --policy random
    marsexplorer serve --policy mine.zip
"""

import argparse

import gymnasium
import torch
from sb3_contrib import MaskablePPO
from sb3_contrib.common.wrappers import ActionMasker
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn


class TerrainFeatures(BaseFeaturesExtractor):
    """Two convolutions and a dense layer over four planes of the state matrix: unknown, free, rover, obstacle.

    The playground loads a trained file by path if this class keeps its name and its layers; the widths may differ.
    """

    def __init__(self, observation_space: gymnasium.Space, features_dim: int = 128) -> None:
        super().__init__(observation_space, features_dim)
        rows, cols = observation_space.shape
        self.cnn = nn.Sequential(
            nn.Conv2d(4, 16, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Conv2d(16, 32, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Flatten(),
        )
        self.linear = nn.Sequential(
            nn.Linear(32 * -(-rows // 4) * -(-cols // 4), features_dim), nn.ReLU()
        )

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return features float32[batch, features_dim] of observations float32[batch, rows, cols] (0, 0.3, 0.6 or 1)."""
        codes = (observation * 3.2).round().long().clamp(0, 3)
        planes = nn.functional.one_hot(codes, 4).permute(0, 3, 1, 2).float()
        return self.linear(self.cnn(planes))


def make_env(level: str, size: int) -> gymnasium.Env:
    """Return one environment that gives MaskablePPO the mask of valid moves."""
    env = gymnasium.make("marsexplorer:MarsExplorer-v0", level=level, size=size)
    return ActionMasker(env, lambda wrapped: wrapped.unwrapped.action_masks())


def main() -> None:
    """Train, save, and play ten terrains."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--steps",
        type=int,
        default=4096,
        help="moves to learn from; a useful policy takes a million",
    )
    parser.add_argument("--level", default="random", help="random, or t-m-b from 1-1-1 to 3-2-2")
    parser.add_argument("--size", type=int, default=21, help="cells a side")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--features",
        choices=["terrain", "flat"],
        default="terrain",
        help="flat: MlpPolicy as it comes",
    )
    parser.add_argument("--out", default="mine.zip", help="file to write")
    given = parser.parse_args()

    env = make_env(given.level, given.size)
    features = {"features_extractor_class": TerrainFeatures} if given.features == "terrain" else {}
    model = MaskablePPO(
        "MlpPolicy",
        env,
        n_steps=1024,
        batch_size=256,
        policy_kwargs=features,
        seed=given.seed,
        device="cpu",
    )
    model.learn(given.steps)
    model.save(given.out)

    covered = []
    for seed in range(10):
        observation, info = env.reset(seed=seed)
        ended = False
        while not ended:
            masks = env.unwrapped.action_masks()
            action, _ = model.predict(observation, action_masks=masks, deterministic=True)
            observation, _, terminated, truncated, info = env.step(int(action))
            ended = terminated or truncated
        covered.append(info["coverage"])
    print(
        f"{given.out}: {model.num_timesteps:,} moves learnt from, mean coverage {sum(covered) / 10:.1%} over 10 terrains"
    )


if __name__ == "__main__":
    main()
