"""Behaviour cloning: a network is fitted to the moves that people made, so that it moves as they do (Pomerleau 1991).

The network is that of `policies.network.model`, drawn anew: it sees what the rover saw, and the loss is the cross-entropy of
the moves made. Every second gradient step sees the boards with rows and columns exchanged. The same episodes, configuration
and seed give the same weights.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from marsexplorer.episode import Episode, Record
from marsexplorer.policies.network.model import Net, NetworkPolicy
from marsexplorer.training.refine import TRANSPOSED


@dataclass(frozen=True)
class CloneConfig:
    """What fixes a clone besides its episodes: passes over the moves, and AdamW with a rate that falls linearly to zero."""

    epochs: int = 12
    batch_size: int = 256
    learning_rate: float = 1e-3
    weight_decay: float = 0.1
    seed: int = 0


@dataclass(frozen=True)
class Demonstrations:
    """Observations and the moves made.

    planes uint8[num, ...] and moves float32[num, 4, ...] are those of `features`, actions int64[num]
    """

    planes: NDArray[np.uint8]
    moves: NDArray[np.float32]
    actions: NDArray[np.int64]


def demonstrations_of(records: Iterable[Record]) -> Demonstrations:
    """Return every valid move of some episodes; ValueError when there is none."""
    planes, moves, actions, net = [], [], list[int](), Net()
    for record in records:
        episode = Episode.begin(record.config, terrain=record.terrain_map(), start=record.start)
        # the policy remembers the cells visited and extracts the features; its network is never asked
        policy = NetworkPolicy("clone", net, record.config.sensor_radius)
        for action in record.actions:
            own_planes, own_moves = policy.extract_features(episode.codes)
            if own_moves[0, action, 0] > 0:
                planes.append(own_planes[0].copy())
                moves.append(own_moves[0].copy())
                actions.append(action)
            episode.step(action)
    if not actions:
        raise ValueError("a clone needs episodes with at least one valid move, got none")
    return Demonstrations(np.stack(planes), np.stack(moves), np.array(actions, np.int64))


def train_clone(
    demonstrations: Demonstrations,
    config: CloneConfig,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Net:
    """Return a network fitted to the demonstrations; `on_progress` is called with (gradient steps made, in all)."""
    torch.manual_seed(config.seed)
    torch.set_num_threads(1)
    rng, net = np.random.default_rng(config.seed), Net().train()
    optimizer = torch.optim.AdamW(
        net.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
    )
    count = len(demonstrations.actions)
    batches = -(-count // config.batch_size)
    total, done = batches * config.epochs, 0
    for _ in range(config.epochs):
        order = rng.permutation(count)
        for batch in np.array_split(order, batches):
            optimizer.param_groups[0]["lr"] = config.learning_rate * (1 - done / total)
            loss = _loss(net, demonstrations, batch, transposed=done % 2 == 1)
            optimizer.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            done += 1
            on_progress(done, total)
    return net.eval()


def _loss(
    net: Net, demonstrations: Demonstrations, batch: NDArray[np.intp], transposed: bool
) -> torch.Tensor:
    """Return the mean cross-entropy of the moves of a batch, on the boards as they were or transposed."""
    planes, moves, actions = (
        torch.from_numpy(array[batch])
        for array in (demonstrations.planes, demonstrations.moves, demonstrations.actions)
    )
    if transposed:
        planes, moves, actions = planes[:, :, TRANSPOSED], moves.flip(1), 3 - actions
    logits, _ = net(planes, moves)
    return functional.cross_entropy(logits, actions)
