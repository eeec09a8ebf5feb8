"""Seeds of a study's or a day's terrains, which follow from a secret.

A commitment binds the secret before anybody has played.

Nobody can choose or foresee a seed without the secret; once it is told, at the closing of the study or the end of the day,
anybody can draw them again.
"""

from __future__ import annotations

import hashlib
import hmac
from typing import Literal

SeedLabel = Literal["ranked", "warm-up"]
TUTORIAL_SEED = 1
"""The tutorial's terrain is the same in every study, and public."""


def commitment(secret: bytes) -> str:
    """SHA-256 (hex) of the secret: published before anybody plays, checked afterwards."""
    return hashlib.sha256(secret).hexdigest()


def seed(secret: bytes, protocol_hash: str, label: SeedLabel, i: int) -> int:
    """The seed of terrain i (from 0), 0..2^53-1.

    It is the first 53 bits of HMAC-SHA256(secret, "hash|label|i").
    """
    return int.from_bytes(_hmac(secret, f"{protocol_hash}|{label}|{i}")[:8], "big") >> 11


def balanced_order(
    secret: bytes, protocol_hash: str, group: str, number: int, ranked: int
) -> list[int]:
    """The order of the ranked terrains 0..ranked-1 for one participant.

    Each `ranked` participants in turn take the rows of one Latin square, so each terrain comes
    equally often at each position. With an even number of terrains, each also follows each other one
    equally often (Williams 1949, Aust. J. Sci. Res. A 2(2)). Rows and labels are permuted by HMAC,
    anew for each square and group: without the secret nobody can foresee an order.

    Args:
        group: `order_group`. Scripts have squares of their own, and so has each arm: otherwise they
            would unbalance others' terrains.
        number: The participant's number in the group, from 0.
    """
    square, place = divmod(number, ranked)
    prefix = f"{protocol_hash}|square|{group}|{square}"
    rows, labels = (
        sorted(range(ranked), key=lambda i: _hmac(secret, f"{prefix}|{permuted}|{i}"))
        for permuted in ("row", "label")
    )
    # 0, 1, n-1, 2, n-2, ...
    zigzag = [(1 + i) // 2 if i % 2 else (ranked - i // 2) % ranked for i in range(ranked)]
    return [labels[(rows[place] + step) % ranked] for step in zigzag]


IN_A_BLOCK = 2
"""How often each arm comes in a block. With once, whoever knows the other arms would know the last."""


def drawn_arm(secret: bytes, protocol_hash: str, group: str, number: int, arms: int) -> int:
    """The arm (from 0) of who is `number` (from 0) to be assigned in their group.

    Arms come in permuted blocks (Zelen 1974, J. Chronic Dis. 27(7-8)): among each `arms` times IN_A_BLOCK people in turn
    every arm comes IN_A_BLOCK times, in an order that is drawn by HMAC anew for each block.

    group  "human" or "script"
    """
    size = arms * IN_A_BLOCK
    block, place = divmod(number, size)
    named = f"{protocol_hash}|arm|{group}|{block}"
    order = sorted(range(size), key=lambda i: _hmac(secret, f"{named}|{i}"))
    return order[place] % arms


def order_group(kind: str, arm: str | None) -> str:
    """The group whose Latin squares somebody's order is from: of their kind and arm."""
    return kind if arm is None else f"{kind}|{arm}"


def _hmac(secret: bytes, text: str) -> bytes:
    return hmac.new(secret, text.encode(), hashlib.sha256).digest()
