"""Networks for the paper's four algorithms: a trunk and a head, built from a `NetworkShape`.

    head "policy"       PPO, A2C, and the actor of discrete SAC
    head "q"            the critics of discrete SAC
    head "categorical"  Rainbow: C51 (Bellemare et al. 2017), dueling (Wang et al. 2016), noisy (Fortunato et al. 2018)

`forward` takes what `training.envs` encodes: codes uint8[b, rows, cols] for the state matrix, or planes and moves.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from marsexplorer.policies.base import INVALID_LOGIT
from marsexplorer.policies.network.model import initialize_orthogonal
from marsexplorer.policies.network.noisy import NoisyLinear
from marsexplorer.policies.network.shape import NetworkShape
from marsexplorer.policies.network.trunks import (
    BOARD_INPUTS,
    MOVE_INPUTS,
    UNITS,
    initialize_xavier,
    invalid_moves,
    make_trunk,
    move_inputs,
)

STREAM_UNITS = 256
"""Units of the hidden layer in each stream of the categorical head over the state matrix."""
HEAD_UNITS = 64
"""Units of the hidden layer in a head over features."""

MakeLinear = Callable[[int, int], nn.Linear]


class PaperNetwork(nn.Module):
    """What the networks share; `shape` is what the network was built from."""

    def __init__(self, shape: NetworkShape) -> None:
        super().__init__()
        self.shape = shape
        self.trunk = make_trunk(shape)

    def evaluate(self, *observation: Tensor) -> tuple[Tensor, Tensor]:
        """Return (scores float32[b, 4], value float32[b]): the higher its score, the better a move; NaN when no value."""
        raise NotImplementedError

    def infer(self, *arrays: NDArray[Any]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return (scores float32[b, 4], values float32[b]) of observations given as arrays, computed on one thread."""
        if torch.get_num_threads() != 1:
            torch.set_num_threads(1)
        with torch.inference_mode():
            scores, values = self.evaluate(*(torch.from_numpy(array) for array in arrays))
        return scores.numpy(), values.numpy()

    def read_moves(
        self, head: nn.Module, hidden: Tensor, observation: tuple[Tensor, ...], outputs: int = 1
    ) -> Tensor:
        """Return what a head says of every move, [b, 4, outputs]: all at once, or one after the other over features."""
        found: Tensor = head(
            move_inputs(hidden, observation[1]) if len(observation) == 2 else hidden
        )
        return found.view(len(hidden), 4, outputs).float()

    def read_board(
        self, head: nn.Module, hidden: Tensor, observation: tuple[Tensor, ...]
    ) -> Tensor:
        """Return what a head says of the observation as a whole, [b, outputs]."""
        if len(observation) == 2:
            hidden = torch.cat([hidden, observation[1].flatten(1)], dim=1)
        found: Tensor = head(hidden)
        return found.float()

    def fill_invalid(self, scores: Tensor, observation: tuple[Tensor, ...]) -> Tensor:
        """Return scores [b, 4] with INVALID_LOGIT for invalid moves, where the network masks."""
        return (
            scores.masked_fill(invalid_moves(observation), INVALID_LOGIT)
            if self.shape.mask
            else scores
        )


class PolicyNetwork(PaperNetwork):
    """A logit for every move, and a value.

    forward(*observation) -> logits float32[b, 4], value float32[b] (NaN with the critic "none")
    """

    def __init__(self, shape: NetworkShape) -> None:
        super().__init__(shape)
        self.value_trunk = make_trunk(shape) if shape.critic == "separate" else None
        self.policy_head = _move_head(shape, 1)
        self.value_head = None if shape.critic == "none" else _board_head(shape, 1)
        if shape.observation == "features":
            initialize_orthogonal(self)
        _make_small(self.policy_head)
        if shape.observation == "state" and self.value_head is not None:
            _make_small(self.value_head)

    def logits(self, *observation: Tensor) -> Tensor:
        """Return the logits float32[b, 4]."""
        return self._logits(self.trunk(*observation), observation)

    def value(self, *observation: Tensor) -> Tensor:
        """Return the value float32[b], NaN with the critic "none"."""
        trunk = self.trunk if self.value_trunk is None else self.value_trunk
        return self._value(trunk(*observation), observation)

    def forward(self, *observation: Tensor) -> tuple[Tensor, Tensor]:
        hidden = self.trunk(*observation)
        for_value = hidden if self.value_trunk is None else self.value_trunk(*observation)
        return self._logits(hidden, observation), self._value(for_value, observation)

    def evaluate(self, *observation: Tensor) -> tuple[Tensor, Tensor]:
        return self(*observation)  # type: ignore[no-any-return]

    def _logits(self, hidden: Tensor, observation: tuple[Tensor, ...]) -> Tensor:
        return self.fill_invalid(
            self.read_moves(self.policy_head, hidden, observation).squeeze(2), observation
        )

    def _value(self, hidden: Tensor, observation: tuple[Tensor, ...]) -> Tensor:
        if self.value_head is None:
            return torch.full((len(hidden),), float("nan"), device=hidden.device)
        return self.read_board(self.value_head, hidden, observation).squeeze(1)


class QNetwork(PaperNetwork):
    """The value of every move.

    forward(*observation) -> float32[b, 4], INVALID_LOGIT for invalid moves where the network masks
    """

    def __init__(self, shape: NetworkShape) -> None:
        super().__init__(shape)
        self.q_head = _move_head(shape, 1)
        if shape.observation == "features":
            initialize_orthogonal(self)

    def forward(self, *observation: Tensor) -> Tensor:
        values = self.read_moves(self.q_head, self.trunk(*observation), observation).squeeze(2)
        return self.fill_invalid(values, observation)

    def evaluate(self, *observation: Tensor) -> tuple[Tensor, Tensor]:
        scores = self(*observation)
        return scores, scores.amax(1)


class CategoricalNetwork(PaperNetwork):
    """The distribution of every move's return, from a stream for the observation and one for the moves (dueling).

    support                float32[atoms], the returns
    forward(*observation)  -> probabilities float32[b, 4, atoms]; where the network masks, those of invalid moves are all on
                           the lowest return
    """

    support: Tensor

    def __init__(self, shape: NetworkShape, make_linear: MakeLinear) -> None:
        super().__init__(shape)
        assert shape.atoms is not None
        assert shape.support is not None
        self.register_buffer(
            "support", torch.linspace(*shape.support, shape.atoms), persistent=False
        )
        if shape.observation == "features":
            initialize_orthogonal(self)
        self.advantage_head = _stream(shape, shape.atoms, make_linear, of_moves=True)
        self.value_head = _stream(shape, shape.atoms, make_linear, of_moves=False)

    def forward(self, *observation: Tensor) -> Tensor:
        hidden = self.trunk(*observation)
        advantages = self.read_moves(self.advantage_head, hidden, observation, len(self.support))
        value = self.read_board(self.value_head, hidden, observation)
        logits = value[:, None] + advantages - advantages.mean(1, keepdim=True)
        if self.shape.mask:
            is_lowest = torch.arange(len(self.support), device=logits.device) == 0
            invalid = invalid_moves(observation)[:, :, None]
            logits = logits.masked_fill(invalid & ~is_lowest, INVALID_LOGIT).masked_fill(
                invalid & is_lowest, 0.0
            )
        return logits.softmax(2)

    def expected(self, *observation: Tensor) -> Tensor:
        """Return the expected return of every move, float32[b, 4]; INVALID_LOGIT for invalid ones where the network masks."""
        return self.fill_invalid((self(*observation) * self.support).sum(2), observation)

    def evaluate(self, *observation: Tensor) -> tuple[Tensor, Tensor]:
        scores = self.expected(*observation)
        return scores, scores.amax(1)


def make_network(shape: NetworkShape, sigma: float | None = None) -> PaperNetwork:
    """Return a freshly initialised network: a PolicyNetwork, QNetwork or CategoricalNetwork, by the shape's head.

    sigma  of the noise in the dense layers of the categorical head (Rainbow has 0.5); None: plain layers, as files have them
    """
    if shape.head == "policy":
        return PolicyNetwork(shape)
    if shape.head == "q":
        return QNetwork(shape)

    def make_linear(inputs: int, outputs: int) -> nn.Linear:
        return nn.Linear(inputs, outputs) if sigma is None else NoisyLinear(inputs, outputs, sigma)

    return CategoricalNetwork(shape, make_linear)


def _move_head(shape: NetworkShape, outputs: int) -> nn.Module:
    """Return a head over the moves: a dense layer, or one perceptron that the moves share."""
    if shape.observation == "features":
        return nn.Sequential(
            nn.Linear(MOVE_INPUTS, HEAD_UNITS), nn.ReLU(), nn.Linear(HEAD_UNITS, outputs)
        )
    return _state_head(shape, 4 * outputs)


def _board_head(shape: NetworkShape, outputs: int) -> nn.Module:
    """Return a head over the whole observation."""
    if shape.observation == "features":
        return nn.Sequential(
            nn.Linear(BOARD_INPUTS, HEAD_UNITS), nn.ReLU(), nn.Linear(HEAD_UNITS, outputs)
        )
    return _state_head(shape, outputs)


def _stream(
    shape: NetworkShape, atoms: int, make_linear: MakeLinear, of_moves: bool
) -> nn.Sequential:
    """Return one of the two streams of a dueling head."""
    if shape.observation == "features":
        inputs, units, outputs = (MOVE_INPUTS if of_moves else BOARD_INPUTS), HEAD_UNITS, atoms
    else:
        inputs, units, outputs = (
            UNITS[shape.trunk],
            STREAM_UNITS,
            (4 * atoms if of_moves else atoms),
        )
    return nn.Sequential(make_linear(inputs, units), nn.ReLU(), make_linear(units, outputs))


def _state_head(shape: NetworkShape, outputs: int) -> nn.Module:
    """Return a head over the state matrix: the hidden layers of the shape, and one of the outputs."""
    units = (UNITS[shape.trunk], *shape.hidden, outputs)
    layers = [nn.Linear(before, after) for before, after in pairwise(units)]
    for layer in layers:
        initialize_xavier(layer)
    if len(layers) == 1:
        return layers[0]
    return nn.Sequential(
        *(each for layer in layers[:-1] for each in (layer, nn.ReLU())), layers[-1]
    )


def _make_small(head: nn.Module) -> None:
    """Draw the last layer of a head so that everything it says is near 0 at first."""
    last = [module for module in head.modules() if isinstance(module, nn.Linear)][-1]
    nn.init.orthogonal_(last.weight, 0.01)
