"""What a policy's card says of terrains kept apart, and playing those episodes again.

A card has results by level and size ("random 21x21"), each of the terrains of consecutive seeds: `terrains`, how many;
`first_seed`; means and shares; `moves`, how many moves each episode had; and `actions`, the first 12 digits of SHA-256 (hex)
over its actions, a byte each. The policy is reset with the terrain's seed, so the same file plays the same episodes.
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
    """Return what a card keeps of an episode's actions."""
    return hashlib.sha256(bytes(actions)).hexdigest()[:DIGITS]


def result_for_card(
    policy: str | Path,
    config: EnvConfig,
    terrains: int,
    first_seed: int,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> dict[str, Any]:
    """Return what a card says of a policy (a name or a path) on the terrains of consecutive seeds, beside the better rule."""
    names = [str(policy), *RULES]
    table = evaluate(names, config, terrains, first_seed, progress, traces=True, executor=executor)
    own, *rules = table.rows
    played = [each for each in table.results if each.policy == own.policy]
    return {
        "terrains": terrains,
        "first_seed": first_seed,
        "steps": round(own.steps_mean, 2),
        "completion": own.completion,
        "collisions": own.collisions,
        "score": round(own.score_mean, 4),
        "best_rule_steps": round(min(row.steps_mean for row in rules), 2),
        "moves": [each.steps for each in played],
        "actions": [digest(_actions(each)) for each in played],
    }


def _actions(result: Result) -> Sequence[int]:
    assert result.trace is not None
    return result.trace.actions


@dataclass(frozen=True)
class Difference:
    """An episode that does not come out as a card says: the level and size, the seed, and both (moves, digest)."""

    where: str
    seed: int
    said: tuple[int, str]
    came: tuple[int, str]


def replay_card(path: Path, most: int | None = None) -> Iterator[Difference | None]:
    """Play the episodes of a policy file's card again, and yield None for each that comes out as the card says.

    most  terrains of each level and size; None: all

    ValueError for a card without episodes.
    """
    told = read_card(path).get("results", {}).items()
    results = {where: each for where, each in told if "actions" in each}
    if not results:
        way_out = f"`marsexplorer policies measure {path}` adds them"
        raise ValueError(f"the card of {path} lists no episodes; {way_out}")
    for where, result in results.items():
        config = config_of(where)
        policy = load(path, config.sensor_radius)
        said = zip(result["moves"][:most], result["actions"][:most], strict=True)
        for seed, (moves, actions) in enumerate(said, result["first_seed"]):
            episode = play_episode(policy, config, seed)
            came = len(episode.actions), digest(episode.actions)
            is_same = came == (moves, actions)
            yield None if is_same else Difference(where, seed, (moves, actions), came)


def config_of(where: str) -> EnvConfig:
    """Return the configuration that a card calls "LEVEL ROWSxCOLS"."""
    level, size = where.split(" ")
    rows, cols = map(int, size.split("x"))
    return EnvConfig.of(level, (rows, cols))
