"""Policies on given maps: one episode each, for a map has one terrain and one start. So there are no intervals."""

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
    """What policies did on one map, in the order given; `to_rule` compares them.

    name    of the map
    start   (row, col)
    """

    name: str
    start: tuple[int, int]
    results: tuple[Result, ...]

    def to_rule(self, result: Result) -> float | None:
        """Return the steps to 99 % as a share of those of the better frontier rule, None where neither was played."""
        rules = [each.steps_to_99 for each in self.results if each.policy in RULES]
        return result.steps_to_99 / min(rules) if rules else None


def evaluate_on_maps(
    policies: Sequence[str], maps: Mapping[str, GridMap], seed: int = 0
) -> list[MapResults]:
    """Play policies on maps and return what they did, map by map.

    policies  names or paths
    maps      by name
    seed      of what a policy draws

    PolicyNotFoundError and PolicyFileError for policies that cannot be loaded.
    """
    names = list(dict.fromkeys(policies))
    for name in names:
        policy_files.load(name)
    results = []
    for title, found in maps.items():
        played = tuple(result_of(name, _play(name, found, seed), seed) for name in names)
        results.append(MapResults(title, found.start, played))
    return results


def to_json(found: Sequence[MapResults]) -> str:
    """Return everything as JSON: core_version, and of each map its name, start and results."""
    results = ([one.figures() for one in each.results] for each in found)
    pairs = zip(found, results, strict=True)
    maps = [{"name": each.name, "start": each.start, "results": own} for each, own in pairs]
    return json.dumps({"core_version": CORE_VERSION, "maps": maps}, indent=1)


def _play(name: str, found: GridMap, seed: int) -> Episode:
    config = found.config()
    episode = Episode.begin(config, terrain=found.terrain, start=found.start)
    return play_out(policy_files.load(name, config.sensor_radius), episode, seed)
