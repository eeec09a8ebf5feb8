"""The configuration of an episode: level, sizes, and its canonical hash.

Koutras et al. 2021, section 2 (rules), table 1 (radius, beta) and section 3.3 (the 12 difficulty
levels).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import product
from numbers import Integral, Real
from types import MappingProxyType
from typing import Any

CORE_VERSION = "1"
"""Rises whenever the same config, terrain and actions would give another trajectory, or a seed
another terrain.
"""

ACTIONS = ("north", "east", "south", "west")
"""Action codes 0..3 in words: row-1, col+1, row+1, col-1."""

OUTCOMES = ("running", "explored", "collided", "out_of_bounds", "timed_out", "abandoned")
"""Outcome codes 0..5 in words; everything but `running` ends the episode."""

RUNNING, EXPLORED, COLLIDED, OUT_OF_BOUNDS, TIMED_OUT, ABANDONED = range(6)
"""The outcome codes by name."""

UNKNOWN, FREE, ROVER, OBSTACLE = range(4)
"""Codes of the occupancy grid as the rover knows it."""

VALUES = (0.0, 0.3, 0.6, 1.0)
"""What the state matrix holds for those codes (eq. 2 and 6)."""

MAX_SEED = 2**53 - 1
MIN_SIDE, MAX_SIDE = 5, 1024
MAX_RADIUS = 31

RECTANGLES, BUILDING, CAVE, GIVEN = range(4)
"""How the terrains of a level are made: the paper's rectangles, a building or a cave
(generators.py), or not at all.
"""


@dataclass(frozen=True)
class Level:
    """A recipe for terrains.

    topology    0 for `random`; else d_t of section 3.3, the largest shift of an obstacle from its
                lattice point (cells)
    morphology  0 for `random`; else d_m, sides are 1..2 cells for 1 and 1..4 for 2
    has_bonus   d_b of section 3.3: True (1) with a bonus for completion and a penalty for failure,
                False (2) with neither
    generator   RECTANGLES for the levels of the paper; BUILDING, CAVE, or GIVEN for maps that have
                no seed
    """

    name: str
    topology: int
    morphology: int
    has_bonus: bool
    summary: str
    generator: int = RECTANGLES


def _levels() -> dict[str, Level]:
    summary = "rectangles of 1 to 3 cells a side anywhere (section 3.2)"
    levels = {"random": Level("random", 0, 0, True, summary)}
    for t, m, b in product((1, 2, 3), (1, 2), (1, 2)):
        sides = "1 to 2" if m == 1 else "1 to 4"
        pay = "with bonus and penalty" if b == 1 else "without bonus and penalty"
        summary = f"a lattice moved by up to {t}, rectangles of {sides} cells, {pay} (section 3.3)"
        levels[f"{t}-{m}-{b}"] = Level(f"{t}-{m}-{b}", t, m, b == 1, summary)
    return levels


LEVELS: MappingProxyType[str, Level] = MappingProxyType(_levels())
"""The levels of the paper: `random` and the twelve of section 3.3."""

MAP = "map"
"""The level of given maps, which has no terrains of its own."""

_OTHERS = (
    ("building", "rooms, corridors and doors, with solid blocks in rooms", BUILDING),
    ("cave", "a cave, entered at its mouth", CAVE),
    (MAP, "a given map", GIVEN),
)
OTHER_LEVELS: MappingProxyType[str, Level] = MappingProxyType(
    {name: Level(name, 0, 0, True, summary, generator) for name, summary, generator in _OTHERS}
)
"""Levels unlike those of the paper. Of their terrains, what can be discovered counts
(`EnvConfig.discoverable_only`).
"""

ALL_LEVELS: MappingProxyType[str, Level] = MappingProxyType({**LEVELS, **OTHER_LEVELS})


def _whole(name: str, number: object, low: int, high: int) -> int:
    """Convert a whole number of Python or NumPy, low..high, to an int.

    TypeError if it is not a whole number, ValueError if it is out of range.
    """
    if isinstance(number, bool) or not isinstance(number, Integral):
        raise TypeError(f"{name} must be a whole number, got {number!r}")
    whole = int(number)
    if not low <= whole <= high:
        bound = f"at least {low}" if whole < low else f"at most {high}"
        raise ValueError(f"{name} must be {bound}, got {whole}")
    return whole


def check_seed(seed: object) -> int:
    """Convert a seed to an int; it must be a whole number in 0..2^53-1.

    TypeError if it is not a whole number, ValueError if it is out of range.
    """
    return _whole("seed", seed, 0, MAX_SEED)


def fewest_cells(cells: int, beta: float) -> int:
    """The fewest discovered cells k with k / cells >= beta, for cells >= 1 (eq. 8)."""
    k = max(0, int(beta * cells) - 2)
    while k / cells < beta:
        k += 1
    return k


@dataclass(frozen=True)
class EnvConfig:
    """Everything besides the terrain that fixes an episode.

    level              a name in ALL_LEVELS
    rows, cols         cells, 5..1024 each
    sensor_radius      d of eq. 4, cells, 1..31
    beta               share of the cells that count to discover, in (0, 1] (eq. 8)
    max_steps          moves until truncation, at least 1; None means n = rows * cols
    discoverable_only  True: only cells count that the lidar can show from some cell within reach of
                       the start. False: all cells count. None: False for LEVELS, True for
                       OTHER_LEVELS

    Beta, coverage and the score refer to the cells that count. Bonus and penalty are n, the number
    of all cells.
    """

    level: str = "random"
    rows: int = 21
    cols: int = 21
    sensor_radius: int = 6
    beta: float = 0.99
    max_steps: int | None = None
    discoverable_only: bool | None = None

    def __post_init__(self) -> None:
        if self.level not in ALL_LEVELS:
            raise ValueError(f"no level {self.level!r}; choose one of: {', '.join(ALL_LEVELS)}")
        self._keep("rows", _whole("rows", self.rows, MIN_SIDE, MAX_SIDE))
        self._keep("cols", _whole("cols", self.cols, MIN_SIDE, MAX_SIDE))
        self._keep("sensor_radius", _whole("sensor_radius", self.sensor_radius, 1, MAX_RADIUS))
        is_number = isinstance(self.beta, Real) and not isinstance(self.beta, bool)
        if not is_number or not 0 < self.beta <= 1:
            raise ValueError(f"beta must be a number above 0 and at most 1, got {self.beta!r}")
        self._keep("beta", float(self.beta))
        limit = self.n if self.max_steps is None else self.max_steps
        self._keep("max_steps", _whole("max_steps", limit, 1, 2**31 - 1))
        if self.discoverable_only is None:
            self._keep("discoverable_only", self.level in OTHER_LEVELS)
        if not isinstance(self.discoverable_only, bool):
            raise TypeError(
                f"discoverable_only must be True, False or None, got {self.discoverable_only!r}"
            )
        if self.level in OTHER_LEVELS and not self.discoverable_only:
            raise ValueError(
                f"discoverable_only cannot be False for level {self.level!r}: much of it can never be seen"
            )

    def _keep(self, name: str, number: object) -> None:
        """Set a field of the frozen configuration to a plain number.

        Equal configurations have one hash, whatever kind of number they were made from.
        """
        object.__setattr__(self, name, number)

    @classmethod
    def of(
        cls, level: str = "random", size: int | tuple[int, int] = 21, *more: Any, **rest: Any
    ) -> EnvConfig:
        """The configuration of a level at a size: one side of a square, or (rows, cols).

        The other fields follow in their order, or by name.
        """
        if isinstance(size, Integral) and not isinstance(size, bool):
            return cls(level, int(size), int(size), *more, **rest)
        if isinstance(size, (tuple, list)) and len(size) == 2:
            return cls(level, size[0], size[1], *more, **rest)
        raise TypeError(f"size must be a whole number or (rows, cols), got {size!r}")

    @classmethod
    def of_dict(cls, fields: Mapping[str, Any]) -> EnvConfig:
        """The configuration of `to_dict`'s fields; ValueError or TypeError for others."""
        return cls(**fields)

    @property
    def size(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.rows, self.cols

    @cached_property
    def n(self) -> int:
        """Number of cells (eq. 1)."""
        return self.rows * self.cols

    @property
    def limit(self) -> int:
        """`max_steps` as a plain int (moves)."""
        assert self.max_steps is not None
        return self.max_steps

    @cached_property
    def target(self) -> int:
        """Fewest discovered cells k with k / n >= beta (eq. 8), where all cells count."""
        return fewest_cells(self.n, self.beta)

    @cached_property
    def r_bonus(self) -> int:
        """Reward for discovering beta of the cells: n, or 0 on levels without a bonus.

        Section 3.3: d_b = 2 means no bonus.
        """
        return self.n if ALL_LEVELS[self.level].has_bonus else 0

    @cached_property
    def r_invalid(self) -> int:
        """Penalty of an invalid move: n, or 0 on levels without a bonus."""
        return self.r_bonus

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-ready values; `EnvConfig(**fields)` restores them.

        `discoverable_only` is left out where it is the level's default, so that no hash depends on
        it there.
        """
        fields = asdict(self)
        if self.discoverable_only == (self.level in OTHER_LEVELS):
            del fields["discoverable_only"]
        return fields

    @cached_property
    def hash(self) -> str:
        """SHA-256 (hex) of the canonical JSON: keys sorted, no spaces."""
        text = json.dumps(self.to_dict(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()
