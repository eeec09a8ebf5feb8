"""The results on a policy's card, and playing their episodes again.

A card has results by level and size ("random 21x21"), each of the terrains of consecutive seeds
that were not trained on: `terrains`, how many; `first_seed`; means and shares; `moves`, how many
moves each episode had; and `actions`, the first 12 digits of SHA-256 (hex) over its actions, a byte
each. The policy is reset with the terrain's seed, so the same file plays the same episodes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import Result, play_episode
from marsexplorer.evaluation.table import RULES, Progress, evaluate
from marsexplorer.policies import load
from marsexplorer.policies.files.card import read_card

DIGITS = 12


def digest(actions: Sequence[int]) -> str:
    """The first DIGITS digits of SHA-256 (hex) over an episode's actions."""
    return hashlib.sha256(bytes(actions)).hexdigest()[:DIGITS]


def result_for_card(
    policy: str | Path,
    config: EnvConfig,
    terrains: int,
    first_seed: int,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> dict[str, Any]:
    """A policy's results on the terrains of consecutive seeds, as its card has them.

    policy  a name or a path; the better rule is played beside it
    """
    names = [str(policy), *RULES]
    table = evaluate(names, config, terrains, first_seed, progress, traces=True, executor=executor)
    row, *rules = table.rows
    episodes = [episode for episode in table.results if episode.policy == row.policy]
    return {
        "terrains": terrains,
        "first_seed": first_seed,
        "steps": round(row.steps_mean, 2),
        "completion": row.completion,
        "collisions": row.collisions,
        "score": round(row.score_mean, 4),
        "best_rule_steps": round(min(rule.steps_mean for rule in rules), 2),
        "moves": [episode.steps for episode in episodes],
        "actions": [digest(_actions(episode)) for episode in episodes],
    }


def _actions(result: Result) -> Sequence[int]:
    assert result.trace is not None
    return result.trace.actions


@dataclass(frozen=True)
class Difference:
    """An episode that a policy file does not play as its card records it.

    setting   level and size, as the card names them
    recorded  (moves, digest) on the card
    played    (moves, digest) now
    """

    setting: str
    seed: int
    recorded: tuple[int, str]
    played: tuple[int, str]


def replay_card(path: Path, most: int | None = None) -> Iterator[Difference | None]:
    """Play the episodes of a policy file's card again; yield None if one agrees.

    Args:
        path: The policy file.
        most: Terrains of each level and size; None: all.

    Raises:
        ValueError: If the card lists no episodes.
    """
    results = {
        setting: result
        for setting, result in read_card(path).get("results", {}).items()
        if "actions" in result
    }
    if not results:
        raise ValueError(
            f"the card of {path} lists no episodes; `marsexplorer policies measure {path}` adds them"
        )
    for setting, measured in results.items():
        config = config_of(setting)
        policy = load(path, config.sensor_radius)
        recorded = zip(measured["moves"][:most], measured["actions"][:most], strict=True)
        for seed, (moves, actions) in enumerate(recorded, measured["first_seed"]):
            episode = play_episode(policy, config, seed)
            played = len(episode.actions), digest(episode.actions)
            is_same = played == (moves, actions)
            yield None if is_same else Difference(setting, seed, (moves, actions), played)


def config_of(setting: str) -> EnvConfig:
    """The configuration that a card calls "LEVEL ROWSxCOLS"."""
    level, size = setting.split(" ")
    rows, cols = map(int, size.split("x"))
    return EnvConfig.of(level, (rows, cols))
