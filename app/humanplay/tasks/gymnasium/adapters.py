"""Environments and wrappers that make others playable and exact.

A description names them: `humanplay.tasks.gymnasium.adapters:Crafter-v0` is Crafter, and
`"humanplay.tasks.gymnasium.adapters:Fresh"` is a wrapper.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from humanplay.tasks.gymnasium.codes import MAX_ACTIONS

Environment = gymnasium.Env[Any, Any]
ActionWrapper = gymnasium.ActionWrapper[Any, Any, Any]


class Fresh(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Makes a new environment for each episode.

    So nothing that `reset` leaves of the last episode, as BipedalWalker's does, has an effect.
    """

    _used = False

    def reset(self, **arguments: Any) -> Any:
        """Reset a new environment, or the first one if it is unused."""
        if self._used:
            self.env.close()
            assert self.env.spec is not None
            self.env = gymnasium.make(self.env.spec)
        self._used = True
        return self.env.reset(**arguments)


class OneAtATime(ActionWrapper):
    """Changes one number of an action at a time; the others stay at rest.

    Continuous numbers rest at 0 and go to their lowest or highest: action 0 changes none, 1 and 2
    the first, and so on. Whole numbers rest at their lowest, and take their other values in turn.
    """

    def __init__(self, env: Environment) -> None:
        super().__init__(env)
        self._rest, self._changes = _rest_of(env.action_space)
        self.action_space = gymnasium.spaces.Discrete(len(self._changes) + 1)

    def action(self, action: int) -> object:
        """The numbers of an action."""
        numbers = self._rest.copy()
        if action:
            which, number = self._changes[int(action) - 1]
            numbers.reshape(-1)[which] = number
        return numbers


def _rest_of(space: object) -> tuple[NDArray[np.generic], list[tuple[int, float]]]:
    """The numbers of a space at rest, and which can be changed to which."""
    if isinstance(space, gymnasium.spaces.Box):
        ends = zip(space.low.ravel(), space.high.ravel(), strict=True)
        changes = [(which, end) for which, both in enumerate(ends) for end in both]
        return np.zeros(space.shape, space.dtype), changes
    if isinstance(space, gymnasium.spaces.MultiBinary):
        sizes, lowest = [2] * int(np.prod(space.shape)), np.zeros(space.shape, space.dtype)
    elif isinstance(space, gymnasium.spaces.MultiDiscrete):
        sizes = space.nvec.ravel().tolist()
        lowest = np.broadcast_to(getattr(space, "start", 0), space.shape).astype(space.dtype)
    else:
        raise ValueError(f"expected an action of several numbers, got {space}")
    first = lowest.ravel()
    changes = [
        (which, first[which] + by) for which, size in enumerate(sizes) for by in range(1, size)
    ]
    return lowest, changes


class FirstActions(ActionWrapper):
    """The first actions of more than can be played."""

    def __init__(self, env: Environment) -> None:
        super().__init__(env)
        space = env.action_space
        if not isinstance(space, gymnasium.spaces.Discrete):
            raise ValueError(f"expected discrete actions, got {space}")
        count = min(MAX_ACTIONS, int(space.n))
        self.action_space = gymnasium.spaces.Discrete(count, start=int(space.start))

    def action(self, action: int) -> object:
        """The action itself."""
        return action


class _OrderedSet(dict[Any, None]):
    """A set in the order of insertion; Crafter's own have the order of addresses."""

    remove = dict.__delitem__

    def add(self, item: Any) -> None:
        self[item] = None


class Crafter(gymnasium.Env[Any, int]):
    """Crafter (Hafner 2021, arXiv 2109.06780; of Gym 0.21) made exact.

    As shipped, one seed and the same actions give different worlds. Here its sets keep their order;
    the picture is that of the last step, since its `render` draws random numbers; and each episode
    is a new environment, since its `reset` counts episodes. `info["unlocked"]` is how many
    achievements have been reached.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(self, seed: int = 0, size: int = 450, render_mode: str | None = None) -> None:
        import crafter

        self.render_mode = render_mode
        self._inner = crafter.Env(seed=seed % (2**31 - 1), size=(size, size))
        self._seed, self._size = seed, size
        self.action_space: Any = gymnasium.spaces.Discrete(len(self._inner.action_names))
        self.observation_space: Any = gymnasium.spaces.Box(0, 255, (size, size, 3), np.uint8)

    def get_action_meanings(self) -> list[str]:
        """The names of the actions."""
        return list(self._inner.action_names)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin the world of a seed, or of the last one; return its first picture."""
        self.__init__(self._seed if seed is None else seed, self._size, self.render_mode)  # type: ignore[misc]
        world, reset = self._inner._world, self._inner._world.reset

        def reset_in_order(seed: int | None = None) -> None:
            reset(seed)
            world._chunks = defaultdict(_OrderedSet)

        world.reset = reset_in_order
        self._frame = np.ascontiguousarray(self._inner.reset())
        return self._frame, {"unlocked": 0}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, int]]:
        """Make a move; the player's death terminates."""
        frame, reward, ended, info = self._inner.step(int(action))
        # Crafter's frame has its columns first in memory, and both hash and picture would turn it
        self._frame = np.ascontiguousarray(frame)
        counts: Iterable[int] = info["achievements"].values()
        unlocked = sum(count > 0 for count in counts)
        died = info["discount"] == 0
        truncated = bool(ended and not died)
        return self._frame, float(reward), died, truncated, {"unlocked": unlocked}

    def render(self) -> Any:
        """The picture of the last step."""
        return self._frame


gymnasium.register(
    "Crafter-v0", "humanplay.tasks.gymnasium.adapters:Crafter", max_episode_steps=10_000
)
