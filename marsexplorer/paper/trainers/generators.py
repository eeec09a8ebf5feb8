"""The random numbers that tianshou draws: torch's and numpy's global generators."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch


def seed_generators(seed: int) -> None:
    """Begin both generators anew."""
    torch.manual_seed(seed)
    np.random.seed(seed)  # the generator that tianshou draws from


def generators_state() -> dict[str, Any]:
    """Return the state of both generators, as tensors and numbers."""
    _, keys, position, has_gauss, gauss = np.random.get_state(legacy=True)
    return {
        "torch": torch.get_rng_state(),
        "numpy": torch.from_numpy(np.asarray(keys).astype(np.int64)),
        "numpy_position": [int(position), int(has_gauss), float(gauss)],
    }


def load_generators_state(state: dict[str, Any]) -> None:
    """Set both generators as `generators_state` returned them."""
    torch.set_rng_state(state["torch"])
    position, has_gauss, gauss = state["numpy_position"]
    np.random.set_state(
        ("MT19937", state["numpy"].numpy().astype(np.uint32), int(position), int(has_gauss), gauss)
    )
