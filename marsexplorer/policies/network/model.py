"""Trained networks: one small net that gives the four moves their logits, read from a file that carries its card.

A policy file is safetensors (never pickle): tensors named and shaped as `Net` has them, and the card, JSON, in its metadata.
Files are checked before a weight is used, and whatever is not as expected is refused with a sentence.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar
from weakref import WeakValueDictionary

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from marsexplorer.observation import valid_actions
from marsexplorer.policies.base import INVALID_LOGIT, Memory, Policy, begin_draws, draw_action
from marsexplorer.policies.files.card import FORMAT, read_card, refuse
from marsexplorer.policies.files.weights import read_weights
from marsexplorer.policies.guard import LoopGuard
from marsexplorer.policies.network.features import (
    ACTION_FEATURES,
    MOVE_NUMBERS,
    PICTURE_CELLS,
    PLANES,
    RememberedFeatures,
)
from marsexplorer.policies.network.priced_features import NUMBERS_PER_RULE, RULES
from marsexplorer.policies.network.prior import prior_logits, prior_weights, size_nearness

ACTS = ("greedy with guard", "greedy", "samples")
"""How a network's policy chooses its moves."""
NEGLIGIBLE_SHARE = 1e-5
"""Weights of the prior that count less than this at a size only count by rounding."""


class Net(nn.Module):
    """Give each move a logit by one head shared among them, from a trunk over the pictures and from the move's own features.

    forward(planes uint8[b, PLANES, PICTURE_CELLS], moves float32[b, 4, MOVE_NUMBERS])
        -> logits float32[b, 4] (INVALID_LOGIT for invalid moves), value float32[b]

    prior  float32[SIDES, MOVE_NUMBERS], the weights that add the logits of priced rules, see `prior`
    """

    def __init__(self, wide: int = 384, hidden: int = 128) -> None:
        super().__init__()
        self.trunk = nn.Sequential(
            nn.Linear(PLANES * PICTURE_CELLS, wide), nn.ReLU(), nn.Linear(wide, hidden), nn.ReLU()
        )
        self.policy_head = nn.Sequential(
            nn.Linear(hidden + MOVE_NUMBERS + 4, 64), nn.ReLU(), nn.Linear(64, 1)
        )
        self.value_head = nn.Sequential(
            nn.Linear(hidden + 4 * MOVE_NUMBERS, 64), nn.ReLU(), nn.Linear(64, 1)
        )
        initialize_orthogonal(self)
        nn.init.orthogonal_(self.policy_head[-1].weight, 0.01)  # type: ignore[arg-type]
        self.prior = nn.Parameter(prior_weights())

    def forward(self, planes: Tensor, moves: Tensor) -> tuple[Tensor, Tensor]:
        hidden = self.trunk(planes.flatten(1).to(moves.dtype) * (1 / 255))
        batch = len(planes)
        which = torch.eye(4, dtype=moves.dtype, device=moves.device).expand(batch, 4, 4)
        each = torch.cat([hidden[:, None].expand(batch, 4, -1), moves, which], dim=2)
        logits = self.policy_head(each).squeeze(2).float()
        logits = logits + prior_logits(moves, self.prior)
        value = self.value_head(torch.cat([hidden, moves.flatten(1)], dim=1)).squeeze(1).float()
        return logits.masked_fill(moves[:, :, 0] < 0.5, INVALID_LOGIT), value * 5

    def rules_that_count(self, rows: int, cols: int) -> tuple[int, ...]:
        """Return the rules of `priced_features` whose numbers this network weighs at this size, as indices into RULES.

        Where every weight of a rule's numbers is 0 the network gives the same bits without them. At 84 x 84 rounding leaves
        the weights for 42 x 42 a share of 1e-7, which is left out too. While a network learns, its weights change: what is
        recorded to learn from has the numbers of all rules.
        """
        with torch.no_grad():
            numbers = MOVE_NUMBERS
            state = self.state_dict()
            policy, value = state["policy_head.0.weight"], state["value_head.0.weight"]
            hidden = policy.shape[1] - numbers - 4
            weights = [
                policy[:, hidden : hidden + numbers],
                *value[:, hidden:].split(numbers, dim=1),
            ]
            is_near = size_nearness(torch.tensor(math.log(rows * cols))) > NEGLIGIBLE_SHARE
            used = torch.cat([*weights, state["prior"][is_near]]).ne(0).any(0)[ACTION_FEATURES:-1]
            return tuple(
                int(rule) for rule in used.view(len(RULES), NUMBERS_PER_RULE).any(1).nonzero()
            )

    def infer(
        self, planes: NDArray[np.uint8], moves: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return (logits float32[b, 4], values float32[b]) of boards given as arrays, computed on one thread.

        Several threads would wait for one another on a busy machine.
        """
        if torch.get_num_threads() != 1:
            torch.set_num_threads(1)
        with torch.inference_mode():
            logits, values = self(torch.from_numpy(planes), torch.from_numpy(moves))
        return logits.numpy(), values.numpy()


AnyNet = TypeVar("AnyNet", bound=nn.Module)


class InfersLogits(Protocol):
    """What a NetworkPolicy asks: `Net`, or its like in another runtime."""

    def rules_that_count(self, rows: int, cols: int) -> Sequence[int] | None:
        """Return the `rules` of `FeatureExtractor` that it needs on boards of this size; None: all."""

    def infer(
        self, planes: NDArray[np.uint8], moves: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return (logits float32[b, 4], values float32[b]) of what `FeatureExtractor` gives."""


def initialize_orthogonal(net: nn.Module) -> None:
    """Draw every layer's weights orthogonal with gain sqrt 2 and set the biases to zero (Saxe et al. 2014)."""
    for module in net.modules():
        if isinstance(module, (nn.Linear, nn.Conv2d)):
            nn.init.orthogonal_(module.weight, 2**0.5)
            assert module.bias is not None
            nn.init.zeros_(module.bias)


class NetworkPolicy:
    """Take the move with the network's highest logit, or draw it; remember the cells visited.

    net        the network, which several policies may share
    acts       one of ACTS; the seed of `reset` fixes what "samples" draws
    thought()  after `act`: probabilities float32[4] of the moves, and the value, as the network judged the last observation
    """

    def __init__(
        self, name: str, net: InfersLogits, sensor_radius: int, acts: str = ACTS[0]
    ) -> None:
        self.name = name
        self.net = net
        self.has_value = getattr(net, "has_value", True)
        self._memory, self._samples = Memory(), acts == "samples"
        self._guard = LoopGuard(sensor_radius) if acts == "greedy with guard" else None
        self._features = RememberedFeatures(sensor_radius, net.rules_that_count)
        self._thought: tuple[NDArray[np.float32], float] = (np.full(4, 0.25, np.float32), 0.0)
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the episode; the seed fixes what is drawn in the next."""
        self._draws = begin_draws(seed)
        self._memory.forget()
        if self._guard is not None:
            self._guard.reset()

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3."""
        logits, values = self.net.infer(*self.extract_features(observation))
        return self.choose(logits[0], float(values[0]))

    def extract_features(
        self, observation: NDArray[Any]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Remember an observation and return (planes, moves) of one board; the arrays change with the next."""
        self._memory.observe(observation)
        return self._features(self._memory)

    def choose(self, logits: NDArray[np.float32], value: float) -> int:
        """Return the action for the last observation: the one of the highest logit, unless the guard takes over.

        logits  float32[4]; value is kept for `thought`
        """
        memory = self._memory
        shares = np.exp(logits - logits.max())
        self._thought = shares / shares.sum(), value
        if self._samples:
            return draw_action(self._thought[0], self._draws)
        overruled = None if self._guard is None else self._guard.overrule(memory)
        if overruled is not None:
            return overruled
        action = int(logits.argmax())
        return (
            action
            if logits[action] > INVALID_LOGIT
            else next(iter(valid_actions(memory.codes, *memory.position)), 0)
        )

    def goal(self) -> tuple[int, int] | None:
        """Return the cell (row, col) that the loop guard goes to; None where the network chose the last action."""
        return None if self._guard is None else self._guard.goal()

    def thought(self) -> tuple[NDArray[np.float32], float]:
        """Return (probabilities float32[4], value) of the last observation."""
        return self._thought


def load_net(path: Path) -> Net:
    """Return the network in a policy file; PolicyFileError when the file is none of ours."""
    found = read_card(path).get("format")
    if found != FORMAT:
        raise refuse(path, f"the format {FORMAT}", repr(found)[:60])
    net = Net()
    read_weights(net, path)
    return net.eval()


def load_network(path: Path, sensor_radius: int) -> Policy:
    """Return the policy in a file, named after the file; policies of one unchanged file share a network.

    Boards that share a network can be decided together (see `batch`).
    """
    return NetworkPolicy(path.stem, load_shared(path, load_net), sensor_radius)


def load_shared(path: Path, load: Callable[[Path], AnyNet]) -> AnyNet:
    """Return the network in a file, the one of the last call as long as it is in use and the file has not changed."""
    state = path.stat()
    key = (str(path.resolve()), state.st_mtime_ns, state.st_size)
    net = _NETS.get(key)
    if net is None:
        net = _NETS[key] = load(path)
    return net  # type: ignore[return-value]


_NETS: WeakValueDictionary[tuple[str, int, int], nn.Module] = WeakValueDictionary()
