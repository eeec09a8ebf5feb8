"""Short codes that people type: letters and digits that cannot be mistaken for each other, in groups of four."""

from __future__ import annotations

import hashlib
import hmac

ALPHABET = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
"""Crockford's base 32: without I, L, O and U. A typed I or L is read as 1, an O as 0."""

_LOOK_ALIKES = str.maketrans("ILO", "110", " -_")


def signature(secret: bytes, text: str, length: int) -> str:
    """Return `length` characters (5 bits each, at most 51 of them) of HMAC-SHA256(secret, text)."""
    number = int.from_bytes(hmac.new(secret, text.encode(), hashlib.sha256).digest(), "big")
    return "".join(ALPHABET[number >> (256 - 5 * (i + 1)) & 31] for i in range(length))


def grouped(code: str) -> str:
    """Return a code in groups of four, as it is shown."""
    return "-".join(code[i : i + 4] for i in range(0, len(code), 4))


def read_code(typed: str) -> str:
    """Return what was typed as a code: without spaces and dashes, in capitals, look-alikes read as what they look like."""
    return typed.upper().translate(_LOOK_ALIKES)
