"""The terrains of a study: seeds that follow from a secret, which a commitment binds before anybody has played.

Nobody can choose or foresee a seed without the secret; once `study close` has revealed it, anybody can draw them again.
"""

from __future__ import annotations

import hashlib
import hmac
from typing import Literal

SeedLabel = Literal["ranked", "warm-up"]
TUTORIAL_SEED = 1
"""The tutorial's terrain is the same in every study, and public."""


def commitment(secret: bytes) -> str:
    """Return SHA-256 (hex) of the secret: published on freezing, checked against the secret on closing."""
    return hashlib.sha256(secret).hexdigest()


def seed(secret: bytes, protocol_hash: str, label: SeedLabel, i: int) -> int:
    """Return the seed of terrain i (from 0): the first 53 bits of HMAC-SHA256(secret, "hash|label|i"), 0..2^53-1."""
    return int.from_bytes(_hmac(secret, f"{protocol_hash}|{label}|{i}")[:8], "big") >> 11


def order(secret: bytes, protocol_hash: str, participant_id: str, ranked: int) -> list[int]:
    """Return the order in which a participant meets the ranked terrains 0..ranked-1: one of their own, drawn by HMAC."""
    return sorted(range(ranked), key=lambda i: _hmac(secret, f"{protocol_hash}|order|{participant_id}|{i}"))


def _hmac(secret: bytes, text: str) -> bytes:
    return hmac.new(secret, text.encode(), hashlib.sha256).digest()
