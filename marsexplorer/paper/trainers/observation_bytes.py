"""Observations as rows of bytes: tianshou's buffers keep one array, whatever a network is given.

state matrix  the codes, rows * cols bytes
features      the pictures, then the bytes of the numbers of each move
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from marsexplorer.config import EnvConfig
from marsexplorer.policies.network.features import ACTION_FEATURES, PICTURE_CELLS, PLANES
from marsexplorer.training.envs import EncoderFactory, feature_encoder, state_matrix_encoder

PICTURE_BYTES = PLANES * PICTURE_CELLS
MOVES_BYTES = 4 * ACTION_FEATURES * 4


@dataclass(frozen=True)
class ObservationBytes:
    """How the observations of boards of rows x cols become bytes and are read again; features are of one size for all."""

    features: bool
    rows: int
    cols: int

    @classmethod
    def of(cls, config: EnvConfig, features: bool) -> ObservationBytes:
        """Return what fits the boards of a configuration."""
        return cls(features, config.rows, config.cols)

    @property
    def width(self) -> int:
        """Bytes of an observation."""
        return PICTURE_BYTES + MOVES_BYTES if self.features else self.rows * self.cols

    @property
    def make_encoder(self) -> EncoderFactory:
        """What makes the observations of the environments."""
        return feature_encoder if self.features else state_matrix_encoder

    def pack(self, observation: tuple[Tensor, ...]) -> NDArray[np.uint8]:
        """Return uint8[num, width] of what an encoder gave; the array is new."""
        parts = [part.numpy().reshape(len(part), -1).view(np.uint8) for part in observation]
        return np.concatenate(parts, axis=1)

    def unpack(self, packed: NDArray[np.uint8]) -> tuple[Tensor, ...]:
        """Return what a network is given: codes uint8[num, rows, cols], or planes and moves as `features` has them."""
        tensor = torch.from_numpy(packed)
        if not self.features:
            return (tensor.view(-1, self.rows, self.cols),)
        moves = tensor[:, PICTURE_BYTES:].contiguous().view(torch.float32)
        return tensor[:, :PICTURE_BYTES].reshape(-1, PLANES, PICTURE_CELLS), moves.view(
            -1, 4, ACTION_FEATURES
        )
