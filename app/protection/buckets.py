"""Token buckets: how many of a kind may come at once, and how many a second after that."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

from app.settings import read_bucket


class BucketSize(NamedTuple):
    """What a bucket holds: `burst` tokens at once, and `rate` new ones a second."""

    burst: int
    rate: float

    @classmethod
    def parse(cls, text: str) -> BucketSize:
        """Return the size that is written as BURST+RATE/s, like `20+2/s`; ValueError for anything else."""
        return cls(*read_bucket(text))


class TokenBucket:
    """One bucket, full at first."""

    __slots__ = ("_at_s", "_clock_s", "_size", "_tokens")

    def __init__(self, size: BucketSize, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._size, self._clock_s = size, clock_s
        self._tokens, self._at_s = float(size.burst), clock_s()

    def take(self) -> float:
        """Take a token and return for how many seconds it is missing: 0 when it was there.

        Whoever waits that long keeps to the rate.
        """
        now_s = self._clock_s()
        self._tokens = min(float(self._size.burst), self._tokens + (now_s - self._at_s) * self._size.rate) - 1.0
        self._at_s = now_s
        return max(0.0, -self._tokens / self._size.rate)

    @property
    def is_full(self) -> bool:
        """Return whether nothing was taken for so long that a new bucket would be the same."""
        return self._tokens + (self._clock_s() - self._at_s) * self._size.rate >= self._size.burst
