"""Which actions an environment allows: `action_mask` in its info or its observation, or its method `action_masks`."""

from __future__ import annotations

from collections.abc import Mapping

import gymnasium
import numpy as np
from numpy.typing import NDArray

NAME, METHOD = "action_mask", "action_masks"
"""The key in info and observation as Taxi has it, and the method as sb3-contrib asks for it."""

Mask = NDArray[np.bool_]


def mask_of(
    env: gymnasium.Env[object, object], observation: object, info: Mapping[str, object], count: int
) -> Mask | None:
    """Return which of `count` actions are allowed.

    Returns:
        bool[count]; None if the environment says nothing, or allows nothing: then any may be chosen.

    Raises:
        ValueError: The mask does not fit the actions.
    """
    if NAME in info:
        told = info[NAME]
    elif isinstance(observation, Mapping) and NAME in observation:
        told = observation[NAME]
    elif env.has_wrapper_attr(METHOD):
        told = env.get_wrapper_attr(METHOD)()
    else:
        return None
    mask = np.asarray(told).astype(bool)
    if mask.shape != (count,):
        raise ValueError(
            f"expected an {NAME} of shape {(count,)}, a truth value for each action, got {mask.shape}: "
            "a wrapper that changes the actions must change it too"
        )
    return mask if mask.any() else None


def allowed_in(mask: Mask | None) -> tuple[int, ...] | None:
    """Return the codes of the allowed actions; None if all are."""
    return None if mask is None or mask.all() else tuple(map(int, np.flatnonzero(mask)))
