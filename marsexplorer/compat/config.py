"""The authors' configurations: their names, and what each preset sets."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from math import ceil
from numbers import Integral, Real
from types import MappingProxyType
from typing import Any

from marsexplorer.compat.kernels import POINTS

Conf = Mapping[str, Any]
"""A configuration by the authors' names."""

DEFAULT_CONFIG: dict[str, Any] = {
    "initial": [0, 0],
    "size": [21, 21],
    "movementCost": 0.2,
    "obstacles": 12,
    "number_rows": None,
    "number_columns": None,
    "noise": [0, 0],
    "margins": [1, 1],
    "obstacle_size": [2, 2],
    "max_steps": 400,
    "bonus_reward": 400,
    "collision_reward": -400,
    "out_of_bounds_reward": -400,
    "lidar_range": 6,
    "lidar_channels": 32,
    "viewer": {},
}
"""The authors' defaults; programs change it and give it to `make`."""
_DEFAULTS = MappingProxyType(deepcopy(DEFAULT_CONFIG))

VIEWER_NAMES = frozenset({"viewer", "viwer"})
"""Names without effect; the second is a slip in the authors' own files."""
PAIRS = ("size", "initial", "noise", "margins", "obstacle_size")
REWARDS = ("movementCost", "bonus_reward", "collision_reward", "out_of_bounds_reward")
MOST_CHANNELS = 1024
MOST_MEMORY = 256 << 20
"""Bytes of the list of all cells' rays."""


@dataclass(frozen=True)
class Preset:
    """A class of the authors' repository at one commit, with a configuration there.

    share    of all cells above which an episode is complete
    rover    what the observation holds in the rover's cell after a move
    changes  of DEFAULT_CONFIG
    """

    class_name: str
    commit: str
    share: float
    rover: float
    changes: Conf = field(default_factory=dict)


def _ends(completion: int, invalid: int) -> Conf:
    """Return the rewards of the three ends."""
    return {
        "bonus_reward": completion,
        "collision_reward": invalid,
        "out_of_bounds_reward": invalid,
    }


def _lattice(count: int, noise: int, obstacle_size: int) -> Conf:
    """Return a square lattice of obstacles."""
    return {
        "number_rows": count,
        "number_columns": count,
        "noise": [noise, noise],
        "obstacle_size": [obstacle_size, obstacle_size],
    }


def _levels() -> dict[str, Preset]:
    """Return the twelve levels of trainners/trainnerV2.json."""
    kinds = [(noise, pay, size) for noise in (1, 2, 3) for pay in (0, 400) for size in (2, 4)]
    return {
        f"level-{number}": Preset(
            "ExplorerConf", "e0349b4", 0.95, 0.5, {**_lattice(3, noise, size), **_ends(pay, pay)}
        )
        for number, (noise, pay, size) in enumerate(kinds, 1)
    }


PRESETS: Mapping[str, Preset] = MappingProxyType(
    {
        "exploConf": Preset("ExplorerConf", "2e2dcd7", 0.99, 0.6),
        "explorer": Preset("Explorer", "7bc83f4", 0.95, 0.5),
        **_levels(),
        "videos": Preset(
            "ExplorerConf", "b9c0cad", 0.99, 0.6, {**_lattice(3, 3, 2), **_ends(0, 0)}
        ),
        "42x42": Preset(
            "ExplorerConf",
            "3b7252d",
            0.99,
            0.6,
            {**_lattice(6, 2, 2), **_ends(0, -50), "size": [42, 42], "max_steps": 2500},
        ),
        "84x84": Preset(
            "ExplorerConf",
            "b9c0cad",
            0.99,
            0.6,
            {**_lattice(12, 3, 2), **_ends(0, 0), "size": [84, 84]},
        ),
    }
)
"""Name -> preset, as docs/from-mars-explorer.md lists them."""


@dataclass(frozen=True)
class CodeConfig:
    """A preset with a program's own configuration over it, checked.

    conf   every name of DEFAULT_CONFIG but the viewer's
    share  of all cells above which an episode is complete
    rover  what the observation holds in the rover's cell after a move
    """

    conf: Conf
    share: float
    rover: float

    @classmethod
    def of(cls, preset: str = "exploConf", conf: Conf | None = None) -> CodeConfig:
        """A preset, changed by `conf`.

        Raises:
            ValueError: for an unknown preset or name, or a number that the authors' code cannot
                take.
            TypeError: for another kind of number.
        """
        if preset not in PRESETS:
            raise ValueError(f"no preset {preset!r}; choose one of: {', '.join(PRESETS)}")
        base, changes = PRESETS[preset], dict(conf or {})
        if unknown := sorted(set(changes) - set(_DEFAULTS) - VIEWER_NAMES):
            names = ", ".join(name for name in _DEFAULTS if name not in VIEWER_NAMES)
            raise ValueError(f"conf has no {', '.join(unknown)}; it may name: {names}")
        whole = {**_DEFAULTS, **base.changes, **changes}
        named = {name: whole[name] for name in _DEFAULTS if name not in VIEWER_NAMES}
        _check(named)
        return cls(deepcopy(named), base.share, base.rover)

    @property
    def rows(self) -> int:
        """Cells along x."""
        return int(self.conf["size"][0])

    @property
    def cols(self) -> int:
        """Cells along y."""
        return int(self.conf["size"][1])

    @property
    def n(self) -> int:
        """Number of cells."""
        return self.rows * self.cols

    @property
    def initial(self) -> tuple[int, int]:
        """Where the rover begins, (x, y)."""
        x, y = self.conf["initial"]
        return int(x), int(y)

    @property
    def is_lattice(self) -> bool:
        """Whether obstacles stand on a lattice."""
        return self.conf["number_rows"] is not None

    @property
    def cuts_distances(self) -> bool:
        """Whether fractions of the lidar's distances are cut: if its range is an integer."""
        return isinstance(self.conf["lidar_range"], Integral)

    @property
    def rewards(self) -> tuple[float, float, float, float]:
        """Cost of a move; rewards of completion, of a collision and of leaving the grid."""
        cost, bonus, collision, out_of_bounds = (float(self.conf[name]) for name in REWARDS)
        return cost, bonus, collision, out_of_bounds


def _check(conf: Conf) -> None:
    """Raise ValueError or TypeError for what the authors' code cannot take."""
    for name in PAIRS:
        pair = conf[name]
        if not isinstance(pair, (list, tuple)) or len(pair) != 2:
            raise TypeError(f"conf[{name!r}] must be a list of two numbers, got {pair!r}")
        for number in pair:
            _check_number(name, number, whole=name != "noise")
    for name in (*REWARDS, "lidar_range"):
        _check_number(name, conf[name], whole=False)
    for name in ("obstacles", "max_steps", "lidar_channels"):
        _check_number(name, conf[name], whole=True)
    rows, cols = conf["size"]
    x, y = conf["initial"]
    _require(1 <= rows <= 1024 and 1 <= cols <= 1024, "size", "1 to 1,024 cells a side", conf)
    _require(0 <= x < rows and 0 <= y < cols, "initial", "a cell of the grid", conf)
    _require(0 <= conf["lidar_range"] <= 64, "lidar_range", "0 to 64 cells", conf)
    _require(
        1 <= conf["lidar_channels"] <= MOST_CHANNELS,
        "lidar_channels",
        f"1 to {MOST_CHANNELS:,}",
        conf,
    )
    _require(conf["obstacles"] >= 0, "obstacles", "0 or more", conf)
    _require(conf["max_steps"] >= 0, "max_steps", "0 or more", conf)
    _require(min(conf["noise"]) >= 0, "noise", "0 or more cells", conf)
    _check_memory(conf)
    _check_obstacles(conf)


def points_of_ray(conf: Conf) -> int:
    """The most cells of a ray: a line enters no more cells than it crosses edges."""
    crossed: int = 2 * ceil(conf["lidar_range"]) + 4
    return min(POINTS, crossed)


def _check_memory(conf: Conf) -> None:
    """Raise ValueError where the rays of all cells would take more than MOST_MEMORY."""
    rows, cols = conf["size"]
    channels, points = conf["lidar_channels"], points_of_ray(conf)
    needed = 4 * rows * cols * channels * points
    if needed > MOST_MEMORY:
        raise ValueError(
            f"conf asks for {rows} x {cols} cells with {channels} rays of up to {points} cells "
            f"each: {ceil(needed / 2**20):,} MiB, and {MOST_MEMORY >> 20} MiB are allowed; make "
            "size, lidar_channels or lidar_range smaller"
        )


def _check_obstacles(conf: Conf) -> None:
    """Raise ValueError where no obstacle can be drawn."""
    counts = conf["number_rows"], conf["number_columns"]
    if (counts[0] is None) != (counts[1] is None):
        raise ValueError("conf has one of number_rows and number_columns: give both, or neither")
    low, high = conf["obstacle_size"]
    if counts[0] is not None:
        for name in ("number_rows", "number_columns"):
            _check_number(name, conf[name], whole=True)
            _require(conf[name] >= 1, name, "1 or more", conf)
        _require(min(low, high) >= 2, "obstacle_size", "2 or more on a lattice", conf)
        return
    _require(0 <= low <= high, "obstacle_size", "a smallest and a largest side", conf)
    rows, cols = conf["size"]
    across, down = conf["margins"]
    is_room = 0 <= across < cols - 1 - across and 0 <= down < rows - 1 - down
    _require(is_room, "margins", "small enough to leave room for obstacles", conf)


def _check_number(name: str, number: Any, *, whole: bool) -> None:
    kind = Integral if whole else Real
    if isinstance(number, bool) or not isinstance(number, kind):
        wanted = "whole numbers" if whole else "numbers"
        raise TypeError(f"conf[{name!r}] takes {wanted}, got {number!r}")


def _require(holds: bool, name: str, wanted: str, conf: Conf) -> None:
    if not holds:
        raise ValueError(f"conf[{name!r}] must be {wanted}, got {conf[name]!r}")
