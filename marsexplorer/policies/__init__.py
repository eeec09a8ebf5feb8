"""Policies by name: random, the frontier rules, the planner, and trained networks from files.

`load(name_or_path)` returns a `Policy`; `names()` lists what loads by name, the best default first; `describe(name)`
says it in a sentence.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from marsexplorer.config import MAX_RADIUS
from marsexplorer.policies.base import Policy, PolicyFileError, PolicyNotFoundError
from marsexplorer.policies.files.card import SUFFIX, read_card, shipped
from marsexplorer.policies.frontier import FrontierCost, FrontierUtility
from marsexplorer.policies.planner import Planner
from marsexplorer.policies.random_policy import RandomPolicy

__all__ = ["Policy", "PolicyFileError", "PolicyNotFoundError", "describe", "load", "names"]

BUILT_IN: dict[str, tuple[Callable[[int], Policy], str]] = {
    "frontier-utility": (FrontierUtility, "Goes where the most new cells are expected for the squared way."),
    "frontier-cost": (FrontierCost, "Walks the shortest known way to the nearest frontier cell."),
    "planner": (Planner, "Imagines 16 whole tours at every move and follows the shortest."),
    "random": (lambda sensor_radius: RandomPolicy(), "Makes valid moves at random."),
}
"""Name -> what makes the policy for a sensor radius, and its summary."""


FILES = (SUFFIX, ".onnx", ".zip")
"""How the names of policy files end."""


def names() -> list[str]:
    """Return the names of everything that loads by name, the best default first."""
    return [*(name for name in shipped() if name not in BUILT_IN), *BUILT_IN]


def describe(name: str) -> str:
    """Return one sentence about a policy that loads by name (a shipped network's stands in its card)."""
    if name in BUILT_IN:
        return BUILT_IN[name][1]
    path = file_of(name)
    if path.suffix == ".zip":
        return f"A policy of Stable-Baselines3, from {path.name}."
    if path.suffix == ".onnx":
        from marsexplorer.policies.files.onnx import describe_onnx

        return describe_onnx(path)
    return str(read_card(path).get("summary", "A trained network."))


def load(name_or_path: str | Path, sensor_radius: int = 6) -> Policy:
    """Return a policy by name, or from a file by path: .safetensors, .onnx, or a .zip of Stable-Baselines3.

    sensor_radius  of the rover it will drive, 1..31 cells: what the policy expects to see depends on it
    """
    if not 1 <= sensor_radius <= MAX_RADIUS:
        raise ValueError(f"sensor_radius must be in 1..{MAX_RADIUS}, got {sensor_radius}")
    name = str(name_or_path)
    if name in BUILT_IN:
        return BUILT_IN[name][0](sensor_radius)
    path = file_of(name)
    if path.suffix == ".zip":
        from marsexplorer.policies.files.sb3 import load_sb3

        return load_sb3(path)
    if path.suffix == ".onnx":
        from marsexplorer.policies.files.onnx import load_onnx

        return load_onnx(path, sensor_radius)
    from marsexplorer.policies.network.model import (
        load_network,  # torch takes seconds to import: only when a network is asked for
    )

    return load_network(path, sensor_radius)


def file_of(name: str) -> Path:
    """Return the file that a name or path stands for; PolicyNotFoundError when there is none."""
    by_name = shipped().get(name)
    if by_name is not None:
        return by_name
    path = Path(name)
    if path.is_file():
        return path
    if path.suffix in FILES or path.name != name:
        raise PolicyNotFoundError(f"no policy file at {name}; check the path, or choose one of: {', '.join(names())}")
    raise PolicyNotFoundError(f'no policy "{name}" in data/policies; choose one of: {", ".join(names())}, or give a path')
