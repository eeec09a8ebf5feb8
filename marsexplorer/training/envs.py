"""Environments as a network in training sees them: stacks of boards of several levels and sizes, stepped as one.

No training terrain has a seed in EVALUATION_SEEDS: a run that drew one would stop. The whole state can be taken out and put
back, so that a run that was interrupted goes on exactly where it stood.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from marsexplorer.config import EnvConfig
from marsexplorer.policies.network.features import Perception
from marsexplorer.rules import R_MOVE
from marsexplorer.vector import MarsExplorerVector

EVALUATION_SEEDS = range(10**9, 10**9 + 10**6)
"""Seeds that are for evaluation: training refuses them."""

Inputs = tuple[Tensor, ...]
"""What a network is given for a batch of boards, each [boards, ...]."""
View = Callable[[NDArray[np.uint8], NDArray[np.int64], NDArray[np.uint8], NDArray[np.int64]], Inputs]
"""(codes, places, visited, headings) of some boards -> what the network is given."""


def pictures(config: EnvConfig, num: int) -> View:
    """Return the view of `policies.network.Net`: planes and numbers for each move."""
    eyes = Perception(num, config.rows, config.cols, config.sensor_radius)

    def view(*boards: NDArray[Any]) -> Inputs:
        planes, moves = eyes(*boards)
        return torch.from_numpy(planes), torch.from_numpy(moves)

    return view


def matrix(config: EnvConfig, num: int) -> View:
    """Return the view of `policies.paper_network.PaperNet`: the codes of the state matrix (eq. 6) alone."""
    del config, num
    return lambda codes, places, visited, headings: (torch.from_numpy(codes),)


@dataclass
class Recent:
    """The last thousand episodes that ended in training, with sampled moves: steps, whether explored, return."""

    steps: deque[int] = field(default_factory=lambda: deque(maxlen=1000))
    explored: deque[bool] = field(default_factory=lambda: deque(maxlen=1000))
    returns: deque[float] = field(default_factory=lambda: deque(maxlen=1000))


@dataclass(frozen=True)
class Step:
    """What a move brought: rewards float64[num] of eq. 8; ended, explored bool[num].

    late   of boards that ran out of time: their indices, and the inputs of their last observations; None without any
    """

    rewards: NDArray[np.float64]
    ended: NDArray[np.bool_]
    explored: NDArray[np.bool_]
    late: tuple[NDArray[np.intp], Inputs] | None


class Boards:
    """A stack of environments with what a network needs of each: cells stood on, headings, its view."""

    def __init__(self, config: EnvConfig, num: int, seed: int, view: Callable[[EnvConfig, int], View] = pictures) -> None:
        options: dict[str, Any] = {"level": config.level, "size": (config.rows, config.cols), "observation": "uint8"}
        options |= {"sensor_radius": config.sensor_radius, "max_steps": config.max_steps}
        env = gymnasium.make_vec("MarsExplorer-v0", num_envs=num, vectorization_mode="vector_entry_point", **options)
        assert isinstance(env, MarsExplorerVector)
        self.env, self.num, self.config = env, num, config
        self._make_view, self._view = view, view(config, num)
        self.recent = Recent()
        self.codes, info = env.reset(seed=seed)
        refuse_evaluation_seeds(info["terrain_seed"])
        self.visited: NDArray[np.uint8] = np.zeros((num, config.n), np.uint8)
        self.headings: NDArray[np.int64] = np.ones(num, np.int64)
        self.steps: NDArray[np.int64] = np.zeros(num, np.int64)
        self.returns: NDArray[np.float64] = np.zeros(num)
        self._stand(info["position"])

    def _stand(self, positions: NDArray[np.int64]) -> None:
        self.places = positions[:, 0] * self.config.cols + positions[:, 1]
        self.visited[np.arange(self.num), self.places] = 1

    def look(self) -> Inputs:
        """Return what the network is given of all boards; the arrays change with the next look."""
        return self._view(self.codes, self.places, self.visited, self.headings)

    def step(self, actions: NDArray[np.int64]) -> Step:
        """Make one move on every board; what ended begins anew."""
        self.codes, rewards, terminated, truncated, info = self.env.step(actions)
        self.headings, self.steps, self.returns = actions, self.steps + 1, self.returns + rewards
        ended = terminated | truncated
        explored, late = np.zeros(self.num, np.bool_), None
        if ended.any():
            explored = ended & (info["final_info"]["outcome"] == "explored")  # the column holds older endings too
            self.recent.steps += self.steps[ended].tolist()
            self.recent.explored += explored[ended].tolist()
            self.recent.returns += self.returns[ended].tolist()
            if truncated.any():
                late = self._look_back(np.flatnonzero(truncated), info)
            refuse_evaluation_seeds(info["terrain_seed"])
            self.visited[ended], self.steps[ended], self.returns[ended] = 0, 0, 0
            self.headings = np.where(ended, 1, actions)
        self._stand(info["position"])
        return Step(rewards, ended, explored, late)

    def _look_back(self, which: NDArray[np.intp], info: dict[str, Any]) -> tuple[NDArray[np.intp], Inputs]:
        """Return the boards that ran out of time and the inputs of their last observations."""
        positions = info["final_info"]["position"][which]
        places = positions[:, 0] * self.config.cols + positions[:, 1]
        visited = self.visited[which]
        visited[np.arange(len(which)), places] = 1
        codes = np.stack([info["final_obs"][i] for i in which])
        return which, self._make_view(self.config, len(which))(codes, places, visited, self.headings[which])

    def state(self) -> dict[str, Any]:
        """Return everything that changes, as tensors and lists."""
        arrays = {name: torch.from_numpy(getattr(self, name).copy()) for name in ("visited", "headings", "steps", "returns")}
        worlds = {name: torch.from_numpy(array) for name, array in self.env.snapshot().items()}
        recent = {name: list(values) for name, values in vars(self.recent).items()}
        return {"arrays": arrays, "worlds": worlds, "places": torch.from_numpy(self.places.copy()), "recent": recent}

    def restore(self, state: dict[str, Any]) -> None:
        """Return with everything as `state` says."""
        for name, tensor in state["arrays"].items():
            setattr(self, name, tensor.numpy().copy())
        self.codes = self.env.restore({name: tensor.numpy() for name, tensor in state["worlds"].items()})
        self.places = state["places"].numpy().copy()
        for name, values in state["recent"].items():
            getattr(self.recent, name).extend(values)


class Stacks:
    """Several Boards as one: all of them look and step together."""

    def __init__(self, parts: Sequence[Boards]) -> None:
        self.parts = list(parts)
        self.num = sum(part.num for part in parts)
        self._cuts = np.cumsum([part.num for part in parts])[:-1]

    def look(self) -> Inputs:
        """Return the inputs of all boards, part by part."""
        return tuple(torch.cat(each) for each in zip(*(part.look() for part in self.parts), strict=True))

    def step(self, actions: NDArray[np.int64]) -> list[Step]:
        """Make one move on every board; return the parts' steps."""
        return [part.step(own) for part, own in zip(self.parts, np.split(actions, self._cuts), strict=True)]


def in_moves(config: EnvConfig, step: Step, pace: float) -> NDArray[np.float64]:
    """Return a step's rewards told in moves: `pace` for each new cell, -1 for the move; float64[num].

    Undiscounted they rank explorations as eq. 8 does, by the number of moves, but they are of one magnitude at every size.
    """
    return pace * (step.rewards + R_MOVE - config.r_bonus * step.explored) - 1.0


def refuse_evaluation_seeds(seeds: NDArray[np.int64]) -> None:
    """Raise ValueError when a training terrain is one of those kept for evaluation."""
    kept = (seeds >= EVALUATION_SEEDS.start) & (seeds < EVALUATION_SEEDS.stop)
    if kept.any():
        raise ValueError(f"training met seed {int(seeds[kept][0])}, which is kept for evaluation; train with another seed")
