"""A beacon of the tests' own, with a key that is at hand: it signs rounds as drand does, by the same curve and scheme."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable
from dataclasses import replace

from pyblst import BlstP1Element, BlstP2Element

from humanplay.series import beacon
from humanplay.series.beacon import QUICKNET, Beacon

_ORDER = 0x73EDA753299D7D483339D80809A1D80553BDA402FFFE5BFEFFFFFFFF00000001


class OwnBeacon:
    """A beacon whose rounds the tests sign."""

    def __init__(self, draw: Callable[[int], int] = secrets.randbelow) -> None:
        """Begin with a key; `draw` gives a number below another one."""
        self._key = 1 + draw(_ORDER - 1)
        generator = BlstP2Element().uncompress(bytes.fromhex(beacon._G2))
        self._beacon = replace(
            QUICKNET, public_key=generator.scalar_mul(self._key).compress().hex()
        )

    def after(self, ms: int) -> Beacon:
        """Return the first round after a time."""
        return self._beacon.after(ms)

    def sign(self, named: Beacon) -> str:
        """Return the signature (hex) of a round."""
        number = hashlib.sha256(named.round.to_bytes(8, "big")).digest()
        message = BlstP1Element.hash_to_group(number, beacon._TAG)
        return str(message.scalar_mul(self._key).compress().hex())
