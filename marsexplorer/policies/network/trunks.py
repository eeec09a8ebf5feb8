"""What reads an observation for the heads of `paper_network`: convolutions over the state matrix, or layers over features.

The convolutions are those of RLlib 1.0.1's vision network: "same" padding and ReLU. Its last filter covers the whole picture,
which is a dense layer; here it is one on every size of grid (the authors' third filter, 512 of 6 x 6, covers what 21 x 21 cells
become, so it is this layer there).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from marsexplorer.config import OBSTACLE, ROVER
from marsexplorer.observation import STATE_VALUES
from marsexplorer.policies.network.features import ACTION_FEATURES, PICTURE_CELLS, PLANES
from marsexplorer.policies.network.shape import NetworkShape

FILTERS = {"rllib": ((16, 4), (32, 4)), "authors": ((8, 3), (16, 2))}
"""Trunk -> (filters, side of their kernels in cells) of the two convolutions, both with stride 2."""
UNITS = {"rllib": 256, "authors": 512, "features": 128}
"""Trunk -> numbers that it gives the heads."""
WIDE = 384
"""Units of the first layer over features."""
STRIDE = 2


class StateTrunk(nn.Module):
    """Read the state matrix (eq. 6).

    forward(codes uint8[b, rows, cols]) -> float32[b, UNITS]
    """

    values: Tensor

    def __init__(self, trunk: str, rows: int, cols: int) -> None:
        super().__init__()
        self.register_buffer("values", torch.from_numpy(STATE_VALUES.copy()), persistent=False)
        layers: list[nn.Module] = []
        inputs = 1
        for filters, kernel in FILTERS[trunk]:
            padding = (*same_padding(cols, kernel), *same_padding(rows, kernel))
            layers += [nn.ZeroPad2d(padding), nn.Conv2d(inputs, filters, kernel, STRIDE), nn.ReLU()]
            inputs, rows, cols = filters, -(-rows // STRIDE), -(-cols // STRIDE)
        self.layers = nn.Sequential(
            *layers, nn.Flatten(), nn.Linear(inputs * rows * cols, UNITS[trunk]), nn.ReLU()
        )
        for layer in self.layers:
            if isinstance(layer, (nn.Conv2d, nn.Linear)):
                initialize_xavier(layer)

    def forward(self, codes: Tensor) -> Tensor:
        hidden: Tensor = self.layers(self.values[codes.long()][:, None])
        return hidden


class FeatureTrunk(nn.Module):
    """Read the pictures of `features`, as `model.Net` does.

    forward(planes uint8[b, PLANES, PICTURE_CELLS], moves float32[b, 4, ACTION_FEATURES]) -> float32[b, UNITS]
    """

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(PLANES * PICTURE_CELLS, WIDE),
            nn.ReLU(),
            nn.Linear(WIDE, UNITS["features"]),
            nn.ReLU(),
        )

    def forward(self, planes: Tensor, moves: Tensor) -> Tensor:
        hidden: Tensor = self.layers(planes.flatten(1).to(moves.dtype) * (1 / 255))
        return hidden


def make_trunk(shape: NetworkShape) -> nn.Module:
    """Return a freshly initialised trunk."""
    if shape.size is None:
        return FeatureTrunk()
    return StateTrunk(shape.trunk, *shape.size)


def same_padding(side: int, kernel: int) -> tuple[int, int]:
    """Return the zeros before and after a side so that a convolution gives ceil(side / STRIDE) numbers."""
    total = max(0, (-(-side // STRIDE) - 1) * STRIDE + kernel - side)
    return total // 2, total - total // 2


def initialize_xavier(layer: nn.Conv2d | nn.Linear) -> None:
    """Draw a layer's weights as Glorot and Bengio 2010 and set its biases to zero."""
    nn.init.xavier_uniform_(layer.weight)
    assert layer.bias is not None
    nn.init.zeros_(layer.bias)


def move_inputs(hidden: Tensor, moves: Tensor) -> Tensor:
    """Return what a head that the moves share is given of each, [b, 4, ...]: the trunk's numbers, its features, which it is."""
    which = torch.eye(4, dtype=moves.dtype, device=moves.device).expand(len(moves), 4, 4)
    return torch.cat([hidden[:, None].expand(len(moves), 4, -1), moves, which], dim=2)


MOVE_INPUTS = UNITS["features"] + ACTION_FEATURES + 4
BOARD_INPUTS = UNITS["features"] + 4 * ACTION_FEATURES


def invalid_moves(observation: tuple[Tensor, ...]) -> Tensor:
    """Return which moves leave the grid or lead into a known obstacle, bool[b, 4], from what a network is given.

    observation  (codes uint8[b, rows, cols],), or (planes, moves) of the features
    """
    if len(observation) == 2:
        return observation[1][:, :, 0] < 0.5
    codes = observation[0]
    beyond = functional.pad(codes, (1, 1, 1, 1), value=OBSTACLE) == OBSTACLE
    rover = codes == ROVER
    neighbours = (
        beyond[:, :-2, 1:-1],
        beyond[:, 1:-1, 2:],
        beyond[:, 2:, 1:-1],
        beyond[:, 1:-1, :-2],
    )
    return torch.stack([(rover & near).flatten(1).any(1) for near in neighbours], dim=1)
