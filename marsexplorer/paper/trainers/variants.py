"""Variants of an algorithm's settings: the letter of the paper, what completes terrains, and one change more or less.

paper             the settings of the paper
works             with the smallest set of changes that completes terrains
works-no-CHANGE   the same without one of them
tuned             with the changes too that let it need fewer moves
tuned-no-CHANGE   the same without one of them
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
    tuned      those of the variant "tuned"
    """

    algorithm: str
    changes: Mapping[str, Mapping[str, Any]]
    works: Sequence[str]
    tuned: Sequence[str]

    @property
    def names(self) -> list[str]:
        """The names of the variants; besides, paper+CHANGE stands for any set of changes."""
        return [
            "paper",
            *(
                each
                for name, added in self._sets.items()
                for each in (name, *(f"{name}-no-{one}" for one in added))
            ),
        ]

    @property
    def _sets(self) -> dict[str, Sequence[str]]:
        """Variant -> the changes that it makes together."""
        return {"works": self.works, "tuned": self.tuned}

    def settings_for(self, variant: str) -> dict[str, Any]:
        """Return the settings in which a variant differs from the paper's; ValueError when there is none of that name."""
        if variant == "paper":
            return {}
        name, without, left_out = variant.partition("-no-")
        changes = self._sets.get(name, ())
        if (changes and not without) or left_out in changes:
            return self._together(change for change in changes if change != left_out)
        start, plus, added = variant.partition("+")
        if start == "paper" and plus and set(added.split("+")) <= set(self.changes):
            return self._together(added.split("+"))
        known = ", ".join([*self.names, *(f"paper+{change}" for change in self.changes)])
        raise ValueError(f"{self.algorithm} has no variant {variant!r}; choose one of: {known}")

    def _together(self, changes: Iterable[str]) -> dict[str, Any]:
        return {name: value for change in changes for name, value in self.changes[change].items()}
