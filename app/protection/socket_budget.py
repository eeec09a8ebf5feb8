"""What one socket may ask of the server: a bucket for each kind of message."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Literal

from app.protection.buckets import BucketSize, TokenBucket

Kind = Literal["act", "events", "history", "expected", "bad", "refused"]
"""Kinds of messages: those a page sends, those that are none of ours, and acts that do not answer the current frame."""

POLICY_VIOLATION = 1008
"""The close code (RFC 6455, section 7.4.1) of a socket that was sent too much."""

PATIENCE = 100
"""Slowed messages of one kind in a row after which the socket is closed."""

OWN_PATIENCE: dict[Kind, float] = {"bad": 0, "refused": 15, "act": inf}
"""The same of kinds that have their own. Nobody needs a message that is none of ours. An act that is refused costs as much as
one that is made, and a page that has lost touch sends few. A script that waits for each frame before it moves is slowed down
for ever and closed never."""


class TooManyMessagesError(Exception):
    """A socket was sent more than it may be; the text says what and how many, for its close frame (at most 123 bytes)."""


class SocketBudget:
    """The buckets of one socket.

    together  the buckets of all sockets of its address
    delay_s   how long to wait before the next message is read
    """

    def __init__(
        self,
        sizes: dict[Kind, BucketSize],
        together: dict[Kind, TokenBucket],
        count_refusal: Callable[[str], None],
    ) -> None:
        self._sizes, self._together, self._count_refusal = sizes, together, count_refusal
        self._buckets: dict[Kind, TokenBucket] = {}
        self._slowed: dict[Kind, int] = {}
        self.delay_s = 0.0

    def spend(self, kind: Kind) -> None:
        """Take a token for a message that came; TooManyMessagesError when the socket is to be closed."""
        bucket = self._buckets.get(kind)
        if bucket is None:
            bucket = self._buckets[kind] = TokenBucket(self._sizes[kind])
        missing_s = bucket.take()
        if kind in self._together:
            missing_s = max(missing_s, self._together[kind].take())
        if not missing_s:
            self._slowed[kind] = 0
            return
        self._slowed[kind] = slowed = self._slowed.get(kind, 0) + 1
        if slowed > OWN_PATIENCE.get(kind, PATIENCE):
            self._count_refusal(f"messages_{kind}")
            size = self._sizes[kind]
            raise TooManyMessagesError(
                f"too many messages ({kind}): {size.burst} at once and {size.rate:g} a second are answered"
            )
        self.delay_s = max(self.delay_s, missing_s)

    def take_delay_s(self) -> float:
        """Return how long to wait before the next message is read, and forget it."""
        delay_s, self.delay_s = self.delay_s, 0.0
        return delay_s
