"""Policies on given maps, one episode each.

A map has one terrain and one start, so there are no intervals.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from marsexplorer import policies as policy_files
from marsexplorer.config import CORE_VERSION
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import Result, play_out, result_of
from marsexplorer.evaluation.table import RULES
from marsexplorer.maps import GridMap


@dataclass(frozen=True)
class MapResults:
    """The results of policies on one map, in the order given; `to_rule` compares them.

    name    of the map
    start   (row, col)
    """

    name: str
    start: tuple[int, int]
    results: tuple[Result, ...]

    def to_rule(self, result: Result) -> float | None:
        """Steps to 99 % as a share of the better frontier rule's; None if no rule played."""
        rules = [rule.steps_to_99 for rule in self.results if rule.policy in RULES]
        return result.steps_to_99 / min(rules) if rules else None


def evaluate_on_maps(
    policies: Sequence[str], maps: Mapping[str, GridMap], seed: int = 0
) -> list[MapResults]:
    """Play policies on maps; the results come map by map.

    Args:
        policies: Names or paths.
        maps: By name.
        seed: Of a policy's draws.

    Raises:
        PolicyNotFoundError: If there is no such policy.
        PolicyFileError: If a policy's file cannot be played.
    """
    names = list(dict.fromkeys(policies))
    for name in names:
        policy_files.load(name)
    results = []
    for title, grid_map in maps.items():
        played = tuple(result_of(name, _play(name, grid_map, seed), seed) for name in names)
        results.append(MapResults(title, grid_map.start, played))
    return results


def to_json(map_results: Sequence[MapResults]) -> str:
    """Everything as JSON: core_version, and each map's name, start and results."""
    maps = [
        {
            "name": played.name,
            "start": played.start,
            "results": [result.figures() for result in played.results],
        }
        for played in map_results
    ]
    return json.dumps({"core_version": CORE_VERSION, "maps": maps}, indent=1)


def _play(name: str, grid_map: GridMap, seed: int) -> Episode:
    config = grid_map.config()
    episode = Episode.begin(config, terrain=grid_map.terrain, start=grid_map.start)
    return play_out(policy_files.load(name, config.sensor_radius), episode, seed)
