"""Training: small, deterministic, interruptible, and better than chance."""

import json
import os
import signal
from dataclasses import fields, replace

import duckdb
import numpy as np
import polars
import pytest
import torch

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.evaluation.rollouts import GreedyRollouts
from marsexplorer.policies import load
from marsexplorer.policies.network.features import FeatureExtractor
from marsexplorer.training import ppo, run_folder
from marsexplorer.training.config import RECIPES
from marsexplorer.training.envs import EVALUATION_SEEDS, TrainingEnvs, make_envs, rewards_in_moves
from marsexplorer.training.network import TRANSPOSED
from marsexplorer.training.ppo import RolloutBuffer, TrainingRun, compute_advantages
from marsexplorer.training.prior import rule_probabilities
from marsexplorer.training.run_folder import RunFolder
from tests.support.policy_files import playing

SMALL = EnvConfig(rows=9, cols=12)
QUICK = replace(
    RECIPES["best"], num_envs=16, num_steps=32, minibatch_size=64, value_warmup_updates=1
)
TINY = {"num_envs": 4, "num_steps": 8, "minibatch_size": 16}
BEST = replace(RECIPES["best"], value_warmup_updates=1, **TINY)
PRICED = replace(RECIPES["priced"], value_warmup_updates=1, **TINY)
LETTER = replace(
    RECIPES["best"],
    reward_per_cell=0.0,
    target_entropy=None,
    kl_coef=0.2,
    kl_of_last_epoch=True,
    vf_change_clip=10.0,
    value_warmup_updates=0,
    update_epochs=2,
    **TINY,
)
"""The loss and the rewards of the paper's PPO."""


@pytest.fixture(autouse=True)
def few_validation_terrains(monkeypatch):
    monkeypatch.setattr(run_folder, "VALIDATION_EPISODES", 20)


@pytest.fixture
def no_curve(monkeypatch):
    """Draw no curve; `test_a_tiny_policy_beats_random_on_fifty_terrains` does."""
    monkeypatch.setattr(run_folder, "plot_learning_curve", lambda _, path: path.touch())


def silent(*_):
    pass


def trained(steps, seed=0, config=QUICK, env_configs=(SMALL,), on_update=silent):
    run = TrainingRun.begin(config, list(env_configs), steps, seed)
    ppo.train(run, on_update)
    return run


def same_weights(one, two):
    return all(map(torch.equal, one.state_dict().values(), two.state_dict().values()))


@pytest.mark.long
def test_a_tiny_policy_beats_random_on_fifty_terrains(tmp_path):
    config = replace(QUICK, minibatch_size=128, learning_rate=1e-3, update_epochs=1)
    run = TrainingRun.begin(config, [SMALL], 6 * 512, 3)
    folder = RunFolder(tmp_path / "tiny", run, {"summary": "a tiny one"}, silent)
    ppo.train(run, folder.on_update)
    folder.save()
    tiny, chance = load(folder.policy), load("random")
    scores = [
        [play_episode(policy, SMALL, k).score for k in EVALUATION_SEEDS[:50]]
        for policy in (tiny, chance)
    ]
    gap = np.subtract(*scores)
    # Student's t, 49 degrees of freedom
    assert gap.mean() > 2.01 * gap.std(ddof=1) / len(gap) ** 0.5
    written = {path.name.split(".")[0] for path in folder.folder.iterdir()}
    assert written == {"tiny", "checkpoint", "log", "curve", "events"}
    lines = [json.loads(line) for line in (folder.folder / "log.jsonl").read_text().splitlines()]
    assert [line["moves"] for line in lines] == [512 * (k + 1) for k in range(6)]
    assert lines[-1]["greedy"] < lines[0]["greedy"]
    assert lines[-1]["steps"] < lines[3]["steps"]


def by_pandas(path):
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_json(path, lines=True, precise_float=True)
    return frame.astype(object).where(frame.notna(), None).to_dict("records")


def by_polars(path):
    return polars.read_ndjson(path).to_dicts()


def by_duckdb(path):
    log = duckdb.read_json(str(path))
    return [dict(zip(log.columns, line, strict=True)) for line in log.fetchall()]


@pytest.mark.parametrize("reader", [by_pandas, by_polars, by_duckdb])
@pytest.mark.usefixtures("no_curve")
def test_a_long_log_is_read_as_it_was_written(reader, tmp_path, monkeypatch):
    """polars takes the columns from the first hundred lines, and drops others."""
    monkeypatch.setattr(run_folder, "validate", lambda run: (run.updates_done / 3, 0.5))
    run = TrainingRun.begin(BEST, [SMALL], 3000 * BEST.batch_size, 3)
    folder = RunFolder(tmp_path, run, {}, silent)
    numbers = [number / 7 for number in range(len(fields(ppo.UpdateMetrics)))]
    for run.updates_done in range(1, 301):
        ends = {"episode_steps": float("nan")} if run.updates_done < 5 else {}
        metrics = replace(ppo.UpdateMetrics(*numbers), global_step=run.updates_done, **ends)
        folder.on_update(metrics)
    path = tmp_path / "log.jsonl"
    run_folder.write_log(path, folder._lines)
    lines = run_folder.read_log(path)
    assert [number for number, line in enumerate(lines, 1) if "greedy" in line] == [1, 150, 300]
    assert reader(path) == [{**dict.fromkeys(lines[0]), **line} for line in lines]


@pytest.mark.parametrize(
    "config",
    [pytest.param(BEST, id="best"), pytest.param(PRICED, id="priced", marks=pytest.mark.long)],
)
@pytest.mark.usefixtures("no_curve")
def test_a_run_that_was_stopped_goes_on_to_the_same_weights_and_another_seed_has_others(
    tmp_path, config
):
    env_configs, steps = [EnvConfig(rows=9, cols=12, max_steps=10)], 3 * config.batch_size
    whole = trained(steps, 5, config, env_configs)

    def stop(metrics, _):
        if metrics.global_step == 2 * config.batch_size:
            raise KeyboardInterrupt

    first = TrainingRun.begin(config, env_configs, steps, 5)
    folder = RunFolder(tmp_path, first, {"summary": "stopped"}, stop)
    with pytest.raises(KeyboardInterrupt):
        ppo.train(first, folder.on_update)
    folder.save()
    torch.rand(7)
    second = TrainingRun.begin(config, env_configs, steps, 5)
    folder = RunFolder(tmp_path, second, {"summary": "resumed", "size": [9, 12]}, silent)
    folder.resume()
    assert second.updates_done == 2
    ppo.train(second, folder.on_update)
    folder.save()
    assert same_weights(second.net, whole.net)
    assert not same_weights(second.net, trained(steps, 6, config, env_configs).net)
    assert len((tmp_path / "log.jsonl").read_text().splitlines()) == 3
    policy = load(folder.policy)
    play_episode(policy, env_configs[0], 1)
    assert set(policy.thought()[0]) != {0.25}


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("config", [BEST, LETTER, PRICED])
def test_graphs_of_gradient_steps_give_the_weights_that_the_steps_give(config, monkeypatch):
    def weights():
        run = TrainingRun.begin(config, [SMALL], 4 * config.batch_size, 5, "cuda")
        ppo.train(run, silent)
        assert run.graphs is not None
        assert same_weights(run.player, run.net.cpu())
        return run.player

    graphed = weights()
    monkeypatch.setattr(ppo, "UNGRAPHED_STEPS", 10**9)
    assert same_weights(graphed, weights())


@pytest.mark.usefixtures("no_curve")
def test_ctrl_c_in_the_middle_of_an_update_comes_after_it(tmp_path):
    config, steps = LETTER, 3 * 32
    whole, run = trained(steps, 5, config), TrainingRun.begin(config, [SMALL], steps, 5)
    folder = RunFolder(tmp_path, run, {"summary": "stopped"}, silent)
    hook = run.optimizer.register_step_post_hook(
        lambda *_: os.kill(os.getpid(), signal.SIGINT) if run.updates_done == 1 else None
    )
    with pytest.raises(KeyboardInterrupt):
        ppo.train(run, folder.on_update)  # the second Ctrl-C, at the next gradient step, breaks in
    assert (run.updates_done, run.is_between_updates) == (1, False)
    hook.remove()
    run, pressed = TrainingRun.begin(config, [SMALL], steps, 5), []

    def press(*_):
        if run.updates_done == 1 and not pressed:
            pressed.append(1)
            os.kill(os.getpid(), signal.SIGINT)

    hook = run.optimizer.register_step_post_hook(press)
    folder = RunFolder(tmp_path, run, {"summary": "stopped"}, silent)
    with pytest.raises(KeyboardInterrupt):
        ppo.train(run, folder.on_update)
    hook.remove()
    assert (run.updates_done, run.is_between_updates) == (2, True)
    folder.save()
    run = TrainingRun.begin(config, [SMALL], steps, 5)
    folder = RunFolder(tmp_path, run, {"summary": "resumed"}, silent)
    folder.resume()
    ppo.train(run, folder.on_update)
    folder.save()
    assert same_weights(run.net, whole.net)
    assert len((tmp_path / "log.jsonl").read_text().splitlines()) == 3


@pytest.mark.usefixtures("no_curve")
def test_a_checkpoint_of_another_run_is_refused(tmp_path):
    run = TrainingRun.begin(QUICK, [SMALL], 1024, 0)
    folder = RunFolder(tmp_path, run, {"summary": "one"}, silent)
    with pytest.raises(ValueError, match="no checkpoint"):
        folder.resume()
    folder.save()
    for seed, steps, word in ((1, 1024, "seed"), (0, 4096, "updates")):
        other = RunFolder(tmp_path, TrainingRun.begin(QUICK, [SMALL], steps, seed), {}, silent)
        with pytest.raises(ValueError, match=f"another run .*{word}"):
            other.resume()


def test_advantages_are_the_slow_sum_of_discounted_surprises():
    torch.manual_seed(0)
    config, gamma, gae_lambda = replace(QUICK, num_steps=7, num_envs=3), 0.97, 0.9
    buffer, next_values = RolloutBuffer.empty(config, (torch.zeros(3, 1),)), torch.rand(3)
    buffer.rewards, buffer.values = torch.rand(7, 3), torch.rand(7, 3)
    buffer.dones = (torch.rand(7, 3) < 0.3).float()
    advantages = compute_advantages(buffer, next_values, gamma, gae_lambda)
    for board in range(3):
        for t in range(7):
            total, weight = 0.0, 1.0
            for k in range(t, 7):
                goes_on = 1 - float(buffer.dones[k, board])
                following = float(next_values[board] if k == 6 else buffer.values[k + 1, board])
                reward, value = float(buffer.rewards[k, board]), float(buffer.values[k, board])
                total += weight * (reward + gamma * following * goes_on - value)
                weight *= gamma * gae_lambda * goes_on
            assert float(advantages[t, board]) == pytest.approx(total, abs=1e-5)


def test_a_value_that_has_moved_too_far_counts_with_the_larger_error_of_its_own_and_of_its_clipped_self():
    old = torch.tensor([0.0, 0.0, 0.0, 50.0, 0.0])
    returns = torch.tensor([441.0, 441.0, -441.0, 441.0, 5.0])
    values = torch.tensor([8.0, 30.0, 30.0, 12.0, 25.0], requires_grad=True)
    minibatch = ppo.Minibatch((), torch.zeros(5), torch.zeros(5, 4), old, torch.zeros(5), returns)
    errors = ppo.value_errors(LETTER, values, minibatch)
    # moved by 8: its own; by 30 towards its return: as if by 10; by 30 or 38 away from it: its own;
    # beyond it: its own
    assert errors.tolist() == [433.0**2, 431.0**2, 471.0**2, 429.0**2, 20.0**2]
    errors.sum().backward()
    assert values.grad.tolist() == [2 * -433.0, 0.0, 2 * 471.0, 2 * -429.0, 2 * 20.0]
    unclipped = ppo.value_errors(replace(LETTER, vf_change_clip=float("inf")), values, minibatch)
    assert unclipped.tolist() == (values - returns).square().tolist()


@pytest.mark.parametrize("config", [LETTER, RECIPES["best"]], ids=["eq. 8", "moves"])
def test_without_the_bonus_the_end_of_an_episode_has_no_reward(config):
    config = replace(config, num_envs=16, num_steps=8, has_bonus=False)
    run = TrainingRun.begin(config, [EnvConfig(rows=9, cols=12, max_steps=40)], 1000, 3)
    (envs,) = run.envs.parts
    rules = [load("frontier-cost") for _ in range(8)]
    for rule in rules:
        rule.reset(0)
    ends = {"explored": 0, "failed": 0}
    for _ in range(40):
        known_before = (envs.codes != 0).sum((1, 2))
        chosen = [rule.act(codes.copy()) for rule, codes in zip(rules, envs.codes, strict=False)]
        step = envs.step(np.array(chosen + torch.randint(4, (8,)).tolist()))
        with torch.no_grad():
            rewards = ppo.compute_rewards(run, envs, step)
            new = (envs.codes != 0).sum((1, 2)) - known_before
        goes_on, scale = ~step.dones, config.reward_per_cell
        assert rewards[goes_on] == pytest.approx((scale * new - 1 if scale else new - 0.5)[goes_on])
        assert rewards[step.failed] == pytest.approx(-1.0 if scale else 0.0)
        assert (np.abs(rewards[step.explored]) < 40).all()
        ends["explored"] += int(step.explored.sum())
        ends["failed"] += int(step.failed.sum())
    assert min(ends.values()) > 0


def test_rewards_in_moves_are_a_cost_of_one_and_a_share_for_each_new_cell():
    envs = TrainingEnvs(SMALL, 16, 3)
    rng, explored = np.random.default_rng(0), 0
    policies = [load("frontier-cost") for _ in range(16)]
    for policy in policies:
        policy.reset(0)
    for _ in range(60):
        known_before = (envs.codes != 0).sum((1, 2))
        boards = zip(policies, envs.codes, strict=True)
        step = envs.step(np.array([policy.act(codes.copy()) for policy, codes in boards]))
        rewards = rewards_in_moves(SMALL, step, 0.5)
        new = (envs.codes != 0).sum((1, 2)) - known_before
        assert rewards[~step.dones] == pytest.approx(0.5 * new[~step.dones] - 1)
        assert (rewards[step.explored] > -1).all()
        assert (rewards[step.explored] < 0.5 * SMALL.n - 1).all()
        explored += int(step.explored.sum())
        for i in np.flatnonzero(step.dones):
            policies[i].reset(int(rng.integers(9)))
    assert explored > 0


def make_codes(config, num_envs):
    """Return an encoder of nothing but the codes."""
    return lambda codes, *rest: (torch.from_numpy(codes),)


def test_running_out_of_time_shows_the_last_observation_to_bootstrap_from():
    envs = TrainingEnvs(EnvConfig(rows=9, cols=12, max_steps=2), 8, 0, make_codes)
    envs.step(np.full(8, 1))
    step = envs.step(np.full(8, 1))
    assert step.final_obs is not None
    which, (codes,) = step.truncated, step.final_obs
    assert len(which) == len(codes) > 0
    assert step.dones[which].all()
    assert envs.steps[which].tolist() == [0] * len(which)
    assert ((codes.numpy() == 2).sum((1, 2)) == 1).all()
    # The rover has left the corner, where the next episode stands again.
    assert (codes.numpy()[:, 0, 0] == 1).all()


def test_all_levels_and_sizes_have_environments_and_the_first_level_half_of_them():
    levels = ("random", "1-1-1", "2-2-1")
    configs = [EnvConfig.of(level, size) for size in (21, 42) for level in levels]
    parts = make_envs(configs, 256, 0, RECIPES["best"].make_encoder).parts
    assert [part.config for part in parts] == configs
    assert sum(part.num_envs for part in parts) == 256
    assert 120 <= sum(part.num_envs for part in parts if part.config.level == "random") <= 136
    assert all(part.num_envs >= 1 for part in parts)


def test_training_environments_are_of_the_whole_configuration():
    config = EnvConfig("2-1-1", 9, 12, sensor_radius=3, beta=0.5, max_steps=70)
    envs = TrainingEnvs(config, 2, 0)
    assert envs.env.config == config
    config = EnvConfig("random", 9, 12, discoverable_only=True)
    assert TrainingEnvs(config, 2, 0).env.config == config


def test_evaluation_seeds_are_refused():
    with pytest.raises(ValueError, match="kept for evaluation"):
        TrainingEnvs(SMALL, 2, EVALUATION_SEEDS.start)


def test_the_priced_recipe_begins_as_the_rules(tmp_path):
    """By the mean of three rules at 42 x 42; the untrained head decides close ones."""
    torch.manual_seed(0)
    config = EnvConfig("random", 42, 42)
    net = playing(RECIPES["priced"].make_network([config]), tmp_path)
    rollouts = GreedyRollouts(config, 3)
    rollouts.worlds.start(np.arange(3))
    decided = 0
    for _ in range(60):
        decisions = rollouts.decide(net)
        rules = rule_probabilities(torch.from_numpy(decisions.moves), 1.0)[0]
        best, second = rules.sort(1, descending=True)[0].T[:2]
        certain = ((best > 4 * second).numpy()) & ~decisions.guarded
        assert (decisions.logits.argmax(1) == rules.argmax(1).numpy())[certain].all()
        decided += int(certain.sum())
        rollouts.step(decisions.actions)
    assert decided > 100


def test_the_divergence_from_the_rules_counts_by_the_size_of_the_grid():
    torch.manual_seed(0)
    config = replace(RECIPES["priced"], rule_coef=(0.5, 0.1, 0.3))
    for side, coef in ((21, 0.5), (42, 0.1), (84, 0.3)):
        envs = TrainingEnvs(EnvConfig("random", side, side), 6, 7, config.make_encoder)
        moves = envs.observe()[1].clone()
        assert (moves[:, :, 0] == 0).any()
        logits = torch.where(moves[:, :, 0] > 0, torch.randn(6, 4), torch.tensor(-1e9))
        log_probs, scale = logits.log_softmax(1), config.prior_scale
        rules = np.array([rule_by_definition(numbers, side, scale) for numbers in moves.numpy()])
        literal = -(rules * log_probs.numpy())[rules > 0].sum() / 6
        divergence = float(ppo.rule_divergence(config, moves, log_probs))
        assert divergence == pytest.approx(coef * literal, rel=1e-4)


def rule_by_definition(moves, side, scale):
    """The probabilities of four moves by the rules of one size, from their numbers."""
    counts = np.array({21: (3, 0, 0), 42: (1, 1, 1), 84: (0, 3, 0)}[side])
    weight = np.zeros(4)
    for action in range(4):
        shares = moves[action, 16:25].reshape(3, 3)
        logit = 0.1 * moves[action, 10] + counts @ (5 * shares[:, 0] + 3 * shares[:, 1])
        weight[action] = np.exp(scale * logit) * moves[action, 0]
    return weight / weight.sum()


def test_sigterm_that_is_handled_like_ctrl_c_waits_for_the_end_of_an_update():
    before, done = signal.signal(signal.SIGTERM, signal.default_int_handler), []

    def update():
        with ppo.postponed_interrupt():
            os.kill(os.getpid(), signal.SIGTERM)
            done.append("the rest of the update")

    try:
        with pytest.raises(KeyboardInterrupt):
            update()
        assert signal.getsignal(signal.SIGTERM) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGTERM, before)
    assert done


def test_transposing_exchanges_rows_and_columns():
    """A board and its transpose look the same once transposed, with moves exchanged."""
    codes = np.random.default_rng(5).choice([0, 1, 1, 3], size=(1, 21, 21)).astype(np.uint8)
    codes[0, 8, 5] = 2
    features, nothing = FeatureExtractor(1, 21, 21, 6), np.zeros((1, 441), np.uint8)
    arrays = features(codes, np.array([8 * 21 + 5]), nothing, np.array([1]))
    planes, moves = (array.copy() for array in arrays)
    turned = np.ascontiguousarray(codes.transpose(0, 2, 1))
    mirrored, flipped = features(turned, np.array([5 * 21 + 8]), nothing, np.array([2]))
    assert np.array_equal(planes[:, :, TRANSPOSED], mirrored)
    alike = [k for k in range(16) if k not in (7, 8, 9)]  # rules break ties by compass
    assert np.allclose(moves[:, ::-1, alike], flipped[:, :, alike])
