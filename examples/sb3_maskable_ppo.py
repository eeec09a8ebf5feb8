"""MaskablePPO of sb3-contrib on MarsExplorer, with a small convolutional network.

Invalid moves are masked.

    pip install '.[train]' stable-baselines3 sb3-contrib
    python examples/sb3_maskable_ppo.py --out mine.onnx

Its 100,000 moves take 215 seconds of one core; the policy then scores 0.399 on 20 terrains on which
`random` scores 0.373. The file can be evaluated and served without Stable-Baselines3:

    marsexplorer evaluate --policy mine.onnx --policy random
    humanplay serve --policy mine.onnx

`--features authors` has the convolutions of Koutras et al. 2021 over the state matrix with an axis of
channels instead, as `rllib_ppo.py` has them.

`export` serves every actor-critic policy of Stable-Baselines3 and sb3-contrib (PPO, A2C, TRPO,
MaskablePPO) whose observations are the state matrix float32[rows, cols], whatever its layers.
"""

import argparse
import json
from pathlib import Path

import gymnasium
import onnx
import torch
from sb3_contrib import MaskablePPO
from sb3_contrib.common.wrappers import ActionMasker
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import evaluate


class TerrainFeatures(BaseFeaturesExtractor):
    """Two convolutions and a dense layer over four planes of the state matrix.

    The planes say of each cell whether it is unknown, free, the rover's, or an obstacle.
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

    def forward(self, observation: Tensor) -> Tensor:
        """Features float32[batch, features_dim] of float32[batch, rows, cols]."""
        codes = (observation * 3.2).round().long().clamp(0, 3)
        planes = nn.functional.one_hot(codes, 4).permute(0, 3, 1, 2).float()
        return self.linear(self.cnn(planes))


class AuthorsFeatures(BaseFeaturesExtractor):
    """The authors' three convolutions over the state matrix with an axis of channels."""

    def __init__(self, observation_space: gymnasium.Space, features_dim: int = 512) -> None:
        super().__init__(observation_space, features_dim)
        rows, cols = (-(-side // 2) for side in observation_space.shape)  # after the first
        self.cnn = nn.Sequential(
            nn.Conv2d(1, 8, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.ZeroPad2d((0, cols % 2, 0, rows % 2)),
            nn.Conv2d(8, 16, 2, stride=2),
            nn.ReLU(),
            nn.Conv2d(16, features_dim, (-(-rows // 2), -(-cols // 2))),  # 6x6 of 21x21 cells
            nn.ReLU(),
            nn.Flatten(),
        )

    def forward(self, observation: Tensor) -> Tensor:
        """Features float32[batch, features_dim] of float32[batch, rows, cols]."""
        return self.cnn(observation[:, None])


NETWORKS = {
    "terrain": {"features_extractor_class": TerrainFeatures},
    "authors": {"features_extractor_class": AuthorsFeatures, "net_arch": []},
    "flat": {},
}
"""Name -> what MaskablePPO calls `policy_kwargs`."""


class Scores(nn.Module):
    """The exported policy: logits of the moves, and the value of an observation."""

    def __init__(self, policy: ActorCriticPolicy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: Tensor, action_mask: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits float32[1, 4] and the value float32[1, 1].

        observation  float32[1, rows, cols], the state matrix; action_mask bool[1, 4], valid moves
        """
        features = self.policy.extract_features(observation, self.policy.features_extractor)
        for_moves, for_value = self.policy.mlp_extractor(features)
        logits = self.policy.action_net(for_moves).masked_fill(~action_mask, -1e9)
        return logits, self.policy.value_net(for_value)


def export(policy: ActorCriticPolicy, out: Path, acts: str = "greedy") -> None:
    """Write a policy as the ONNX file that docs/policies.md describes.

    acts  it takes the likeliest moves, or "samples" them

    Leave `action_mask` out of both, here and in `Scores`, for a policy that was trained without
    masks.
    """
    rows, cols = policy.observation_space.shape
    sample = (torch.zeros(1, rows, cols), torch.ones(1, 4, dtype=torch.bool))
    torch.onnx.export(
        Scores(policy).eval(),
        sample,
        str(out),
        input_names=["observation", "action_mask"],
        output_names=["logits", "value"],
        dynamo=False,
    )
    model = onnx.load(out)
    model.metadata_props.add(key="card", value=json.dumps({"acts": acts}))
    onnx.save(model, out)


def make_env(level: str, size: int) -> gymnasium.Env:
    """Return one environment that gives MaskablePPO the mask of valid moves."""
    env = gymnasium.make("marsexplorer:MarsExplorer-v0", level=level, size=size)
    return ActionMasker(env, lambda wrapped: wrapped.unwrapped.action_masks())


def main() -> None:
    """Train, write the file, and play it beside `random`."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000, help="moves to learn from")
    parser.add_argument("--level", default="random", help="random, or t-m-b from 1-1-1 to 3-2-2")
    parser.add_argument("--size", type=int, default=21, help="cells a side")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--features", choices=[*NETWORKS], default="terrain")
    parser.add_argument("--out", type=Path, default=Path("mine.onnx"), help="file to write")
    options = parser.parse_args()

    env = make_env(options.level, options.size)
    model = MaskablePPO(
        "MlpPolicy",
        env,
        n_steps=1024,
        batch_size=256,
        policy_kwargs=NETWORKS[options.features],
        seed=options.seed,
        device="cpu",
    )
    model.learn(options.steps)
    export(model.policy, options.out, "samples")  # the likeliest moves of a young policy loop
    print(f"{options.out}: {model.num_timesteps:,} moves learnt from")
    config = EnvConfig.of(options.level, options.size)
    for row in evaluate([str(options.out), "random"], config, 20, 10**9).rows:
        print(f"{row.policy}: mean score {row.score_mean:.3f}, {row.coverage_mean:.0%} mapped")


if __name__ == "__main__":
    main()
