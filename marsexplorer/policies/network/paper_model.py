"""The network of the paper: the state matrix alone, two convolutions, a dense layer (section 3.2, the pre-processor's figure).

The paper gives no sizes; these are RLlib's default vision network's of that depth: 16 filters of 4 x 4 and 32 of 4 x 4, both
with stride 2, and 256 units, and a network of its own for the value. It takes one size of grid and knows nothing of
valid moves: it may drive into an obstacle.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from marsexplorer.observation import STATE_VALUES, decode
from marsexplorer.policies.files.card import read_card, refuse
from marsexplorer.policies.files.formats import PAPER_FORMAT
from marsexplorer.policies.files.imported import wrong_size
from marsexplorer.policies.files.weights import read_weights
from marsexplorer.random_numbers import mix

LARGEST_SIDE = 128


class PaperNet(nn.Module):
    """Give the four moves their logits from the state matrix (eq. 6).

    forward(codes uint8[b, rows, cols]) -> logits float32[b, 4], value float32[b]
    """

    values: Tensor

    def __init__(self, rows: int, cols: int) -> None:
        super().__init__()
        self.size = (rows, cols)
        self.register_buffer("values", torch.from_numpy(STATE_VALUES.copy()), persistent=False)
        self.actor, self.critic = tower(rows, cols, 4), tower(rows, cols, 1)

    def forward(self, codes: Tensor) -> tuple[Tensor, Tensor]:
        state = self.values[codes.long()][:, None]
        return self.actor(state), self.critic(state).squeeze(1)


def tower(rows: int, cols: int, outputs: int) -> nn.Sequential:
    """Return two convolutions, a dense layer and a layer of `outputs` numbers, for a grid of rows x cols."""
    flat = 32 * -(-rows // 4) * -(-cols // 4)
    layers = (
        nn.ZeroPad2d((1, 2, 1, 2)), nn.Conv2d(1, 16, 4, 2), nn.ReLU(),
        nn.ZeroPad2d((1, 2, 1, 2)), nn.Conv2d(16, 32, 4, 2), nn.ReLU(),
        nn.Flatten(), nn.Linear(flat, 256), nn.ReLU(), nn.Linear(256, outputs),
    )  # fmt: skip
    for layer in layers:
        if isinstance(layer, (nn.Conv2d, nn.Linear)):
            nn.init.xavier_uniform_(layer.weight)
            assert layer.bias is not None
            nn.init.zeros_(layer.bias)
    last = layers[-1]
    assert isinstance(last, nn.Linear)
    nn.init.orthogonal_(last.weight, 0.01)
    return nn.Sequential(*layers)


class PaperPolicy:
    """Draw each move from the network's probabilities, as RLlib does by default; the seed of `reset` fixes the draws.

    size       (rows, cols) of the boards it plays
    thought()  after `act`: probabilities float32[4] of the moves, and the value
    """

    def __init__(self, name: str, net: PaperNet) -> None:
        self.name, self.size = name, net.size
        self._net = net
        self._thought: tuple[NDArray[np.float32], float] = (np.full(4, 0.25, np.float32), 0.0)
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._random = np.random.Generator(np.random.PCG64(mix(seed)))

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3; ValueError for a grid of another size than the network's."""
        codes = decode(observation)
        if codes.shape != self.size:
            raise ValueError(wrong_size(self.name, self.size, codes.shape))
        if torch.get_num_threads() != 1:
            torch.set_num_threads(1)
        with torch.inference_mode():
            logits, value = self._net(torch.from_numpy(codes.copy())[None])
            self._thought = logits[0].softmax(0).numpy(), float(value[0])
        return int(
            np.searchsorted(np.cumsum(self._thought[0][:3]), self._random.random(), side="right")
        )

    def thought(self) -> tuple[NDArray[np.float32], float]:
        """Return (probabilities float32[4], value) of the last observation."""
        return self._thought


def load_paper_net(path: Path) -> PaperNet:
    """Return the network in a policy file; PolicyFileError when the file is none of ours."""
    card = read_card(path)
    size = card.get("size")
    if card.get("format") != PAPER_FORMAT:
        raise refuse(path, f"the format {PAPER_FORMAT}", repr(card.get("format"))[:60])
    if not (
        isinstance(size, list)
        and len(size) == 2
        and all(type(side) is int and 5 <= side <= LARGEST_SIDE for side in size)
    ):
        raise refuse(
            path, f"a size [rows, cols] of 5 to {LARGEST_SIDE} cells in the card", repr(size)[:60]
        )
    net = PaperNet(*size)
    read_weights(net, path)
    net.eval()
    return net


def load_paper_policy(path: Path) -> PaperPolicy:
    """Return the policy in a file, named after the file."""
    return PaperPolicy(path.stem, load_paper_net(path))
