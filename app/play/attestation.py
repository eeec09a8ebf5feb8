"""How far a person's episode is attested: what the server has compared its moves with."""

from __future__ import annotations

from typing import Literal, get_args

Attestation = Literal["unattested", "declared", "attested", "supervised"]
"""Lowest first.

unattested  a move has no input event of its own that fits it
declared    the page called every move a key or a touch, and nothing was compared: episodes of earlier versions
attested    every move fits an input event of its own
supervised  attested, and the operator had typed their code shortly before
"""

LEVELS: tuple[Attestation, ...] = get_args(Attestation)


def level_reaches(level: Attestation | None, required: Attestation) -> bool:
    """Return whether a level is the required one or a higher one; None, a script's, reaches none."""
    return level is not None and LEVELS.index(level) >= LEVELS.index(required)
