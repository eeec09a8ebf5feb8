"""Tianshou's A2C, Rainbow and discrete SAC: reproducible, as their settings say."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

pytest.importorskip(
    "tianshou", reason="tianshou is not installed here: `make test-research` tests what needs it"
)

from tianshou.algorithm import RainbowDQN
from tianshou.data import PrioritizedVectorReplayBuffer
from torch import nn

from marsexplorer.config import EnvConfig
from marsexplorer.policies.files.onnx import OnnxModel
from marsexplorer.training import ppo
from research.paper.algorithms import begin
from research.paper.networks import NoisyLinear, sample_noise
from research.paper.trainers.environments import (
    Environments,
    ObservationBytes,
    Rewards,
    Transitions,
    add,
    make_replay,
)
from research.paper.trainers.off_policy import RainbowTrainer

SMALL = EnvConfig.of("random", (7, 8))
ALGORITHMS = ("a2c", "rainbow", "sac")
MOVES = {"a2c": 6000, "rainbow": 1536, "sac": 2048}
"""Of a short training."""
INTERRUPTED = {"a2c": 4000, "rainbow": 1280, "sac": 1792}
"""After the first gradient steps of it."""


def weights(net):
    """Return all weights as one vector."""
    tensors = net.state_dict().values()
    return torch.cat([tensor.detach().flatten().double() for tensor in tensors])


def short_trainer(algorithm, variant="paper", config=SMALL):
    return begin(algorithm, variant, config, 1, MOVES[algorithm])


def advance(trainer, moves):
    numbers = []
    while trainer.moves < moves:
        numbers.append(trainer.advance())
    return numbers


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_policy_plays_without_tianshou(algorithm, tmp_path):
    path = tmp_path / "policy.onnx"
    trainer = short_trainer(algorithm, config=EnvConfig.of("random", 7))
    trainer.save_policy(path, {"summary": "untrained"})
    program = (
        "import sys; sys.modules['tianshou'] = None\n"
        "from marsexplorer.config import EnvConfig; from marsexplorer.evaluation import evaluate\n"
        f"table = evaluate([{str(path)!r}], EnvConfig.of('random', 7), 2, 10**9)\n"
        "print(table.rows[0].steps_mean)"
    )
    command = [sys.executable, "-c", program]
    played = subprocess.run(command, capture_output=True, text=True, check=True)
    assert float(played.stdout) > 0


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_what_works_never_takes_an_invalid_move(algorithm):
    trainer = short_trainer(algorithm, "works")
    advance(trainer, 1024)
    assert trainer.envs.recent.count > 0
    assert set(trainer.envs.recent.outcomes) <= {"explored", "timed_out"}


def test_what_follows_a_truncated_episode_is_its_last_observation():
    config = replace(EnvConfig.of("random", (7, 8)), max_steps=3)
    form = ObservationBytes.of(config, features=False)
    environments = Environments(config, 4, 1, form, Rewards())
    for _ in range(3):  # south, away from the corner; an obstacle may end it
        moves = environments.step(np.full(4, 2))
    at = np.flatnonzero(moves.truncated)
    assert len(at)
    assert not moves.terminated[at].any()
    first = form.pack(Environments(config, 4, 1, form, Rewards()).envs.observe())
    for i in at:
        assert (moves.next_obs[i] != moves.obs[i]).any()  # the rover has moved on
        rover = int(np.flatnonzero(moves.next_obs[i] == 2)[0])
        assert rover == 3 * 8  # three cells south of the corner
        # the next episode begins in the corner
        assert int(np.flatnonzero(environments.obs[i] == 2)[0]) == 0
        assert int(np.flatnonzero(first[i] == 2)[0]) == 0


def numbered_moves(step, num_envs, ends=()):
    """A move of every environment whose observation and reward have the step's number."""
    obs = np.full((num_envs, 4), step, np.uint8)
    ended = np.isin(np.arange(num_envs), ends)
    actions, rewards = np.zeros(num_envs, np.int64), np.full(num_envs, 10.0**step)
    return Transitions(obs, actions, rewards, ended, ~ended & False, obs + 1)


def test_three_steps_of_rewards_are_followed_by_the_observation_after_three():
    trainer = short_trainer("rainbow")
    buffer = make_replay(20, 2, 4)
    for step in range(6):
        add(buffer, numbered_moves(step, 2, ends=[1] if step == 2 else ()))
    trainer.algorithm.gamma = 0.5
    indices = np.array([0, 11, 12])
    batch = trainer.algorithm._preprocess_batch(buffer[indices], buffer, indices)
    assert batch.obs_next[:, 0].tolist() == [3, 3, 3]  # the second and the third end with step 2
    support = trainer.algorithm.policy.support
    sums = torch.tensor([1 + 5 + 25.0, 10 + 50.0, 100.0])
    expected = sums[:, None] + torch.tensor([0.125, 0.0, 0.0])[:, None] * support[None]
    torch.testing.assert_close(batch.returns, expected, check_dtype=False)


def test_the_noise_is_new_for_every_move_and_rainbow_has_its_six_parts():
    trainer = short_trainer("rainbow")
    assert isinstance(trainer, RainbowTrainer)
    net, algorithm = trainer.net, trainer.algorithm
    for stream in (net.advantage_head, net.value_head):  # dueling
        layers = [module for module in stream.modules() if isinstance(module, nn.Linear)]
        assert layers
        assert all(isinstance(layer, NoisyLinear) for layer in layers)
    assert net.advantage_head is not net.value_head
    assert isinstance(trainer._buffer, PrioritizedVectorReplayBuffer)
    assert (algorithm.n_step, len(net.support)) == (3, 51)
    asked = []
    for _ in range(2):
        trainer.act()
        with torch.no_grad():
            asked.append(algorithm.policy.model(trainer.environments.obs)[0])
    assert not torch.equal(*asked)


def test_a_policy_of_probabilities_samples_and_one_of_values_is_greedy(tmp_path):
    for algorithm, acts in (("a2c", "samples"), ("rainbow", "greedy"), ("sac", "samples")):
        path = tmp_path / f"{algorithm}.onnx"
        short_trainer(algorithm).save_policy(path, {"summary": "untrained"})
        assert OnnxModel(path).card["acts"] == acts


def test_the_network_chooses_the_move_whose_value_the_target_network_gives():
    trainer = short_trainer("rainbow")
    algorithm, obs = trainer.algorithm, torch.from_numpy(trainer.environments.obs)
    distributions = torch.zeros(len(obs), 4, 51)
    distributions[:, range(4), range(4)] = 1.0  # what the target network gives: atom k for move k
    algorithm.model_old.forward = lambda obs: (distributions, None)
    scores = torch.eye(4)[torch.arange(len(obs)) % 4]
    trainer.net.expected = lambda codes: scores
    chosen = scores.argmax(1)
    returns = algorithm.policy.support.expand(len(obs), 51)
    targets = algorithm.target_distribution(obs, returns)
    assert targets.argmax(1).tolist() == chosen.tolist()


class Theirs(RainbowTrainer):
    """Rainbow whose gradient step is tianshou's own."""

    def begin(self, algorithm, net):
        class Own(type(algorithm)):
            _sample_noise = staticmethod(sample_noise)
            _update_with_batch = RainbowDQN._update_with_batch

        algorithm.__class__ = Own
        super().begin(algorithm, net)


def test_a_gradient_step_is_the_one_of_the_library(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    outcomes = []
    for make in (RainbowTrainer, Theirs):
        trainer = make("paper", SMALL, 1, MOVES["rainbow"])
        numbers = advance(trainer, MOVES["rainbow"])
        outcomes.append((numbers[-1]["loss"], weights(trainer.net)))
    (loss, ours), (their_loss, theirs) = outcomes
    assert loss == pytest.approx(their_loss, rel=1e-6)
    assert torch.equal(ours, theirs)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_graphs_of_rainbow_give_the_weights_that_its_steps_give(monkeypatch):
    def trained():
        trainer = short_trainer("rainbow")
        torch.cuda.manual_seed(1)
        return trainer, advance(trainer, 1536)

    (graphed, losses), _ = trained(), monkeypatch.setattr(ppo, "UNGRAPHED_STEPS", 10**9)
    stepped, expected = trained()
    assert losses == expected
    assert torch.equal(weights(graphed.net), weights(stepped.net))


def test_sac_has_two_critics_with_targets_and_a_replay_with_priorities():
    trainer = short_trainer("sac")
    algorithm = trainer.algorithm
    critics = [algorithm.critic, algorithm.critic2, algorithm.critic_old, algorithm.critic2_old]
    assert len({id(next(critic.parameters())) for critic in critics}) == 4
    assert isinstance(trainer._buffer, PrioritizedVectorReplayBuffer)
    before = [weights(critic).clone() for critic in (algorithm.critic, algorithm.critic2)]
    assert not torch.equal(*before)
    advance(trainer, MOVES["sac"])
    after = [weights(critic) for critic in (algorithm.critic, algorithm.critic2)]
    assert not any(map(torch.equal, before, after))


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_same_training_interrupted_or_not_gives_the_same_numbers_and_weights(
    algorithm, tmp_path
):
    moves, path = MOVES[algorithm], tmp_path / "state.pt"
    whole = short_trainer(algorithm)
    expected = advance(whole, moves)
    first = short_trainer(algorithm)
    numbers = advance(first, INTERRUPTED[algorithm])
    torch.save(first.state_dict(), path)
    np.random.seed(0)
    torch.manual_seed(0)
    second = short_trainer(algorithm)
    second.load_state_dict(torch.load(path, weights_only=True))
    assert second.moves == first.moves < moves
    numbers += advance(second, moves)
    assert numbers == expected
    assert torch.equal(weights(second.net), weights(whole.net))
    assert list(second.envs.recent.returns) == list(whole.envs.recent.returns)
