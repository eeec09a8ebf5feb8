"""Whole numbers from 0 as codes of an environment's discrete actions."""

from __future__ import annotations

import math
from collections.abc import Mapping

import gymnasium
import numpy as np
from numpy.typing import NDArray

MAX_ACTIONS = 64
"""Most actions: each has a button on a phone."""
ADAPTERS = "humanplay.tasks.gymnasium.adapters"
MASK, METHOD = "action_mask", "action_masks"
"""The key of a mask in info or observation (as Taxi's), and the method (as sb3-contrib's)."""

Mask = NDArray[np.bool_]


class ActionCodes:
    """Codes 0, 1, 2, ... of discrete actions.

    An action may be one number, which need not begin at 0, or several numbers or bits.

    Attributes:
        space: The environment's own space.
        count: How many codes there are.
    """

    def __init__(self, env_id: str, space: object) -> None:
        """Take a space.

        Raises:
            ValueError: If its actions are not discrete, or too many; the text names a wrapper.
        """
        self.space = space
        self._form: tuple[np.dtype[np.generic], tuple[int, ...]] | None = None
        if isinstance(space, gymnasium.spaces.Discrete):
            sizes, self._starts = [int(space.n)], np.array([space.start])
        elif isinstance(space, gymnasium.spaces.MultiDiscrete):
            sizes, self._form = (
                [int(size) for size in space.nvec.ravel()],
                (space.dtype, space.shape),
            )
            starts = getattr(space, "start", None)
            self._starts = np.zeros(len(sizes), int) if starts is None else starts.ravel()
        elif isinstance(space, gymnasium.spaces.MultiBinary):
            count, self._form = math.prod(space.shape), (space.dtype, space.shape)
            sizes, self._starts = [2] * count, np.zeros(count, int)
        else:
            raise ValueError(_refusal(env_id, space))
        self._sizes = tuple(sizes)
        self.count = math.prod(sizes)
        if self.count > MAX_ACTIONS:
            raise ValueError(_refusal(env_id, space))

    def own(self, code: int) -> int | NDArray[np.generic]:
        """The environment's own action of a code."""
        parts = np.array(np.unravel_index(code, self._sizes)) + self._starts
        if self._form is None:
            return int(parts[0])
        dtype, shape = self._form
        action: NDArray[np.generic] = parts.astype(dtype).reshape(shape)
        return action

    def of_own(self, action: object) -> int:
        """The code of an environment's own action; ValueError if there is none."""
        parts = np.asarray(action)
        if parts.size != len(self._sizes) or not np.array_equal(parts, parts.astype(int)):
            raise ValueError(f"expected an action of {self.space}, got {action}")
        parts = parts.astype(int).ravel() - self._starts
        if (parts < 0).any() or (parts >= self._sizes).any():
            raise ValueError(f"expected an action of {self.space}, got {action}")
        return int(np.ravel_multi_index(tuple(parts), self._sizes))

    def names(self) -> tuple[str, ...]:
        """Names of actions that nobody has named: the numbers of the environment's own."""
        actions = [np.ravel(self.own(code)).tolist() for code in range(self.count)]
        return tuple("_".join(map(str, parts)).replace("-", "minus_") for parts in actions)

    def mask_of(
        self, env: gymnasium.Env[object, object], observation: object, info: Mapping[str, object]
    ) -> Mask | None:
        """Which actions the environment allows now.

        Returns:
            bool[count]; None if the environment says nothing, or allows nothing: then any may be
            chosen.

        Raises:
            ValueError: If the mask does not fit the actions.
        """
        if MASK in info:
            env_mask = info[MASK]
        elif isinstance(observation, Mapping) and MASK in observation:
            env_mask = observation[MASK]
        elif env.has_wrapper_attr(METHOD):
            env_mask = env.get_wrapper_attr(METHOD)()
        else:
            return None
        mask = self._mask(env_mask)
        return mask if mask.any() else None

    def _mask(self, env_mask: object) -> Mask:
        """bool[count] of an environment's mask.

        Args:
            env_mask: Of all actions. For actions of several numbers also a mask for each number, in
                a tuple or one after the other.
        """
        if isinstance(env_mask, tuple):
            env_mask = np.concatenate([np.ravel(part) for part in env_mask])
        mask = np.asarray(env_mask).astype(bool).ravel()
        if mask.shape == (self.count,):
            return mask
        if len(self._sizes) > 1 and mask.shape == (sum(self._sizes),):
            parts = np.split(mask, np.cumsum(self._sizes)[:-1])
            indices = [np.unravel_index(code, self._sizes) for code in range(self.count)]
            return np.array([
                all(part[number] for part, number in zip(parts, index, strict=True))
                for index in indices
            ])  # fmt: skip
        raise ValueError(
            f"expected an {MASK} of shape {(self.count,)}, a truth value for each action, got {mask.shape}: "
            "a wrapper that changes the actions must change it too"
        )


def allowed_in(mask: Mask | None) -> tuple[int, ...] | None:
    """The codes of the allowed actions; None if all are."""
    return None if mask is None or mask.all() else tuple(map(int, np.flatnonzero(mask)))


def _refusal(env_id: str, space: object) -> str:
    """Say that a space is not played, and which wrapper helps."""
    way = "name a wrapper of your own that has discrete actions"
    if isinstance(space, gymnasium.spaces.Discrete):
        way = f'wrappers = ["{ADAPTERS}:FirstActions"] in its file offers the first {MAX_ACTIONS}'
    elif isinstance(
        space,
        gymnasium.spaces.Box | gymnasium.spaces.MultiDiscrete | gymnasium.spaces.MultiBinary,
    ):
        way = f'wrappers = ["{ADAPTERS}:OneAtATime"] in its file offers one number at a time'
    return f"expected up to {MAX_ACTIONS} discrete actions, {env_id} has {space}; {way}"
