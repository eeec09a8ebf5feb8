"""How much terrains differ for a study's policies, played on other terrains.

What was played is kept in the folder of studies, by the policy's file and code, the configuration and
the version of the rules, so that the next study of the same kind need not play again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from humanplay.jobs import Progress
from humanplay.study.files import read_object, write_object
from humanplay.study.policy_episodes import play_policies, tested_policies
from humanplay.study.protocol import Protocol, canonical_json

TERRAINS = 200
_PLAYED = TypeAdapter(dict[str, list[float]])
FOLDER = "played"
"""In the folder of studies."""


def terrain_sd(protocol: Protocol, studies: Path, advance: Progress) -> float | None:
    """Largest standard deviation over terrains of a tested policy; None without one.

    People are taken to be alike on all terrains, so that it is that of policy minus people.

    Args:
        protocol: of a draft; its policies are played in its primary metric.
        studies: the folder of studies.
        advance: called with (episodes played, of how many).
    """
    names = tested_policies(protocol)
    if not names:
        return None
    files = {name: _file_of(protocol, name, studies / FOLDER) for name in names}
    played = {
        name: _PLAYED.validate_python(read_object(file))
        for name, file in files.items()
        if file is not None and file.exists()
    }
    missing = [name for name in names if name not in played]
    played |= _played(protocol, missing, advance)
    for name in missing:
        if (file := files[name]) is not None:
            write_object(file, played[name])
    spreads = [np.std(values[protocol.primary_metric], ddof=1) for values in played.values()]
    return float(max(spreads))


def _file_of(protocol: Protocol, policy: str, folder: Path) -> Path | None:
    """The cache file of a policy's episodes; None for code that may have changed."""
    environment = protocol.environment
    digest = environment.policies.hash_with_code(policy)
    if digest is None:
        return None
    cause = canonical_json([digest, environment.version, protocol.task, protocol.config])
    return folder / f"{hashlib.sha256(cause).hexdigest()[:32]}.json"


def _played(
    protocol: Protocol, names: Sequence[str], advance: Progress
) -> dict[str, dict[str, list[float]]]:
    """Steps and score by policy, on terrains whose seeds are 0, 1, 2 ..."""
    environment, config = protocol.environment, protocol.env_config
    seeds = {number: number for number in range(TERRAINS)}
    played: dict[str, dict[str, list[float]]] = {name: {"steps": [], "score": []} for name in names}
    for episode in play_policies(names, environment, config, seeds, advance):
        record = episode.replay(environment, config).record()
        succeeded = record.outcome in environment.successes
        played[episode.policy]["steps"].append(float(record.steps if succeeded else config.limit))
        played[episode.policy]["score"].append(float(record.score))
    return played
