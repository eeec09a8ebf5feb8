"""Load policies by name or file: rules, shipped networks, and users' files."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

import numpy as np

from marsexplorer.config import FREE, MAX_RADIUS, ROVER, UNKNOWN
from marsexplorer.policies.base import Policy, PolicyNotFoundError, RandomPolicy, check_onnxruntime
from marsexplorer.policies.files.card import SUFFIX, of_paper, read_card, shipped
from marsexplorer.policies.files.model import refuse
from marsexplorer.policies.frontier import FrontierCost, FrontierUtility
from marsexplorer.policies.lookahead import TITLE, Lookahead
from marsexplorer.policies.priced import FrontierPriced

if TYPE_CHECKING:
    from marsexplorer.policies.network.policy import OnnxNet

BUILT_IN: dict[str, tuple[Callable[[int], Policy], str]] = {
    "frontier-priced": (
        FrontierPriced, "Prices unknown cells by how closed in they are, and goes where they are highest for the way.",
    ),
    "frontier-utility": (FrontierUtility, "Goes where the most new cells are expected for the squared way."),
    "frontier-cost": (FrontierCost, "Walks the shortest known way to the nearest frontier cell."),
    "lookahead": (
        lambda sensor_radius: Lookahead(load("ppo", sensor_radius), sensor_radius),
        "On level random it tries goals on terrains that agree with what is known, once most is known; elsewhere it is ppo.",
    ),
    "random": (lambda sensor_radius: RandomPolicy(), "Makes valid moves at random."),
}  # fmt: skip
"""Name -> what makes the policy for a sensor radius, and its summary."""


def names() -> list[str]:
    """The names of everything that loads by name, the best default first."""
    return [*(name for name in shipped() if name not in BUILT_IN), *BUILT_IN]


def describe(name: str) -> str:
    """One sentence about a policy that loads by name or path.

    A network's sentence comes from its card.
    """
    if name in BUILT_IN:
        return BUILT_IN[name][1]
    return str(read_card(find_file(name)).get("summary", "A policy from an ONNX file."))[:300]


def title(name: str) -> str:
    """A policy's name as people read it: its own, except for `lookahead`."""
    return TITLE if name == Lookahead.name else name


def load(name_or_path: str | Path, sensor_radius: int = 6) -> Policy:
    """Load a policy by name, or from an ONNX file by path.

    Networks of one unchanged file are shared.

    Args:
        name_or_path: A name of `names()`, or the path of an ONNX file.
        sensor_radius: Of the rover that it will drive, 1..31 cells; its expectations depend on it.

    Raises:
        PolicyNotFoundError: If there is no such policy.
        PolicyFileError: If the file cannot be played.
    """
    if not 1 <= sensor_radius <= MAX_RADIUS:
        raise ValueError(f"sensor_radius must be in 1..{MAX_RADIUS}, got {sensor_radius}")
    name = str(name_or_path)
    if name in BUILT_IN:
        return BUILT_IN[name][0](sensor_radius)
    path = find_file(name)
    policy = _load_file(path, sensor_radius)
    if path not in shipped().values():  # tests try those
        try_out(policy, path)
    return policy


def try_out(policy: Policy, path: Path) -> None:
    """Let a policy of a file decide once, to see that its numbers are finite.

    Weights can be finite and their sums not: a file of such weights would play by chance, and its
    numbers are not JSON. A value of NaN is that of a policy without one (`has_value`).

    Raises:
        PolicyFileError: If its probabilities or its value are not finite.
    """
    rows, cols = getattr(policy, "size", None) or (5, 5)
    codes = np.full((rows, cols), UNKNOWN, np.uint8)
    codes[:3, :3], codes[0, 0] = FREE, ROVER
    with np.errstate(all="ignore"):
        policy.reset(0)
        policy.act(codes)
        probabilities, value = getattr(policy, "thought", lambda: (np.zeros(4), math.nan))()
    has_none = math.isnan(value) and not getattr(policy, "has_value", False)
    is_value = math.isfinite(value) or has_none
    if not np.isfinite(probabilities).all() or not is_value:
        raise refuse(path, "finite numbers from a first decision", "others")
    policy.reset(0)


def find_file(name: str) -> Path:
    """The file of a name or path; PolicyNotFoundError if there is none."""
    by_name = shipped().get(name) or of_paper().get(name)
    if by_name is not None:
        return by_name
    path = Path(name)
    if path.is_file():
        return path
    if path.suffix == SUFFIX or path.name != name:
        raise PolicyNotFoundError(
            f"no policy file at {name}; check the path, or choose one of: {', '.join(names())}"
        )
    raise PolicyNotFoundError(
        f'no policy "{name}" in data/policies; choose one of: {", ".join((*names(), *of_paper()))}, or give a path'
    )


def is_rule(name: str) -> bool:
    """Whether a name is that of a rule, which is code and has no file."""
    return name in BUILT_IN


def find_shipped(digest: str) -> Path | None:
    """The shipped file with this SHA-256 (hex), whatever its name is now, or None."""
    files = {**shipped(), **of_paper()}
    return next((path for name, path in files.items() if policy_hash(name) == digest), None)


def policy_hash(name: str) -> str | None:
    """SHA-256 (hex) of a policy's file; None for a rule, which is code.

    PolicyNotFoundError if there is no such policy.
    """
    if name in BUILT_IN:
        return None
    with find_file(name).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _load_file(path: Path, sensor_radius: int) -> Policy:
    check_onnxruntime()  # and imported here: the library may be absent, and takes its time
    from marsexplorer.policies.files.onnx import OnnxModel, load_imported
    from marsexplorer.policies.network.policy import NetworkPolicy, OnnxNet

    state = path.stat()
    key = (str(path.resolve()), state.st_mtime_ns, state.st_size)
    net = _NETS.get(key)
    if net is None:
        model = OnnxModel(path)
        if not model.is_own_network:
            return load_imported(model)
        net = _NETS[key] = OnnxNet(model)
    return NetworkPolicy(path.stem, net, sensor_radius, net.acts)


_NETS: WeakValueDictionary[tuple[str, int, int], OnnxNet] = WeakValueDictionary()
"""The networks in use, by path, time and size of their files: boards that share one can be
decided together (see `batch`).
"""
