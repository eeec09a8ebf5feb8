"""The logits of priced rules that a network adds to its own, by grid size.

On 42 x 42 and larger, exploring by prices (`policies.priced`) takes a fifth fewer moves than what
networks learn from nothing. So a network adds to the logits of its head a weighted sum of each
move's numbers, with weights for each side of SIDES and linear in the logarithm of the cells between
them. A network may begin with the weights that make the move that the rules would make; training
changes them like any others.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from marsexplorer.policies.base import INVALID_LOGIT
from marsexplorer.policies.network.features import ACTION_FEATURES, MOVE_NUMBERS
from marsexplorer.policies.network.priced_features import LOG_CELLS_SCALE, NUMBERS_PER_RULE, SIDES

RULE_WEIGHTS = ((3.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.0, 3.0, 0.0))
"""For each of SIDES, what each of RULES counts at first. At 42 x 42 the mean of all is best."""
SHARE_WEIGHT, BEST_WEIGHT, STRAIGHT_WEIGHT = 5.0, 3.0, 0.1
"""Logits of a rule: for the share of the highest value, for having it, for straight on (ties)."""
STRAIGHT = 10
"""The place of the number that is 1 for a move straight on."""


def size_nearness(log_cells: Tensor) -> Tensor:
    """How near grids are to each of SIDES, [..., len(SIDES)], at least 0 and 1 in sum.

    log_cells  ln of their cells
    """
    place = ((log_cells - math.log(SIDES[0] ** 2)) / math.log(4)).clamp(0, len(SIDES) - 1)
    sides = torch.arange(len(SIDES), dtype=place.dtype, device=place.device)
    return (1 - (place[..., None] - sides).abs()).clamp(min=0)


def prior_logits(moves: Tensor, weights: Tensor) -> Tensor:
    """The logits that the moves' numbers add, float32[b, 4].

    moves  float32[b, 4, numbers of a move]

    weights  float32[len(SIDES), numbers of a move]
    """
    nearness = size_nearness(moves[:, :, -1] / LOG_CELLS_SCALE)
    by_side = (moves[:, :, None] * weights).sum(3)  # float32, unlike matrix products in bfloat16
    return (by_side * nearness).sum(2)


def prior_weights() -> Tensor:
    """The weights that play by the rules, float32[len(SIDES), numbers of a move]."""
    weights = torch.zeros(len(SIDES), MOVE_NUMBERS)
    weights[:, STRAIGHT] = STRAIGHT_WEIGHT
    for side, counts in enumerate(RULE_WEIGHTS):
        for rule, count in enumerate(counts):
            first = ACTION_FEATURES + NUMBERS_PER_RULE * rule
            weights[side, first] = SHARE_WEIGHT * count
            weights[side, first + 1] = BEST_WEIGHT * count
    return weights


def rule_probabilities(moves: Tensor, scale: float) -> tuple[Tensor, Tensor]:
    """The policy of the initial rules, float32[b, 4], and each grid's `size_nearness`.

    moves  float32[b, 4, numbers of a move], of which at least one is valid
    scale  factor of the rules' logits
    """
    logits = prior_logits(moves, scale * prior_weights().to(moves.device))
    logits = logits.masked_fill(moves[:, :, 0] < 0.5, INVALID_LOGIT)
    largest = moves[:, :, -1].amax(1)  # of an invalid move even this number is 0
    return logits.softmax(1), size_nearness(largest / LOG_CELLS_SCALE)
