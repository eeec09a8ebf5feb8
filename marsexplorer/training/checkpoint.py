"""The file that `--resume` goes on from: tensors, numbers and lists, no pickled code.

    version    FORMAT_VERSION
    identity   JSON: what must agree for the checkpoint to go on in a run (`TrainingRun.identity`)
    run        `TrainingRun.state_dict`
    seconds    that the run has taken

Checkpoints without a version are of the first format. `convert` reads them into the present one; the conversion only renames,
so a run that began before goes on to the same weights, bit for bit.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch

FORMAT_VERSION = 2

CONFIG_FIELDS = {
    "pace": "reward_per_cell",
    "boards": "num_envs",
    "horizon": "num_steps",
    "epochs": "update_epochs",
    "minibatch": "minibatch_size",
    "clip": "clip_coef",
    "rate": "learning_rate",
    "final_rate": "final_learning_rate",
    "curiosity": "target_entropy",
    "kl_share": "kl_coef",
    "value_share": "vf_coef",
    "value_clip": "vf_clip",
    "lam": "gae_lambda",
    "value_updates": "value_warmup_updates",
    "max_grad": "max_grad_norm",
}
"""Name of a training configuration's field in the first format -> its name now; the other names are the same."""


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Return the checkpoint in a file in the present format, whichever format the file has."""
    checkpoint: dict[str, Any] = torch.load(path, weights_only=True)
    return checkpoint if "version" in checkpoint else convert(checkpoint)


def convert(checkpoint: dict[str, Any]) -> dict[str, Any]:
    """Return a checkpoint of the first format in the present one."""
    return {
        "version": FORMAT_VERSION,
        "identity": json.dumps(_converted_identity(json.loads(checkpoint["identity"]))),
        "run": _converted_run(checkpoint["run"]),
        "seconds": checkpoint["seconds"],
    }


def convert_config(fields: dict[str, Any]) -> dict[str, Any]:
    """Return a training configuration's fields, as a checkpoint or a policy's card holds them, by their present names."""
    return {CONFIG_FIELDS.get(name, name): value for name, value in fields.items()}


def _converted_identity(identity: dict[str, Any]) -> dict[str, Any]:
    return {
        "config": convert_config(identity["recipe"]),
        "env_configs": identity["configs"],
        "seed": identity["seed"],
        "num_updates": identity["updates"],
    }


def _converted_run(state: dict[str, Any]) -> dict[str, Any]:
    ent_coef, kl_coef = state["shares"]
    return {
        "updates_done": state["done"],
        "ent_coef": ent_coef,
        "kl_coef": kl_coef,
        "net": state["net"],
        "optimizer": state["optimiser"],
        "envs": [_converted_envs(part) for part in state["boards"]],
        "rng_state": state["random"],
    }


def _converted_envs(state: dict[str, Any]) -> dict[str, Any]:
    arrays = {**state["arrays"], "cells": state["places"]}
    return {"arrays": arrays, "worlds": state["worlds"], "recent_episodes": state["recent"]}
