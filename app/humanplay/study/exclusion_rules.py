"""The rules by which a protocol leaves people out of an estimate, or flags them."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import StrictBool

Rule = Literal[
    "completed",
    "all_ranked_driver_human",
    "max_given_up_share",
    "no_labels",
    "max_pause_share",
    "max_touch_share",
    "passed_practice",
    "min_minutes",
    "max_minutes",
    "max_missed_checks",
    "max_devices",
]
ExclusionRules = dict[Rule, StrictBool | float]
"""Rule -> its bound, or whether it applies."""

PER_PROTOCOL = "protocol"
"""The exclusion set of the per-protocol estimate."""

SHARES: tuple[Rule, ...] = ("max_given_up_share", "max_pause_share", "max_touch_share")
"""Rules that take a number from 0 to 1."""

NUMBERS: tuple[Rule, ...] = (
    *SHARES,
    "min_minutes",
    "max_minutes",
    "max_missed_checks",
    "max_devices",
)
"""Rules that take a number; the others are true or false."""

EXCLUSION: dict[str, ExclusionRules] = {
    PER_PROTOCOL: {"completed": True, "all_ranked_driver_human": True, "max_given_up_share": 0.5},
    "strict": {
        "completed": True,
        "all_ranked_driver_human": True,
        "max_given_up_share": 0.5,
        "no_labels": True,
        "max_pause_share": 0.5,
    },
}
"""The default exclusion sets, one for each estimate besides that for everybody."""


def check_rules(rules: ExclusionRules) -> None:
    """Check that every rule has a bound that it can take.

    Raises:
        ValueError: If one has not.
    """
    for rule, bound in rules.items():
        _check_kind(rule, bound)
    _check_count("max_missed_checks", rules.get("max_missed_checks", 0), 0)
    _check_count("max_devices", rules.get("max_devices", 1), 1)
    least = rules.get("min_minutes", 0.0)
    most = rules.get("max_minutes", math.inf)
    if not 0 <= least < most:
        raise ValueError(
            f"min_minutes must be at least 0 and below max_minutes, got {least:g} and {most:g}"
        )


def _check_kind(rule: Rule, bound: bool | float) -> None:
    takes_number = rule in NUMBERS
    if isinstance(bound, bool) is takes_number:
        expected = "a number" if takes_number else "true or false"
        raise ValueError(f"the rule {rule} takes {expected}, got {bound}")
    if rule in SHARES and not 0 <= bound <= 1:
        raise ValueError(f"the rule {rule} takes a share, 0 to 1, got {bound:g}")


def _check_count(rule: Rule, bound: float, least: int) -> None:
    if bound < least or bound % 1:
        raise ValueError(f"the rule {rule} takes a whole number from {least}, got {bound:g}")
