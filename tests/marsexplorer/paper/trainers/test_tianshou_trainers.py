"""A2C, Rainbow and discrete SAC through tianshou: they go on bit for bit, and do what their settings say."""

import io
import json
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

pytest.importorskip(
    "tianshou", reason="tianshou is not installed here: `make test-paper` tests what needs it"
)

from tianshou.data import Batch

from marsexplorer.config import EnvConfig
from marsexplorer.paper.algorithms import begin
from marsexplorer.paper.trainers.observation_bytes import ObservationBytes
from marsexplorer.paper.trainers.rainbow import RainbowTrainer
from marsexplorer.paper.trainers.replay import add, load_replay_state, make_replay, replay_state
from marsexplorer.paper.trainers.tianshou_envs import Environments, Rewards, Transitions
from marsexplorer.paper.trial import Trial, read_log
from marsexplorer.policies import load

SMALL = EnvConfig.of("random", (7, 8))
ALGORITHMS = ("a2c", "rainbow", "sac")
MOVES = {"a2c": 6000, "rainbow": 1536, "sac": 2048}
"""Of a short training."""
ON_THE_WAY = {"a2c": 4000, "rainbow": 1280, "sac": 1792}
"""Moves after which its state is kept; it has begun to learn."""


def through_a_file(state):
    """Return what a checkpoint gives back."""
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    return torch.load(file, weights_only=True)


def weights(trainer):
    """Return all weights as one vector."""
    return torch.cat(
        [tensor.detach().flatten().double() for tensor in trainer.net.state_dict().values()]
    )


def short_trainer(algorithm, variant="paper", config=SMALL):
    return begin(algorithm, variant, config, 1, MOVES[algorithm])


def advance(trainer, moves):
    numbers = []
    while trainer.moves < moves:
        numbers.append(trainer.advance())
    return numbers


@pytest.fixture(scope="module", params=ALGORITHMS)
def story(request):
    """A training that was not interrupted: its algorithm, its state on the way, its end."""
    trainer = short_trainer(request.param)
    advance(trainer, ON_THE_WAY[request.param])
    state = through_a_file(trainer.state_dict())
    numbers = advance(trainer, MOVES[request.param])
    return request.param, state, numbers, weights(trainer)


def go_on(algorithm, state):
    trainer = short_trainer(algorithm)
    trainer.load_state_dict(state)
    return advance(trainer, MOVES[algorithm]), weights(trainer)


def test_from_its_state_a_training_goes_on_bit_for_bit(story):
    algorithm, state, numbers, end = story
    found, weights_found = go_on(algorithm, through_a_file(state))
    assert found == numbers
    assert torch.equal(weights_found, end)


def test_every_part_of_the_state_is_needed(story):
    algorithm, state, _, end = story
    fresh = through_a_file(short_trainer(algorithm).state_dict())
    for part in set(state) - {"moves", "replay"}:
        _, found = go_on(algorithm, {**through_a_file(state), part: fresh[part]})
        assert not torch.equal(found, end), f"without {part} the training goes on alike"
    for part in {"priorities", "extremes"} & set(state.get("replay", {})):
        changed = through_a_file(state)
        kept = changed["replay"][part]
        changed["replay"][part] = torch.ones_like(kept) if part == "priorities" else [1.0, 1.0]
        _, found = go_on(algorithm, changed)
        assert not torch.equal(found, end), (
            f"without the replay's {part} the training goes on alike"
        )


def short_trial(algorithm):
    return Trial(algorithm, "paper", "random", 7, 1, MOVES[algorithm], terrains=3)


def result_of(folder, trial):
    """Return the log without its CPU seconds, and the weights."""
    lines = [
        {name: value for name, value in line.items() if name != "cpu_s"}
        for line in read_log(folder / trial.name / "log.jsonl")
    ]
    return lines, load_file(folder / trial.name / f"{trial.name}.safetensors")


@pytest.fixture(scope="module", params=ALGORITHMS)
def whole_trial(request, tmp_path_factory):
    folder, trial = tmp_path_factory.mktemp("whole"), short_trial(request.param)
    trial.run(folder, lambda share: None)
    return trial, result_of(folder, trial)


def assert_same(found, expected):
    assert found[0] == expected[0]
    assert list(found[1]) == list(expected[1])
    assert all(torch.equal(found[1][name], tensor) for name, tensor in expected[1].items())


def test_after_ctrl_c_a_trial_goes_on_to_the_same_curve(whole_trial, tmp_path):
    trial, expected = whole_trial

    def interrupt(share):
        if share > 0.7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        trial.run(tmp_path, interrupt)
    assert not trial.is_done(tmp_path)
    trial.run(tmp_path, lambda share: None)
    assert_same(result_of(tmp_path, trial), expected)


KILLED = """
import os, signal, sys
from pathlib import Path
from marsexplorer.paper import trial
trial.CHECKPOINT_INTERVAL_S = 0.0
saved = 0
def kill(share):
    if share > 0.7:
        os.kill(os.getpid(), signal.SIGKILL)
trial.Trial({algorithm!r}, "paper", "random", 7, 1, {moves}, terrains=3).run(Path({folder!r}), kill)
"""


def test_after_kill_9_a_trial_goes_on_to_the_same_curve(whole_trial, tmp_path):
    trial, expected = whole_trial
    program = KILLED.format(algorithm=trial.algorithm, moves=trial.moves, folder=str(tmp_path))
    assert subprocess.run([sys.executable, "-c", program]).returncode == -signal.SIGKILL
    assert (tmp_path / trial.name / "checkpoint.pt").is_file()
    trial.run(tmp_path, lambda share: None)
    assert_same(result_of(tmp_path, trial), expected)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_policy_plays_without_tianshou(algorithm, tmp_path):
    path = tmp_path / "policy.safetensors"
    short_trainer(algorithm, config=EnvConfig.of("random", 7)).save_policy(
        path, {"summary": "untrained"}
    )
    program = (
        "import sys; sys.modules['tianshou'] = None\n"
        "from marsexplorer.config import EnvConfig; from marsexplorer.evaluation import evaluate\n"
        f"table = evaluate([{str(path)!r}], EnvConfig.of('random', 7), 2, 10**9)\n"
        "print(table.rows[0].steps_mean)"
    )
    assert (
        float(
            subprocess.run(
                [sys.executable, "-c", program], capture_output=True, text=True, check=True
            ).stdout
        )
        > 0
    )


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_what_works_never_takes_an_invalid_move(algorithm):
    trainer = short_trainer(algorithm, "works")
    advance(trainer, 1024)
    assert trainer.envs.recent.count > 0
    assert set(trainer.envs.recent.outcomes) <= {"explored", "timed_out"}


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_settings_are_json_and_those_of_the_variant(algorithm):
    paper, works = short_trainer(algorithm).settings, short_trainer(algorithm, "works").settings
    assert json.loads(json.dumps(paper)) != json.loads(json.dumps(works))
    assert (paper["gamma"], paper["network"], paper["mask"], paper["reward_per_cell"]) == (
        0.95,
        "authors",
        False,
        0.0,
    )


def test_what_follows_a_truncated_episode_is_its_last_observation():
    config = replace(EnvConfig.of("random", (7, 8)), max_steps=3)
    form = ObservationBytes.of(config, features=False)
    environments = Environments(config, 4, 1, form, Rewards())
    boards = []
    for _ in range(3):
        moves = environments.step(
            np.full(4, 2)
        )  # south, away from the corner; an obstacle may end it
        boards.append(moves)
    at = np.flatnonzero(moves.truncated)
    assert len(at)
    assert not moves.terminated[at].any()
    first = form.pack(Environments(config, 4, 1, form, Rewards()).envs.observe())
    for i in at:
        assert (moves.next_obs[i] != moves.obs[i]).any()  # the rover has moved on
        rover = int(np.flatnonzero(moves.next_obs[i] == 2)[0])
        assert rover == 3 * 8  # three cells south of the corner
        assert (
            int(np.flatnonzero(environments.obs[i] == 2)[0]) == 0
        )  # the next episode begins in the corner
        assert int(np.flatnonzero(first[i] == 2)[0]) == 0


def numbered_moves(step, num_envs, ends=()):
    """Return a move of every environment whose observation and reward say which step it was."""
    obs = np.full((num_envs, 4), step, np.uint8)
    ended = np.isin(np.arange(num_envs), ends)
    return Transitions(
        obs,
        np.zeros(num_envs, np.int64),
        np.full(num_envs, 10.0**step),
        ended,
        ~ended & False,
        obs + 1,
    )


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
    own = trainer.settings
    assert own["double_q"]
    assert own["dueling"]
    assert own["prioritized_replay"]
    assert own["noisy"]
    assert own["n_step"] == 3
    assert own["num_atoms"] == 51
    asked = []
    for _ in range(2):
        trainer.act()
        with torch.no_grad():
            asked.append(trainer.algorithm.policy(Batch(obs=trainer.environments.obs)).logits)
    assert not torch.equal(*asked)


def test_the_replay_returns_from_its_state_and_is_small():
    trainer = short_trainer("rainbow", config=EnvConfig())
    advance(trainer, 1024)
    state = replay_state(trainer._buffer)
    assert len(state["boards"]) / 1024 < 150  # bytes a move, for two boards of 441 cells
    other = make_replay(trainer._buffer.maxsize, 16, 441)
    load_replay_state(other, through_a_file(state))
    for name in ("obs", "obs_next", "act", "rew", "terminated", "truncated", "done"):
        assert np.array_equal(other._meta[name], trainer._buffer._meta[name]), name
    assert np.array_equal(other.weight._value, trainer._buffer.weight._value)
    assert np.array_equal(other.last_index, trainer._buffer.last_index)


def test_a_policy_of_probabilities_samples_and_one_of_values_is_greedy(tmp_path):
    for algorithm, acts in (("a2c", "samples"), ("rainbow", "greedy"), ("sac", "samples")):
        path = tmp_path / f"{algorithm}.safetensors"
        short_trainer(algorithm).save_policy(path, {"summary": "untrained"})
        assert load(str(path)).name == algorithm
        assert acts in path.read_bytes()[:4000].decode("latin1")
