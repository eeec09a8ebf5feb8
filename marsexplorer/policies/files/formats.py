"""The formats of policy files, and how older ones become the newest: only names change, no number does.

marsexplorer-network-2 became -3 when the tensors and the keys of the card took the field's names; marsexplorer-paper-1 became
-2 with the card alone. Older files are converted as they are read, so they play exactly as before; `convert_file` writes the
newest format.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

NETWORK_FORMAT = "marsexplorer-network-3"
PRICED_NETWORK_FORMAT = "marsexplorer-network-4"
"""Of networks that see prices; not a newer form of NETWORK_FORMAT, whose files are given what they were trained on."""
PAPER_FORMAT = "marsexplorer-paper-2"
PAPER_NETWORK_FORMAT = "marsexplorer-paper-3"
"""Of the paper's four algorithms; not a newer form of PAPER_FORMAT, whose files stay as they are."""

NEWER_FORMATS = {"marsexplorer-network-2": NETWORK_FORMAT, "marsexplorer-paper-1": PAPER_FORMAT}
"""Older format -> what it is converted to."""

NEWER_TENSORS = {"gist": "trunk", "judge": "policy_head", "worth": "value_head"}
"""First part of a tensor's name in marsexplorer-network-2 -> in -3."""

NEWER_RECIPE_KEYS = {
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
"""Key of a training recipe as older cards and checkpoints have it -> as it is called now."""

NEWER_PLAN_KEYS = {
    "levels": "tasks_per_level",
    "episodes": "episodes_per_task",
    "each": "pairs_per_episode",
    "held": "anchor_sizes",
    "opening": "first_round_tasks",
    "first": "first_round_steps",
    "steps": "gradient_steps",
    "batch": "batch_size",
    "newest": "newest_pairs",
    "window": "max_pairs",
    "looks": "max_observations",
    "held_batch": "anchor_batch_size",
    "rate": "learning_rate",
    "opening_rate": "first_round_learning_rate",
    "decay": "weight_decay",
    "average": "ema_decay",
    "softer": "logit_scale",
    "hold_values": "vf_coef",
    "scale": "cost_scale",
    "max_grad": "max_grad_norm",
}
"""The same for the plan of a refinement."""

NEWER_KEYS = {"recipe": NEWER_RECIPE_KEYS, "plan": NEWER_PLAN_KEYS}
"""Part of a card -> its keys that were renamed."""


def current_recipe(recipe: dict[str, Any]) -> dict[str, Any]:
    """Return a training recipe with today's keys, in its order; keys that are today's already stay."""
    return {NEWER_RECIPE_KEYS.get(key, key): value for key, value in recipe.items()}


def current_card(card: dict[str, Any]) -> dict[str, Any]:
    """Return a card as the newest format has it; one of no older format is returned unchanged."""
    newer = NEWER_FORMATS.get(str(card.get("format")))
    return card if newer is None else {**_with_current_keys(card), "format": newer}


def current_tensor_names(file_format: object, names: list[str]) -> dict[str, str]:
    """Return {name in a file of this format: name in the newest}."""
    if file_format != "marsexplorer-network-2":
        return {name: name for name in names}
    parts = [(name, *name.partition(".")) for name in names]
    return {name: NEWER_TENSORS.get(first, first) + dot + rest for name, first, dot, rest in parts}


def convert_file(source: Path, target: Path) -> None:
    """Write a policy file of an older format in the newest: the same weights, byte for byte, under today's names."""
    data = source.read_bytes()
    end = 8 + int.from_bytes(data[:8], "little")
    header = json.loads(data[8:end])
    metadata = header.pop("__metadata__")
    card = json.loads(metadata["card"])
    names = current_tensor_names(card.get("format"), list(header))
    converted = {"__metadata__": {**metadata, "card": json.dumps(current_card(card), indent=1)}}
    text = json.dumps(
        converted | {names[name]: place for name, place in header.items()}, separators=(",", ":")
    ).encode()
    text += b" " * (-len(text) % 8)  # tensors begin at a multiple of 8 bytes
    target.write_bytes(len(text).to_bytes(8, "little") + text + data[end:])


def _with_current_keys(value: Any) -> Any:
    """Return a card's value with the keys of NEWER_KEYS renamed, also in the runs that it began with."""
    if isinstance(value, list):
        return [_with_current_keys(each) for each in value]
    if not isinstance(value, dict):
        return value
    card = {}
    for key, part in value.items():
        names = NEWER_KEYS.get(key, {}) if isinstance(part, dict) else {}
        inside = _with_current_keys(part)
        card[key] = (
            {names.get(name, name): each for name, each in inside.items()} if names else inside
        )
    return card
