"""Token buckets: how many of a kind may come at once, and how many a second after that."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

from app.settings import read_bucket

MAX_BUCKETS = 10_000
"""Addresses whose rates are remembered; beyond it, those that would be as new are forgotten."""


class BucketSize(NamedTuple):
    """What a bucket holds: `burst` tokens at once, and `rate` new ones a second."""

    burst: int
    rate: float

    @classmethod
    def parse(cls, text: str) -> BucketSize:
        """Return the size that is written as BURST+RATE/s, like `20+2/s`; ValueError for anything else."""
        return cls(*read_bucket(text))

    def times(self, count: int) -> BucketSize:
        """Return the size of as many such buckets together."""
        return BucketSize(self.burst * count, self.rate * count)


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
        self._tokens = (
            min(float(self._size.burst), self._tokens + (now_s - self._at_s) * self._size.rate)
            - 1.0
        )
        self._at_s = now_s
        return max(0.0, -self._tokens / self._size.rate)

    def take_within(self, patience_s: float) -> float | None:
        """Take a token and return for how many seconds it is missing, or take none and return None where that is too long.

        Whoever is refused owes nothing.
        """
        missing_s = self.take()
        if missing_s <= patience_s:
            return missing_s
        self._tokens += 1.0
        return None

    def take_if_there(self) -> bool:
        """Take a token and return True, or return False and take none."""
        return self.take_within(0.0) is not None

    def take_away(self, count: float, debt: float) -> None:
        """Take some tokens, down to a debt of some at most."""
        self.take()
        left = self._tokens + 1.0
        self._tokens = max(left - count, min(left, -debt))

    @property
    def is_full(self) -> bool:
        """Return whether nothing was taken for so long that a new bucket would be the same."""
        return self._tokens + (self._clock_s() - self._at_s) * self._size.rate >= self._size.burst


class AddressBuckets:
    """A bucket for each address; beyond MAX_BUCKETS, those that would be as new are forgotten."""

    def __init__(self, size: BucketSize) -> None:
        self._size = size
        self._buckets: dict[str, TokenBucket] = {}

    def of(self, address: str) -> TokenBucket:
        """Return the bucket of an address."""
        bucket = self._buckets.get(address)
        if bucket is None:
            if len(self._buckets) >= MAX_BUCKETS:
                self._buckets = {
                    each: kept for each, kept in self._buckets.items() if not kept.is_full
                }
            bucket = self._buckets[address] = TokenBucket(self._size)
        return bucket
