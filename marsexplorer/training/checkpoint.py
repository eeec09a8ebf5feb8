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

from marsexplorer.policies.files.formats import current_recipe, current_tensor_names

FORMAT_VERSION = 2


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


def _converted_identity(identity: dict[str, Any]) -> dict[str, Any]:
    return {
        "config": current_recipe(identity["recipe"]),
        "env_configs": identity["configs"],
        "seed": identity["seed"],
        "num_updates": identity["updates"],
    }


def _converted_run(state: dict[str, Any]) -> dict[str, Any]:
    ent_coef, kl_coef = state["shares"]
    names = current_tensor_names(
        "marsexplorer-network-2", list(state["net"])
    )  # the paper's network has none of these names
    return {
        "updates_done": state["done"],
        "ent_coef": ent_coef,
        "kl_coef": kl_coef,
        "net": {names[name]: tensor for name, tensor in state["net"].items()},
        "optimizer": state["optimiser"],
        "envs": [_converted_envs(part) for part in state["boards"]],
        "rng_state": state["random"],
    }


def _converted_envs(state: dict[str, Any]) -> dict[str, Any]:
    arrays = {**state["arrays"], "cells": state["places"]}
    return {"arrays": arrays, "worlds": state["worlds"], "recent_episodes": state["recent"]}
