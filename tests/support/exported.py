"""Exported tables as Python values."""

import csv
import io
import json

TEXTS = {
    "episode", "player", "driver", "task", "level", "config_hash", "terrain", "core_version", "outcome", "actions",
    "trajectory_hash", "attestation", "attestation_reason", "daily", "action", "input",
}  # fmt: skip


def rows_of(text):
    """Return the rows of an exported CSV table: absent is None, numbers and truth values are such."""
    return [
        {name: value_of(name, value) for name, value in row.items()}
        for row in csv.DictReader(io.StringIO(text))
    ]


def value_of(name, value):
    if name in TEXTS:
        return value if value or name == "actions" else None
    return json.loads(value) if value else None
