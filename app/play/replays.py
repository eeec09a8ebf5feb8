"""Episodes made again from what is stored: a finished one as its frames, and one of a row as it stood."""

from __future__ import annotations

import json
from typing import Any

from app.play.messages import encode_frame
from app.storage.store import Trial
from marsexplorer.episode import Episode, Record, replay

MAX_REPLAY_CELLS = 2_000_000
"""Most cells in the frames of one replay: beyond it some frames are left out."""


def frames(record: Record, episode_id: str) -> list[dict[str, Any]]:
    """Return the frames of a finished episode from its start to its end; on large boards only every so many."""
    config = record.config
    stride = max(1, -(-len(record.actions) * config.n // MAX_REPLAY_CELLS))
    episode = Episode.begin(config, terrain=record.terrain_map(), start=record.start)
    texts = [encode_frame(episode_id, episode)]
    for number, action in enumerate(record.actions, 1):
        episode.step(action)
        if number % stride == 0 or number == len(record.actions):
            texts.append(encode_frame(episode_id, episode))
    if record.outcome == "abandoned":
        texts.append(encode_frame(episode_id, replay(record)))
    return [json.loads(each) for each in texts]


def restore_episode(row: Trial, actions: bytes = b"", ended: bool = False) -> Episode:
    """Return the episode of a row after its actions; one that had ended without an ending move was abandoned."""
    record = Record(
        config=row.config,
        seed=row.seed,
        terrain=row.terrain,
        start=row.start,
        actions=actions,
        outcome="abandoned" if ended else "running",
        total=0.0,
        steps=0,
        discovered=0,
        trajectory_hash="",
    )
    return replay(record)
