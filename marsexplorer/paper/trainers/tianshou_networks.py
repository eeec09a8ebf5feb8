"""The networks of `policies.network.paper_network` as tianshou calls them: by rows of bytes, with a state that they have not.

Each takes `forward(obs uint8[num, width], state, info)`. Those of a policy return their tensor and the state, critics their
tensor alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from marsexplorer.paper.trainers.observation_bytes import ObservationBytes
from marsexplorer.policies.network.paper_network import CategoricalNetwork, PolicyNetwork, QNetwork


class _Reads(nn.Module):
    """A network and how its observations are read; `light`: whether it computes in bfloat16 where that loses little."""

    def __init__(self, net: nn.Module, form: ObservationBytes, light: bool = False) -> None:
        super().__init__()
        self.net, self._form, self._light = net, form, light

    def _ask(self, function: Any, obs: NDArray[np.uint8]) -> Tensor:
        with torch.autocast("cpu", torch.bfloat16, enabled=self._light):
            found: Tensor = function(*self._form.unpack(obs))
        return found


class Actor(_Reads):
    """The logits float32[num, 4] of a network."""

    net: PolicyNetwork

    def forward(
        self, obs: NDArray[np.uint8], state: Any = None, info: Any = None
    ) -> tuple[Tensor, Any]:
        return self._ask(self.net.logits, obs), state


class ValueCritic(_Reads):
    """The value float32[num] of a network."""

    net: PolicyNetwork

    def forward(self, obs: NDArray[np.uint8], state: Any = None, info: Any = None) -> Tensor:
        return self._ask(self.net.value, obs)


class QCritic(_Reads):
    """The values float32[num, 4] of the moves."""

    net: QNetwork

    def forward(self, obs: NDArray[np.uint8], state: Any = None, info: Any = None) -> Tensor:
        return self._ask(self.net, obs)


class Distributions(_Reads):
    """The distributions float32[num, 4, atoms] of the moves' returns."""

    net: CategoricalNetwork

    def forward(
        self, obs: NDArray[np.uint8], state: Any = None, info: Any = None
    ) -> tuple[Tensor, Any]:
        return self._ask(self.net, obs), state

    def best(self, obs: NDArray[np.uint8], distributions: Tensor) -> NDArray[np.int64]:
        """Return the move of the highest expected return of each, int64[num], never an invalid one where the network masks."""
        expected = (distributions * self.net.support).sum(2)
        best: NDArray[np.int64] = (
            self.net.fill_invalid(expected, self._form.unpack(obs)).argmax(1).numpy()
        )
        return best
