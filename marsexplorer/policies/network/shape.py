"""What a network of the paper's four algorithms is made of: everything that fixes its layers, as the card of its file has it.

From a `NetworkShape` alone the network is built again, so the shape is checked before anything is built: cards come from
strangers' files too.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

TRUNKS = ("rllib", "authors", "features")
HEADS = ("policy", "q", "categorical")
CRITICS = ("shared", "separate", "none")

SMALLEST_SIDE, LARGEST_SIDE = 5, 128
"""Sides of the grids that a state matrix may have, cells."""
LARGEST_ATOMS = 501
MOST_HIDDEN, LARGEST_HIDDEN = 4, 2048
"""Hidden layers of a head, and units of each."""
LARGEST_SUPPORT = 1e6
"""Bound on both ends of a categorical support, in units of the rewards that were trained on."""


class ShapeError(ValueError):
    """A shape is not one that a network is built from; `expected` and `came` say why in words."""

    def __init__(self, expected: str, came: object) -> None:
        self.expected, self.came = expected, repr(came)[:60]
        super().__init__(f"expected {self.expected}, got {self.came}")


@dataclass(frozen=True)
class NetworkShape:
    """What fixes a network's layers; ShapeError when the fields do not fit together.

    trunk       what reads the observation:
                "rllib"     the state matrix by 16 and 32 filters of 4 x 4 with stride 2 and 256 units, RLlib's defaults
                "authors"   the state matrix by 8 filters of 3 x 3 and 16 of 2 x 2 with stride 2 and 512 units, as in the
                            authors' repository
                "features"  the pictures and numbers of `features`, by 384 and 128 units, as `model.Net`
    head        what is said of the four moves:
                "policy"       a logit each, and a value of the observation
                "q"            a value each
                "categorical"  a distribution of the return each, over `atoms` numbers from support[0] to support[1]
    rows, cols  size of the grid for the state matrix; None for features, which serve every size
    critic      of the head "policy": a value from the "shared" trunk, from a "separate" one, or "none"; of others "none"
    hidden      units of the dense layers between the state matrix's trunk and the heads "policy" and "q"
    mask        whether the network works out which moves are invalid and gives them the lowest logit or value
    atoms       2..LARGEST_ATOMS for the head "categorical", else None
    support     (lowest, highest return) for the head "categorical", else None
    """

    trunk: str
    head: str
    rows: int | None = None
    cols: int | None = None
    critic: str = "none"
    hidden: tuple[int, ...] = ()
    mask: bool = False
    atoms: int | None = None
    support: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name, value, known in (
            ("trunk", self.trunk, TRUNKS),
            ("head", self.head, HEADS),
            ("critic", self.critic, CRITICS),
        ):
            if not isinstance(value, str) or value not in known:
                raise ShapeError(f"one of {', '.join(known)} as the {name} of a network", value)
        if type(self.mask) is not bool:
            raise ShapeError("true or false as the mask of a network", self.mask)
        self._check_size()
        self._check_hidden()
        self._check_head()

    def _check_hidden(self) -> None:
        hidden = self.hidden
        if not (isinstance(hidden, tuple) and len(hidden) <= MOST_HIDDEN):
            raise ShapeError(f"at most {MOST_HIDDEN} hidden layers", hidden)
        if not all(type(units) is int and 1 <= units <= LARGEST_HIDDEN for units in hidden):
            raise ShapeError(f"hidden layers of 1 to {LARGEST_HIDDEN} units", hidden)
        if hidden and (self.observation == "features" or self.head == "categorical"):
            raise ShapeError(
                "no hidden layers of one's own with features or the head categorical", hidden
            )

    def _check_size(self) -> None:
        size = (self.rows, self.cols)
        if self.observation == "features":
            if size != (None, None):
                raise ShapeError(
                    "no rows and cols for a network of features, which serves every size", size
                )
        elif not all(type(side) is int and SMALLEST_SIDE <= side <= LARGEST_SIDE for side in size):
            raise ShapeError(f"rows and cols of {SMALLEST_SIDE} to {LARGEST_SIDE} cells", size)

    def _check_head(self) -> None:
        if self.head != "policy" and self.critic != "none":
            raise ShapeError(
                f'"none" as the critic of a network with the head {self.head}', self.critic
            )
        if self.head != "categorical":
            if (self.atoms, self.support) != (None, None):
                raise ShapeError(
                    f"no atoms and no support for the head {self.head}", (self.atoms, self.support)
                )
            return
        if type(self.atoms) is not int or not 2 <= self.atoms <= LARGEST_ATOMS:
            raise ShapeError(f"2 to {LARGEST_ATOMS} atoms", self.atoms)
        support = self.support
        if not (
            isinstance(support, tuple)
            and len(support) == 2
            and all(type(end) in (int, float) for end in support)
        ):
            raise ShapeError("a support of two numbers", support)
        if not -LARGEST_SUPPORT <= support[0] < support[1] <= LARGEST_SUPPORT:
            raise ShapeError(f"a support that rises, within {LARGEST_SUPPORT:.0f} of 0", support)

    @property
    def observation(self) -> str:
        """What the network is given: "state" (codes uint8[b, rows, cols]) or "features" (planes and moves)."""
        return "features" if self.trunk == "features" else "state"

    @property
    def size(self) -> tuple[int, int] | None:
        """(rows, cols) of the grids that it serves; None for every size."""
        return None if self.rows is None or self.cols is None else (self.rows, self.cols)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as JSON-ready values."""
        support = None if self.support is None else [float(end) for end in self.support]
        return {**asdict(self), "hidden": list(self.hidden), "support": support}

    @classmethod
    def from_dict(cls, found: object) -> NetworkShape:
        """Return the shape that `to_dict` described, from JSON; ShapeError when it is anything else."""
        names = [field.name for field in fields(cls)]
        if not isinstance(found, dict) or not set(found) <= set(names):
            raise ShapeError(f'a "network" in the card with {", ".join(names)}', found)
        for name in ("trunk", "head"):
            if name not in found:
                raise ShapeError(f'a "{name}" in the "network" of the card', found)
        lists = {name: tuple(value) for name, value in found.items() if isinstance(value, list)}
        return cls(**{**found, **lists})
