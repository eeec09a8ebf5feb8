"""A trained network as an ONNX file, which plays without any code of the paper's.

The card stands under "card" in the metadata. Its "acts" tells how the moves follow from the logits:

    "samples"            each is drawn from the probabilities
    "greedy"             the best is made
    "greedy with guard"  the same with the playground's loop guard
"""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from marsexplorer.config import ROVER
from marsexplorer.policies.base import INVALID_LOGIT
from marsexplorer.policies.network.features import ACTION_FEATURES, PICTURE_CELLS, PLANES
from marsexplorer.training.network import export_onnx
from research.paper.networks import PaperNetwork


class Agent(nn.Module):
    """The exported module: logits float32[1, 4] and perhaps a value float32[1].

    Over features, logits that moves are drawn from are computed in float64, and centred before they
    become float32: those of `sac-works`, which was trained before they were centred, are about
    2e10, where float32 is exact to 2,048, so that 99.5 % of its decisions would be ties.

    A network of values takes its best move with certainty, so its logits are 0 for that and
    INVALID_LOGIT for the others.
    """

    def __init__(self, net: PaperNetwork, acts: str) -> None:
        super().__init__()
        self.net = deepcopy(net).cpu().eval()
        self._has_logits = net.shape.head == "policy"
        self.has_value = not self._has_logits or net.shape.critic != "none"
        self._is_exact = net.shape.size is None and acts == "samples"
        if self._is_exact:
            self.net.double()

    def forward(self, *observation: Tensor) -> Any:
        if self._is_exact:
            planes, moves = observation
            observation = planes, moves.double()
        scores, value = self.net.evaluate(*observation)
        if not self._has_logits:
            best = torch.arange(4)[None] == scores.argmax(1, keepdim=True)
            scores = torch.where(best, 0.0, INVALID_LOGIT)
        return (scores, value) if self.has_value else scores


def save_agent(net: PaperNetwork, path: Path, card: dict[str, Any]) -> None:
    """Write a network as an ONNX file, whole or not at all.

    Noisy layers have their mean weights.

    Args:
        net: The network.
        path: Of the file.
        card: About the policy ("summary", "training", "results", ...); its "acts" is "samples" for
            networks of logits and "greedy" for those of values unless it has another.
    """
    acts = card.get("acts", "samples" if net.shape.head == "policy" else "greedy")
    agent, size = Agent(net, acts), net.shape.size
    samples: dict[str, NDArray[Any]]
    if size is None:
        samples = {
            "planes": np.zeros((1, PLANES, PICTURE_CELLS), np.uint8),
            "moves": np.ones((1, 4, ACTION_FEATURES), np.float32),
        }
    else:
        samples = {"observation": np.ones((1, *size), np.uint8)}
        samples["observation"][0, 0, 0] = ROVER
    outputs = ["logits", "value"] if agent.has_value else ["logits"]
    export_onnx(agent.eval(), path, samples, outputs, {**card, "acts": acts})
