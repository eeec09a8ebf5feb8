"""A round of a public beacon, against secrets that were tried out: named when a study is frozen, entered when it is opened.

The beacon is drand's "quicknet" (scheme `bls-unchained-g1-rfc9380`): every three seconds many parties sign the number of the
round together, and nobody, none of them either, has the signature before. A round that was named when the secret was committed
to came out later, so whoever drew secret after secret could not see which terrains each would give.
"""

from __future__ import annotations

import hashlib
import json
import urllib.error
import urllib.request
from dataclasses import asdict, dataclass, replace
from typing import Any

from humanplay.series.files import iso, now_ms
from humanplay.series.protocol import StudyError, canonical_json

_CHAIN = "52db9ba70e0cc0f6eaf7803dd07447a1f5477735fd3f661792ba94600c84e971"
"""What relays call quicknet."""
_TAG = b"BLS_SIG_BLS12381G1_XMD:SHA-256_SSWU_RO_NUL_"
_G2 = (
    "93e02b6052719f607dacd3a088274f65596bd0d09920b61ab5da61bbdc7f5049334cf11213945d57e5ac7d055d042b7e"
    "024aa2b2f08f0a91260805272dc51051c6e47ad4fa403b02b4510b647ae3d1770bac0326a805bbefd48056c8c121bdb8"
)
"""The generator of the group of public keys, compressed."""


@dataclass(frozen=True)
class Beacon:
    """A beacon and a round of it.

    public_key  hex, 96 bytes: a compressed point of G2 of the curve BLS12-381
    genesis_s   seconds since 1970 of its first round
    period_s    seconds between two rounds
    round       the round that is named, from 1
    """

    public_key: str
    genesis_s: int
    period_s: int
    round: int

    @classmethod
    def parse(cls, text: str | None) -> Beacon | None:
        """Return the beacon of the JSON that the database holds; None for none. ValueError or TypeError for other text."""
        return None if text is None else cls(**json.loads(text))

    def to_json(self) -> str:
        """Return the JSON that the database holds."""
        return canonical_json(asdict(self)).decode()

    @property
    def round_ms(self) -> int:
        """When the round comes out, in milliseconds since 1970."""
        return (self.genesis_s + (self.round - 1) * self.period_s) * 1000

    @property
    def is_public(self) -> bool:
        """Whether it is the one that this software knows to be public; another one may be its operator's own."""
        return replace(self, round=QUICKNET.round) == QUICKNET

    def after(self, ms: int) -> Beacon:
        """Return the beacon with the first round that comes out later than a time (milliseconds since 1970) named."""
        rounds = (ms // 1000 - self.genesis_s) // self.period_s + 2
        return replace(self, round=max(1, rounds))

    def has_signed(self, signature: str) -> bool:
        """Return whether a signature (hex) is the beacon's for its round."""
        from pyblst import BlstP1Element, BlstP2Element, final_verify, miller_loop

        number = hashlib.sha256(self.round.to_bytes(8, "big")).digest()
        try:
            signed = BlstP1Element().uncompress(bytes.fromhex(signature))
            points = (self.public_key, _G2)
            key, generator = (BlstP2Element().uncompress(bytes.fromhex(each)) for each in points)
        except ValueError:
            return False
        message = BlstP1Element.hash_to_group(number, _TAG)
        return bool(final_verify(miller_loop(signed, generator), miller_loop(message, key)))

    def fetch(self, relay: str) -> str:
        """Return the round's signature (hex) from a relay, unchecked: any relay will do. StudyError when it cannot be had."""
        if self.round_ms > now_ms():
            at = f"comes out at {iso(self.round_ms)}: try again then"
            raise StudyError(f"round {self.round} of the beacon {at}")
        url = f"{relay}/{_CHAIN}/public/{self.round}"
        way_out = f"try again later, or look it up at {url} and give it with --signature"
        try:
            with urllib.request.urlopen(url, timeout=20) as answer:
                found: Any = json.loads(answer.read(4096))
            return str(found["signature"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            if isinstance(error, urllib.error.HTTPError):
                error.close()
            why = error.reason if isinstance(error, urllib.error.URLError) else error
            what = f"round {self.round} of the beacon cannot be fetched"
            raise StudyError(f"{what} ({why}): {way_out}") from error


QUICKNET = Beacon(
    "83cf0f2896adee7eb8b5f01fcad3912212c437e0073e911fb90022d3e760183c8c4b450b6a0a6c3ac6a5776a2d106451"
    "0d1fec758c921cc22b0e17e63aaf4bcb5ed66304de9cf809bd274ca73bab4af5a6e9c76a4bc09e76eae8991ef5ece45a",
    genesis_s=1_692_803_367,
    period_s=3,
    round=1,
)
