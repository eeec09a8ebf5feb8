"""PPO of RLlib on MarsExplorer, with the convolutions of Koutras et al. 2021.

    pip install ".[mars]" "ray[rllib]" torch
    python examples/rllib_ppo.py --steps 2000

The network's input is the state matrix with an axis of channels, float32[rows, cols, 1], as RLlib's convolutions take it.
RLlib does not mask invalid moves by itself, so an untrained policy collides often. RLlib pins an older Gymnasium; the
environment works with any from 1.0 on.
"""

import argparse

import gymnasium
import numpy as np
import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.tune.registry import register_env

NETWORK = DefaultModelConfig(
    conv_filters=[[8, 3, 2], [16, 2, 2], [512, 6, 6]],  # channels, kernel, stride
    conv_activation="relu",
    head_fcnet_hiddens=[],
)
"""The sizes of the authors' `trainners/runners/PPO.py`: of 21x21 cells the last layer leaves one."""


def make_env(config: dict) -> gymnasium.Env:
    """One environment whose observation has an axis of channels."""
    env = gymnasium.make("marsexplorer:MarsExplorer-v0", **config)
    planes = gymnasium.spaces.Box(0.0, 1.0, (*env.observation_space.shape, 1), np.float32)
    return gymnasium.wrappers.TransformObservation(env, lambda state: state[..., None], planes)


def main() -> None:
    """Train and print the mean return after each iteration."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=2000, help="moves to learn from")
    parser.add_argument("--level", default="random")
    parser.add_argument("--size", type=int, default=21)
    parser.add_argument(
        "--workers", type=int, default=0, help="processes that play; 0 plays in this one"
    )
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    ray.init(num_cpus=options.workers + 1, include_dashboard=False, log_to_driver=False)
    register_env("MarsExplorer", make_env)
    config = (
        PPOConfig()
        .environment("MarsExplorer", env_config={"level": options.level, "size": options.size})
        .env_runners(num_env_runners=options.workers, num_envs_per_env_runner=8)
        .rl_module(model_config=NETWORK)
        .training(train_batch_size_per_learner=1000, minibatch_size=250, num_epochs=3, lr=3e-4)
        .debugging(seed=options.seed, log_level="ERROR")
    )
    algorithm = config.build_algo()
    played = 0
    while played < options.steps:
        result = algorithm.train()
        runners = result["env_runners"]
        played = int(runners["num_env_steps_sampled_lifetime"])
        print(f"{played:,} moves, mean return {runners['episode_return_mean']:.1f}", flush=True)
    algorithm.stop()
    ray.shutdown()


if __name__ == "__main__":
    main()
