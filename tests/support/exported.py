"""Exported tables as Python values."""

import csv
import io
import json

TEXTS = {
    "episode", "player", "driver", "task", "level", "config_hash", "terrain", "core_version", "outcome", "actions",
    "trajectory_hash", "attestation", "attestation_reason", "daily", "action", "input",
}  # fmt: skip


def rows_of(text):
    """The rows of an exported CSV table, with None, numbers and truth values."""
    return [
        {name: value_of(name, cell) for name, cell in row.items()}
        for row in csv.DictReader(io.StringIO(text))
    ]


def value_of(name, cell):
    if name in TEXTS:
        return cell if cell or name == "actions" else None
    return json.loads(cell) if cell else None
