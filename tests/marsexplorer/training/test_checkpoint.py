"""Checkpoints of the first format: they are read by a conversion that only renames, and their runs go on as they would have."""

import hashlib
import json
import shutil
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from marsexplorer.config import EnvConfig
from marsexplorer.policies.files.formats import current_recipe
from marsexplorer.policies.network.model import Net
from marsexplorer.policies.network.paper_model import PaperNet
from marsexplorer.training import ppo
from marsexplorer.training.checkpoint import load_checkpoint
from marsexplorer.training.config import RECIPES, TrainConfig
from marsexplorer.training.ppo import TrainingRun
from marsexplorer.training.run_folder import LOG_COLUMNS, RunFolder, resumed_config

FIXTURES = Path(__file__).parents[2] / "fixtures" / "training"
ENV_CONFIGS = [
    EnvConfig(rows=9, cols=12, max_steps=20),
    EnvConfig("1-1-1", rows=12, cols=9, max_steps=20),
]
SEED = 5


@dataclass(frozen=True)
class NarrowConfig(TrainConfig):
    """A configuration with a network so narrow that its checkpoint is small."""

    def make_network(self, env_configs):
        return Net(wide=2, hidden=3)


CONFIG = NarrowConfig(
    **asdict(
        replace(
            RECIPES["best"], num_envs=8, num_steps=16, minibatch_size=64, value_warmup_updates=1
        )
    )
)


def begin():
    return TrainingRun.begin(CONFIG, ENV_CONFIGS, 6 * CONFIG.batch_size, SEED)


def arithmetic_digest(weights):
    """A digest of a forward and a backward pass in bfloat16: it differs between kinds of processors and versions of torch."""
    net = Net(wide=2, hidden=3)
    net.load_state_dict(weights)
    planes = torch.arange(64 * 4 * 323).remainder(251).view(64, 4, 323).to(torch.uint8)
    with torch.autocast("cpu", torch.bfloat16):
        logits, values = net(planes, torch.ones(64, 4, 16) / 3)
    (logits.float().log_softmax(1)[:, 0].mean() + values.float().square().mean()).backward()
    arrays = [
        logits.detach().float(),
        values.detach().float(),
        *(weight.grad for weight in net.parameters()),
    ]
    return hashlib.sha256(b"".join(array.numpy().tobytes() for array in arrays)).hexdigest()


def paper_arithmetic_digest():
    """The same for the paper's network."""
    torch.manual_seed(1)
    net = PaperNet(9, 12)
    codes = torch.arange(64 * 108).remainder(4).view(64, 9, 12).to(torch.uint8)
    with torch.autocast("cpu", torch.bfloat16):
        logits, values = net(codes)
    (logits.float().log_softmax(1)[:, 0].mean() + values.float().square().mean()).backward()
    arrays = [
        logits.detach().float(),
        values.detach().float(),
        *(weight.grad for weight in net.parameters()),
    ]
    return hashlib.sha256(b"".join(array.numpy().tobytes() for array in arrays)).hexdigest()


def assert_same_run(metrics, expected, net, weights_sha256, rtol):
    """Bit for bit, or, as processors of equal digests can still differ in the last digits of a gradient step, within `rtol`."""
    found = [list(asdict(each).values()) for each in metrics]
    if found == expected:
        assert weights_digest(net) == weights_sha256
        return
    found, wanted = (
        np.array([[np.nan if value is None else value for value in each] for each in rows])
        for rows in (found, expected)
    )
    assert np.allclose(found, wanted, rtol=rtol, atol=1e-5, equal_nan=True)


def weights_digest(net):
    return hashlib.sha256(
        b"".join(each.contiguous().numpy().tobytes() for each in net.state_dict().values())
    ).hexdigest()


@pytest.fixture
def folder(tmp_path):
    return Path(shutil.copytree(FIXTURES / "old_run", tmp_path / "old_run"))


def test_a_run_of_the_first_format_goes_on_to_the_weights_it_would_have_come_to(folder):
    expected = json.loads((FIXTURES / "expected.json").read_text())
    weights = load_checkpoint(folder / "checkpoint.pt")["run"]["net"]
    is_same_arithmetic = arithmetic_digest(weights) == expected["probe_sha256"]
    run, metrics = begin(), []
    run_folder = RunFolder(
        folder, run, {"summary": "resumed"}, lambda update, seconds: metrics.append(update)
    )
    run_folder.resume()
    assert run.updates_done == 3
    ppo.train(run, run_folder.on_update)
    run_folder.save()
    lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    assert [line["moves"] for line in lines] == [128 * (k + 1) for k in range(6)]
    assert all(set(line) == set(lines[0]) >= set(LOG_COLUMNS.values()) for line in lines)
    assert load_checkpoint(folder / "checkpoint.pt")["run"]["updates_done"] == 6
    if not is_same_arithmetic:
        pytest.skip(
            "this processor or version of torch rounds bfloat16 in another way than the one of the fixture"
        )
    assert_same_run(metrics, expected["updates"], run.net, expected["weights_sha256"], rtol=1e-4)


def test_what_a_checkpoint_of_the_first_format_holds_is_loaded_bit_for_bit(folder):
    old = torch.load(folder / "checkpoint.pt", weights_only=True)["run"]
    run = begin()
    RunFolder(folder, run, {}, lambda *_: None).resume()
    state = run.state_dict()
    assert (state["updates_done"], [state["ent_coef"], state["kl_coef"]]) == (
        old["done"],
        old["shares"],
    )
    assert torch.equal(state["rng_state"], old["random"])
    assert all(
        torch.equal(*both) for both in zip(state["net"].values(), old["net"].values(), strict=True)
    )
    for now, before in zip(
        state["optimizer"]["state"].values(), old["optimiser"]["state"].values(), strict=True
    ):
        assert all(
            torch.equal(now[name], before[name]) for name in ("step", "exp_avg", "exp_avg_sq")
        )
    for now, before in zip(state["envs"], old["boards"], strict=True):
        assert torch.equal(now["arrays"]["cells"], before["places"])
        assert all(
            torch.equal(now["arrays"][name], array) for name, array in before["arrays"].items()
        )
        assert all(
            torch.equal(now["worlds"][name], before["worlds"][name])
            for name in ("codes", "outcomes")
        )
        records = now["worlds"][
            "records"
        ]  # have got two scalars since: the cells that count, and how many are enough
        assert torch.equal(
            torch.cat([records[:, :6], records[:, 8:]], 1), before["worlds"]["records"]
        )
        assert (records[:, 6] == 108).all()
        assert (records[:, 7] == 107).all()
        assert {name: now["recent_episodes"][name] for name in before["recent"]} == before["recent"]


def test_a_checkpoint_of_the_first_format_is_refused_by_another_run(folder):
    other = TrainingRun.begin(
        replace(CONFIG, clip_coef=0.3), ENV_CONFIGS, 6 * CONFIG.batch_size, SEED
    )
    with pytest.raises(ValueError, match=r"another run \(config\)"):
        RunFolder(folder, other, {}, lambda *_: None).resume()


def test_the_old_names_of_a_configuration_are_read_from_checkpoints_and_cards():
    old = {
        "name": "paper", "pace": 0.0, "boards": 20, "horizon": 200, "epochs": 30, "minibatch": 128, "clip": 0.3, "rate": 5e-5,
        "final_rate": 5e-5, "curiosity": None, "kl_share": 0.2, "kl_target": 0.01, "value_share": 1.0, "value_clip": 10.0,
        "gamma": 0.95, "lam": 0.95, "value_updates": 0, "max_grad": None,
    }  # fmt: skip
    now = TrainConfig.from_dict(current_recipe(old))
    assert now == TrainConfig.from_dict(now.to_dict())
    assert (now.network, now.vf_clip, now.vf_change_clip, now.kl_of_last_epoch) == (
        "rllib",
        10.0,
        float("inf"),
        False,
    )
    assert not now.mask
    assert (now.update_epochs, now.minibatch_size, now.max_grad_norm) == (30, 128, float("inf"))
    assert TrainConfig.from_dict(RECIPES["best"].to_dict()) == RECIPES["best"]
    with pytest.raises(ValueError, match="of a later version"):
        TrainConfig.from_dict({**RECIPES["best"].to_dict(), "momentum": 0.9})


def test_a_run_of_the_recipe_paper_before_its_correction_goes_on_with_the_loss_that_it_began_with(
    tmp_path,
):
    expected = json.loads((FIXTURES / "expected_paper.json").read_text())
    is_same_arithmetic = paper_arithmetic_digest() == expected["probe_sha256"]
    env_configs = [EnvConfig(rows=9, cols=12, max_steps=20)]

    def begun(config):
        run = TrainingRun.begin(config, env_configs, 6 * config.batch_size, 5)
        return run, RunFolder(tmp_path, run, {}, lambda *_: None)

    def stop(*_):
        raise KeyboardInterrupt

    first, folder = begun(TrainConfig.from_dict(expected["recipe"]))
    with pytest.raises(KeyboardInterrupt):
        ppo.train(first, stop)
    folder.save()
    checkpoint = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    identity = json.loads(checkpoint["identity"]) | {
        "config": expected["recipe"]
    }  # the settings that there were
    torch.save({**checkpoint, "identity": json.dumps(identity)}, tmp_path / "checkpoint.pt")
    assert resumed_config(tmp_path, RECIPES["best"]) == RECIPES["best"]
    second, folder = begun(resumed_config(tmp_path, RECIPES["paper"]))
    folder.resume()
    metrics = []
    ppo.train(second, metrics.append)
    if not is_same_arithmetic:
        pytest.skip(
            "this processor or version of torch rounds bfloat16 in another way than the one of the fixture"
        )
    assert_same_run(
        metrics, expected["updates"][1:], second.net, expected["weights_sha256"], rtol=1e-2
    )
    assert second.kl_coef == expected["kl_coef"]
