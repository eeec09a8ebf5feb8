"""The seam's configurations and records as MarsExplorer's own."""

from __future__ import annotations

from humanplay import task
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Record


def own_config(config: task.Configuration) -> EnvConfig:
    """A configuration as the core's own; TypeError for another task's."""
    if not isinstance(config, EnvConfig):
        raise TypeError(f"expected settings of MarsExplorer's, got a {type(config).__name__}")
    return config


def own_record(record: task.Record) -> Record:
    """A record as the core's own; TypeError for another task's."""
    if not isinstance(record, Record):
        raise TypeError(f"expected an episode of MarsExplorer's, got a {type(record).__name__}")
    return record
