"""Each example in a virtual environment of its own, kept in .cache/examples."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from humanplay.tasks.gymnasium.task import GymnasiumTask
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]

ROOT = Path(__file__).parent.parent.parent
HOMES = ROOT / ".cache" / "examples"
OLDEST = ["gymnasium==1.0.0", "numba", "scipy", "pytest", "pytest-timeout", "hypothesis"]


def needs(name):
    """Return what pip installs for an example's environment; `oldest` is the core."""
    if name == "oldest":
        return OLDEST
    (line,) = re.findall(r"^ *pip install (.+)$", (ROOT / "examples" / name).read_text(), re.M)
    core, *packages = shlex.split(line)
    return ["--editable", f"{ROOT}{core.removeprefix('.')}", *packages]


def home(name):
    """Return the Python of an environment, made and filled on its first use."""
    folder = HOMES / Path(name).stem
    python, stamp = folder / "bin" / "python", folder / "installed.json"
    if not stamp.is_file() or json.loads(stamp.read_text()) != needs(name):
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "--quiet", *needs(name)], check=True)
        stamp.write_text(json.dumps(needs(name)))
    return str(python)


def run(python, *arguments, **rest):
    """Return what a script prints; its last words are shown when it fails."""
    env = os.environ | {"OMP_NUM_THREADS": "1", "RAY_DISABLE_DASHBOARD": "1"}
    command, rest = [python, *map(str, arguments)], {"timeout": 1200, **rest}
    done = subprocess.run(command, capture_output=True, text=True, env=env, **rest)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


PREDICT = """
import json, sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
from sb3_maskable_ppo import NETWORKS, export, make_env
import torch
from sb3_contrib import MaskablePPO
env, kept = make_env("random", 8), []
model = MaskablePPO("MlpPolicy", env, n_steps=64, batch_size=64, policy_kwargs=NETWORKS[sys.argv[3]], seed=1, device="cpu")
model.learn(256)
export(model.policy, Path(sys.argv[2]))
for seed in range(3):
    observation, _ = env.reset(seed=seed)
    ended = False
    while not ended:
        masks = env.unwrapped.action_masks()
        action, _ = model.predict(observation, action_masks=masks, deterministic=True)
        seen = torch.from_numpy(observation)[None]
        with torch.no_grad():
            shares = model.policy.get_distribution(seen, action_masks=masks[None]).distribution.probs[0].tolist()
            value = float(model.policy.predict_values(seen)[0, 0])
        kept.append([int(action), shares, value])
        observation, _, terminated, truncated, _ = env.step(int(action))
        ended = terminated or truncated
print(json.dumps(kept))
"""


@pytest.mark.parametrize("features", ["terrain", "authors", "flat"])
def test_an_exported_maskable_ppo_plays_here_as_it_does_there(features, tmp_path):
    out = tmp_path / "mine.onnx"
    there = json.loads(
        run(home("sb3_maskable_ppo.py"), "-c", PREDICT, ROOT / "examples", out, features)
    )
    policy, at = policies.load(out), 0
    for seed in range(3):
        episode = Episode.begin(EnvConfig.of("random", 8), seed=seed)
        policy.reset(seed)
        while not episode.ended:
            action, shares, value = there[at]
            assert policy.act(episode.observation()) == action
            assert policy.thought()[0] == pytest.approx(shares, abs=1e-5)
            assert policy.thought()[1] == pytest.approx(value, abs=1e-3)
            episode.step(action)
            at += 1
    assert at == len(there)


EXPORT = """
import json, sys
import gymnasium, torch
from stable_baselines3 import PPO
class OnnxableSB3Policy(torch.nn.Module):  # as Stable-Baselines3 documents it, "Exporting models"
    def __init__(self, policy):
        super().__init__()
        self.policy = policy
    def forward(self, observation):
        return self.policy(observation, deterministic=True)
model = PPO("MlpPolicy", sys.argv[1], n_steps=256, seed=0, device="cpu").learn(1024)
size = model.observation_space.shape
torch.onnx.export(
    OnnxableSB3Policy(model.policy), torch.zeros(1, *size), sys.argv[2], opset_version=17, input_names=["input"],
    dynamo=False,
)
played = []
for seed in range(5):
    env, actions, ended = gymnasium.make(sys.argv[1]), [], False
    observation, _ = env.reset(seed=seed)
    while not ended:
        actions.append(int(model.predict(observation, deterministic=True)[0]))
        observation, _, terminated, truncated, _ = env.step(actions[-1])
        ended = terminated or truncated
    played.append(actions)
print(json.dumps(played))
"""


@pytest.mark.parametrize("env", ["FrozenLake-v1", "CartPole-v1"])
def test_a_ppo_that_stable_baselines_exports_plays_the_same_seeds_as_there(env, tmp_path):
    out = tmp_path / "mine.onnx"
    there = json.loads(run(home("sb3_maskable_ppo.py"), "-c", EXPORT, env, out).splitlines()[-1])
    task = GymnasiumTask(env, [str(out)])
    policy = task.policies.load("mine")
    played = [task.policies.play(policy, task.default, seed, 0).actions for seed in range(5)]
    task.close()
    assert [list(actions) for actions in played] == there


def test_the_example_trains_and_writes_what_evaluate_scores(tmp_path):
    out = tmp_path / "mine.onnx"
    options = ["--steps", 1024, "--size", 8, "--out", out]
    output = run(home("sb3_maskable_ppo.py"), "examples/sb3_maskable_ppo.py", *options, cwd=ROOT)
    assert "1,024 moves learnt from" in output
    rest = ["--policy", out, "--size", 8, "--episodes", 3]
    assert "mine" in run(
        sys.executable, "-m", "humanplay.tasks.mars.cli", "evaluate", *rest, cwd=ROOT
    )


def test_the_cleanrl_loop_learns_and_saves_what_beats_chance(tmp_path):
    curve = tmp_path / "curve.csv"
    options = ["--steps", 100_000, "--size", 12, "--out", tmp_path / "mine.onnx", "--curve", curve]
    output = run(sys.executable, "examples/cleanrl_ppo.py", *options, cwd=ROOT)
    header, *points = curve.read_text().splitlines()
    assert header == "moves,score"
    printed = re.findall(r"^([\d,]+) moves, .* mean score (0\.\d+)$", output, re.M)
    assert points == [f"{moves.replace(',', '')},{score}" for moves, score in printed]
    scores = [float(one) for one in re.findall(r"mean score ([\d.]+)", output)]
    *scores, mine, chance = scores
    assert mine > chance
    assert len(scores) > 20
    # The first to end are the lucky ones; from then on it learns.
    assert np.mean(scores[-4:]) > np.mean(scores[5:11]) + 0.05


def test_the_cleanrl_loop_learns_to_see_the_authors_level(tmp_path):
    curve = tmp_path / "curve.csv"
    options = ["--preset", "videos", "--steps", 50_000, "--curve", curve]
    run(sys.executable, ROOT / "examples/cleanrl_ppo.py", *options, cwd=tmp_path)
    header, *points = curve.read_text().splitlines()
    assert header == "moves,coverage"
    shares = [float(point.split(",")[1]) for point in points]
    assert shares[-1] > shares[0] + 0.2


def test_rllib_trains():
    output = run(home("rllib_ppo.py"), "examples/rllib_ppo.py", "--steps", 2000, cwd=ROOT)
    assert len(re.findall(r"moves, mean return -?[\d.]+", output)) >= 2


def test_torchrl_rolls_out_with_masks():
    output = run(
        home("torchrl_rollout.py"), "examples/torchrl_rollout.py", "--steps", 200, cwd=ROOT
    )
    assert "200 moves, 0 of them invalid" in output
    assert "action_mask" in output


@pytest.mark.parametrize(
    ("script", "more", "pattern"),
    [
        ("envpool_style.py", ["--num-envs", 128, "--batch-size", 64], r", [1-9]\d* episodes ended, mean score 0"),
        ("pufferlib_style.py", ["--num-envs", 64], ", 64 rovers in the given memory"),
    ],
)  # fmt: skip
def test_a_stack_is_played_in_the_style_of_other_libraries(script, more, pattern):
    options = ["--steps", 20_000, "--size", 8, *more]
    printed = run(sys.executable, f"examples/{script}", *options, cwd=ROOT)
    assert "moves, 0 of them invalid" in printed
    assert re.search(pattern, printed)


def test_the_oldest_gymnasium_in_the_range_serves_the_environment(tmp_path):
    # Copied, because the fixtures of the other tests need more than Gymnasium.
    for name in ("test_env.py", "test_world.py"):
        (tmp_path / name).write_text((ROOT / "tests/marsexplorer" / name).read_text())
    env, options = (
        os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'app'}"},
        "-W error -m pytest -q -p no:cacheprovider",
    )
    command = [home("oldest"), *options.split(), str(tmp_path)]
    rest = {"capture_output": True, "text": True, "timeout": 1200}
    done = subprocess.run(command, env=env, cwd=tmp_path, **rest)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert " passed" in done.stdout
