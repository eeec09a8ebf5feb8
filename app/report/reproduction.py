"""Two reports compared number by number: the one that a release holds, and the one derived again from its data.

Numbers agree when they differ by less than one part in 10^9, since libraries of other versions add in another order. Texts
agree when they are equal, apart from the software's version. Times and versions of the derivation itself are not compared.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

NOT_COMPARED = ("made_at", "software_version")
"""Keys of a report that tell when and by what it was made."""

MOVE_KEYS = ("moves", "cautions")
"""Keys of a group that cannot be derived without the policies that its moves are compared with."""

RELATIVE, ABSOLUTE = 1e-9, 1e-12
SECTIONS = (
    "figures",
    "metrics",
    "comparisons",
    "players",
    "pictures",
    "moves",
    "flow",
    "labels",
    "outcomes",
    "stages",
)
MOST_NAMED = 20
"""Differences that are kept with their values, in each section."""

Place = tuple[str | int, ...]
_ABSENT = object()


@dataclass
class Section:
    """What came of one part of a report.

    compared     values: numbers and texts
    differ       of these
    differences  the first of them, each a sentence
    """

    compared: int = 0
    differ: int = 0
    differences: list[str] = field(default_factory=list)

    def add(self, where: str, recorded: Any, derived: Any, is_same: bool) -> None:
        """Count one value."""
        self.compared += 1
        if not is_same:
            self.differ += 1
            if len(self.differences) < MOST_NAMED:
                self.differences.append(
                    f"{where}: {_shown(recorded)} in the release, {_shown(derived)} derived again"
                )


def compare_reports(
    recorded: Mapping[str, Any], derived: Mapping[str, Any], left_out: Sequence[str] = ()
) -> dict[str, Section]:
    """Return section -> its comparison, for two reports as `Report.to_dict` gives them.

    Every number and text of the recorded report is compared; what only the derived one has is a later version's, and new.

    left_out  keys of groups that are not compared
    """
    found: dict[str, Section] = {}
    known = dict(_leaves(derived))
    versions = str(recorded.get("software_version")), str(derived.get("software_version"))
    for place, value in _leaves(recorded):
        if place[0] in NOT_COMPARED or (
            place[0] == "groups" and len(place) > 2 and place[2] in left_out
        ):
            continue
        again = known.get(place, _ABSENT)
        section = found.setdefault(_section(place), Section())
        section.add(_words(place), value, again, _is_same(value, again, versions))
    return found


def _leaves(value: Any, place: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Yield (place, value) of every number and text, and the length of every list."""
    if isinstance(value, Mapping):
        for key, each in value.items():
            yield from _leaves(each, (*place, key))
    elif isinstance(value, (list, tuple)):
        yield (*place, "length"), len(value)
        for index, each in enumerate(value):
            yield from _leaves(each, (*place, index))
    else:
        yield place, value


def _section(place: Place) -> str:
    if place[0] == "groups" and len(place) > 2:
        return str(place[2]) if place[2] in SECTIONS else "participants and cautions"
    return str(place[0]) if place[0] in ("policies", "protocol", "checklist") else "study"


def _words(place: Place) -> str:
    return ".".join(str(part) for part in place)


def _is_same(one: Any, other: Any, versions: tuple[str, str]) -> bool:
    if isinstance(one, float) and isinstance(other, (int, float)) and not isinstance(other, bool):
        return math.isclose(one, other, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    if isinstance(one, str) and isinstance(other, str):
        return one.replace(*versions) == other
    return type(one) is type(other) and bool(one == other)


def _shown(value: Any) -> str:
    if value is _ABSENT:
        return "nothing"
    return f"{value[:60]}..." if isinstance(value, str) and len(value) > 63 else repr(value)
