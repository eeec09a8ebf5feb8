"""The replay buffer: tianshou's, with its priorities, and its whole state as compressed bytes for a checkpoint.

The observation that follows a move is stored with it. tianshou can look it up in the next row instead (`ignore_obs_next`), but
then what follows a truncated episode, and the newest move of each environment, is taken to be the observation before it.
In a checkpoint both stand side by side, row by row, and as consecutive boards differ in a few cells they take some 40 bytes.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tianshou.data import Batch, PrioritizedVectorReplayBuffer
from torch import Tensor

from marsexplorer.paper.trainers.tianshou_envs import Transitions

ROWS_AT_ONCE = 2048
"""Rows that are compressed together."""
PLAIN = ("act", "rew", "terminated", "truncated", "done")
"""Columns that are stored as they are."""
COUNTERS = ("_insertion_idx", "_size", "_ep_len", "_ep_start_idx")
"""What tianshou counts in the part of each environment."""


def make_replay(
    capacity: int, num_envs: int, width: int, alpha: float = 0.6, beta: float = 0.4
) -> PrioritizedVectorReplayBuffer:
    """Return an empty buffer of `capacity` moves, in equal parts for the environments.

    width        bytes of an observation
    alpha, beta  exponents of the priorities and of the weights that correct for them (Schaul et al. 2016)
    """
    buffer = PrioritizedVectorReplayBuffer(capacity, num_envs, alpha=alpha, beta=beta)
    rows = buffer.maxsize
    columns: dict[str, NDArray[Any]] = {
        "obs": np.zeros((rows, width), np.uint8),
        "obs_next": np.zeros((rows, width), np.uint8),
        "act": np.zeros(rows, np.int64),
        "rew": np.zeros(rows),
        **{name: np.zeros(rows, np.bool_) for name in ("terminated", "truncated", "done")},
    }
    buffer.set_batch(Batch(columns))
    return buffer


def add(buffer: PrioritizedVectorReplayBuffer, moves: Transitions) -> None:
    """Add one move of every environment."""
    batch = Batch()
    batch.__dict__.update(  # tianshou's constructor would copy and inspect every array
        obs=moves.obs,
        act=moves.actions,
        rew=moves.rewards,
        terminated=moves.terminated,
        truncated=moves.truncated,
        obs_next=moves.next_obs,
    )
    buffer.add(batch)


def replay_state(buffer: PrioritizedVectorReplayBuffer) -> dict[str, Any]:
    """Return the whole state, as tensors and numbers."""
    filled = _filled(buffer)
    columns = buffer._meta
    leaves = np.asarray(buffer.weight[filled])
    return {
        "boards": _compress(columns.obs, columns.obs_next, filled),
        "columns": {name: torch.from_numpy(columns[name][filled]) for name in PLAIN},
        "priorities": torch.from_numpy(leaves.copy()),
        "extremes": [float(buffer._max_prio), float(buffer._min_prio)],
        "parts": [
            [*(int(getattr(part, name)) for name in COUNTERS), int(part.last_index[0])]
            for part in buffer.buffers
        ],
        "returns": [float(part._ep_return) for part in buffer.buffers],
    }


def load_replay_state(buffer: PrioritizedVectorReplayBuffer, state: dict[str, Any]) -> None:
    """Set everything as `replay_state` returned it, in a buffer that was made alike."""
    for at, (part, counters, total) in enumerate(
        zip(buffer.buffers, state["parts"], state["returns"], strict=True)
    ):
        for name, value in zip(COUNTERS, counters, strict=False):
            setattr(part, name, value)
        part.last_index[0], part._ep_return = counters[-1], total
        buffer.last_index[at] = counters[-1] + buffer._offset[at]
        buffer._lengths[at] = len(part)
    filled = _filled(buffer)
    _decompress(state["boards"], buffer._meta.obs, buffer._meta.obs_next, filled)
    for name in PLAIN:
        buffer._meta[name][filled] = state["columns"][name].numpy()
    if len(filled):
        buffer.weight[filled] = state["priorities"].numpy()
    # tianshou computes with the extremes in float32, as the losses are; in float64 priorities would differ in the last digit
    buffer._max_prio, buffer._min_prio = map(np.float32, state["extremes"])


def _filled(buffer: PrioritizedVectorReplayBuffer) -> NDArray[np.int64]:
    """Return the indices of the rows that hold a move."""
    return np.concatenate(
        [
            start + np.arange(count)
            for start, count in zip(buffer._offset, buffer._lengths, strict=True)
        ]
    )


def _compress(
    obs: NDArray[np.uint8], next_obs: NDArray[np.uint8], filled: NDArray[np.int64]
) -> Tensor:
    """Return the boards of the filled rows as uint8[...]: each observation, and at once what followed."""
    stream, pieces = zlib.compressobj(1), []
    for at in range(0, len(filled), ROWS_AT_ONCE):
        rows = filled[at : at + ROWS_AT_ONCE]
        pieces.append(
            stream.compress(np.concatenate([obs[rows], next_obs[rows]], axis=1).tobytes())
        )
    pieces.append(stream.flush())
    return torch.frombuffer(bytearray(b"".join(pieces)), dtype=torch.uint8)


def _decompress(
    packed: Tensor, obs: NDArray[np.uint8], next_obs: NDArray[np.uint8], filled: NDArray[np.int64]
) -> None:
    """Write the boards into the filled rows."""
    width = obs.shape[1]
    both = np.frombuffer(zlib.decompress(packed.numpy().tobytes()), np.uint8).reshape(-1, 2 * width)
    obs[filled], next_obs[filled] = both[:, :width], both[:, width:]
