"""Policies of the paper's four algorithms, from files whose card has the shape of the network and how it acts.

    acts "samples"            draws each move from the network's probabilities; the seed of `reset` fixes the draws
         "greedy"             takes the move of the highest logit or value
         "greedy with guard"  the same with the loop guard, which needs nothing but what has been seen

What `thought` says are probabilities of the moves. The softmax of values would be none: a network of values takes its best
move for certain, so its probabilities are 1 for that move and 0 for the others, before the guard has its say.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from marsexplorer.policies.base import Memory, Policy
from marsexplorer.policies.files.card import read_card, refuse
from marsexplorer.policies.files.formats import PAPER_NETWORK_FORMAT
from marsexplorer.policies.files.imported import wrong_size
from marsexplorer.policies.files.weights import read_weights, save_tensors
from marsexplorer.policies.guard import LoopGuard
from marsexplorer.policies.network.features import RememberedFeatures
from marsexplorer.policies.network.model import load_shared
from marsexplorer.policies.network.noisy import mean_weights
from marsexplorer.policies.network.paper_network import PaperNetwork, make_network
from marsexplorer.policies.network.shape import NetworkShape, ShapeError
from marsexplorer.random_numbers import mix

ACTS = ("samples", "greedy", "greedy with guard")


class PaperNetworkPolicy:
    """What the policies share: what the network is given, and what was thought of it.

    size       (rows, cols) of the boards it plays; None for every size
    thought()  after `act`: probabilities float32[4] of the moves as the network has them, and the value (NaN when none)
    """

    def __init__(self, name: str, net: PaperNetwork, sensor_radius: int) -> None:
        self.name, self.size = name, net.shape.size
        self._has_probabilities = net.shape.head == "policy"
        self._memory, self._features = Memory(), RememberedFeatures(sensor_radius)
        self._thought: tuple[NDArray[np.float32], float] = (
            np.full(4, 0.25, np.float32),
            float("nan"),
        )

    def thought(self) -> tuple[NDArray[np.float32], float]:
        """Return (probabilities float32[4], value) of the last observation."""
        return self._thought

    def _observe(self, observation: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """Remember an observation and return the network's arrays; ValueError for a board of another size."""
        if self.size is not None and observation.shape != self.size:
            raise ValueError(wrong_size(self.name, self.size, observation.shape))
        self._memory.observe(observation)
        if self.size is None:
            return self._features(self._memory)
        return (self._memory.codes[None].copy(),)

    def _note(self, scores: NDArray[np.float32], value: float) -> NDArray[np.float32]:
        """Keep the thought about scores float32[4] and return its probabilities."""
        if self._has_probabilities:
            shares = np.exp(scores - scores.max())
        else:
            shares = np.where(
                np.isnan(scores).any(), np.float32(np.nan), np.arange(4) == scores.argmax()
            )
        probabilities: NDArray[np.float32] = (shares / shares.sum()).astype(np.float32)
        self._thought = probabilities, value
        return probabilities


class SampledPolicy(PaperNetworkPolicy):
    """Draw each move from the network's probabilities.

    Over features the network computes in float64. Nothing in the training of an actor holds what its logits have in common:
    those of `sac-works` are about 2e10, where float32 is exact to 2,048, so that a processor's rounding would choose the moves.
    """

    def __init__(self, name: str, net: PaperNetwork, sensor_radius: int) -> None:
        super().__init__(name, net, sensor_radius)
        self._net = net.double() if self.size is None else net
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Begin an episode, whose draws the seed fixes."""
        self._memory.forget()
        self._random = np.random.Generator(np.random.PCG64(mix(seed)))

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3; ValueError for a board of another size than the network's."""
        arrays = self._observe(observation)
        if self.size is None:
            planes, moves = arrays
            arrays = planes, moves.astype(np.float64)
        scores, values = self._net.infer(*arrays)
        cumulative = np.cumsum(self._note(scores[0], float(values[0])), dtype=np.float64)
        return int(
            np.searchsorted(cumulative[:3], self._random.random() * cumulative[3], side="right")
        )


class GreedyPolicy(PaperNetworkPolicy):
    """Take the move of the highest score; boards that share a network can be decided together (see `batch`).

    guard  the loop guard, or None
    """

    def __init__(
        self, name: str, net: PaperNetwork, sensor_radius: int, guard: LoopGuard | None
    ) -> None:
        super().__init__(name, net, sensor_radius)
        self.net, self._guard = net, guard

    def reset(self, seed: int) -> None:
        """Forget the episode; nothing is drawn, so the seed has no effect."""
        del seed
        self._memory.forget()
        if self._guard is not None:
            self._guard.reset()

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3; ValueError for a board of another size than the network's."""
        scores, values = self.net.infer(*self.extract_features(observation))
        return self.choose(scores[0], float(values[0]))

    def extract_features(self, observation: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """Remember an observation and return the network's arrays of one board."""
        return self._observe(observation)

    def choose(self, logits: NDArray[np.float32], value: float) -> int:
        """Return the action for the last observation: the one of the highest score, unless the guard takes over."""
        self._note(logits, value)
        overruled = None if self._guard is None else self._guard.overrule(self._memory)
        return int(logits.argmax()) if overruled is None else overruled


def default_acts(shape: NetworkShape) -> str:
    """Return how a policy acts when its card does not say: a network of logits samples, one of values is greedy."""
    return "samples" if shape.head == "policy" else "greedy"


def check_acts(shape: NetworkShape, acts: object) -> str:
    """Return how a policy acts; ShapeError when its network cannot act so."""
    allowed = ACTS if shape.head == "policy" else ACTS[1:]
    if not isinstance(acts, str) or acts not in allowed:
        raise ShapeError(f'one of {", ".join(allowed)} as "acts" of the head {shape.head}', acts)
    return acts


def save_paper_network(
    net: PaperNetwork, shape: NetworkShape, path: Path, card: dict[str, Any]
) -> None:
    """Write the policy file of a network, whole or not at all; noisy layers are saved with their mean weights.

    card  what is told of the policy ("summary", "training", "results", ...); its "acts" is one of ACTS, and by default
          "samples" for the head "policy" and "greedy" for the others. The format and the shape are added.

    ValueError when the network has not the shape, or cannot act so.
    """
    acts = check_acts(shape, card.get("acts", default_acts(shape)))
    tensors = mean_weights(net)
    expected = {name: tensor.shape for name, tensor in _network_to_fill(shape).state_dict().items()}
    if {name: tensor.shape for name, tensor in tensors.items()} != expected:
        raise ValueError(
            f"expected a network of the shape {shape}, got one of another; give the shape that it was made from"
        )
    own = {name: value for name, value in card.items() if name != "format"}
    save_tensors(
        tensors, path, {**own, "network": shape.to_dict(), "acts": acts}, PAPER_NETWORK_FORMAT
    )


def _network_to_fill(shape: NetworkShape) -> PaperNetwork:
    """Return a network whose weights do not matter: torch's generator is left as it was, for a training may be under way."""
    with torch.random.fork_rng(devices=[]):
        return make_network(shape)


def load_paper_network(path: Path) -> PaperNetwork:
    """Return the network in a policy file, in evaluation mode; PolicyFileError when the file is none of this format."""
    shape, _ = _read_shape(path)
    net = _network_to_fill(shape)
    read_weights(net, path)
    return net.eval()


def load_paper_network_policy(path: Path, sensor_radius: int) -> Policy:
    """Return the policy in a file, named after the file; policies of one unchanged file share a network."""
    _, acts = _read_shape(path)
    net = load_shared(path, load_paper_network)
    if acts == "samples":
        return SampledPolicy(path.stem, net, sensor_radius)
    return GreedyPolicy(
        path.stem, net, sensor_radius, None if acts == "greedy" else LoopGuard(sensor_radius)
    )


def _read_shape(path: Path) -> tuple[NetworkShape, str]:
    """Return the shape of the network in a policy file, and how it acts."""
    card = read_card(path)
    if card.get("format") != PAPER_NETWORK_FORMAT:
        raise refuse(path, f"the format {PAPER_NETWORK_FORMAT}", repr(card.get("format"))[:60])
    try:
        shape = NetworkShape.from_dict(card.get("network"))
        return shape, check_acts(shape, card.get("acts", default_acts(shape)))
    except ShapeError as error:
        raise refuse(path, error.expected, error.came) from error
