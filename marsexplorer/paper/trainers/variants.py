"""Variants of an algorithm's settings: the letter of the paper, what completes terrains, and one change more or less.

paper             the settings of the paper
works             with the smallest set of changes that completes terrains
works-no-CHANGE   the same without one of them
paper+CHANGE      the paper's with one change, or with several: paper+reward+mask
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Variants:
    """The changes that an algorithm knows.

    algorithm  its name in words, for errors
    changes    name of a change -> the settings in which it differs from the paper's
    works      the changes of the variant "works"
    """

    algorithm: str
    changes: Mapping[str, Mapping[str, Any]]
    works: Sequence[str]

    @property
    def names(self) -> list[str]:
        """The names of the variants; besides, paper+CHANGE stands for any set of changes."""
        return ["paper", "works", *(f"works-no-{change}" for change in self.works)]

    def settings_for(self, variant: str) -> dict[str, Any]:
        """Return the settings in which a variant differs from the paper's; ValueError when there is none of that name."""
        if variant == "paper":
            return {}
        if variant == "works":
            return self._together(self.works)
        start, plus, added = variant.partition("+")
        if start == "paper" and plus and set(added.split("+")) <= set(self.changes):
            return self._together(added.split("+"))
        left_out = variant.removeprefix("works-no-")
        if left_out != variant and left_out in self.works:
            return self._together(change for change in self.works if change != left_out)
        known = ", ".join([*self.names, *(f"paper+{change}" for change in self.changes)])
        raise ValueError(f"{self.algorithm} has no variant {variant!r}; choose one of: {known}")

    def _together(self, changes: Iterable[str]) -> dict[str, Any]:
        return {name: value for change in changes for name, value in self.changes[change].items()}
