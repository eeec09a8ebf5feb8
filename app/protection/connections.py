"""How many connections and sockets there are, from each address and in all; beyond the caps new ones are refused."""

from __future__ import annotations

import resource
from collections import Counter
from collections.abc import Callable

from app.protection.buckets import BucketSize, TokenBucket

MAX_BUCKETS = 10_000
"""Addresses whose rates are remembered; beyond it, those that would be as new are forgotten."""

OTHER_FILES = 256
"""File descriptors that a server needs besides its connections, at most."""


def make_room(connections: int) -> int:
    """Let this process open as many files as it takes, where the system allows it; return how many connections fit.

    Beyond its limit of open files a server could accept nobody, nor tell anybody that it is full.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = connections + OTHER_FILES
    if soft != resource.RLIM_INFINITY and soft < wanted:
        soft = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    return connections if soft == resource.RLIM_INFINITY else max(1, min(connections, soft - OTHER_FILES))


class Slots:
    """Counts what is open, with a cap for each address and one in total.

    open  how many there are now
    """

    def __init__(self, most: int, most_per_address: int) -> None:
        self._most, self._most_per_address = most, most_per_address
        self._by_address: Counter[str] = Counter()
        self.open = 0

    def take(self, address: str | None) -> bool:
        """Count one more from an address (None: counted in total alone) and return True, or return False at a cap."""
        if self.open >= self._most or (address is not None and self._by_address[address] >= self._most_per_address):
            return False
        self.open += 1
        if address is not None:
            self._by_address[address] += 1
        return True

    def give_back(self, address: str | None) -> None:
        """Count one less."""
        self.open -= 1
        if address is not None:
            self._by_address[address] -= 1
            if not self._by_address[address]:
                del self._by_address[address]


class Connections:
    """The TCP connections of a server.

    named_proxy  says whether a peer's address is that of a named proxy: it speaks for many, so only the total counts there
    """

    def __init__(self, slots: Slots, opening: BucketSize, named_proxy: Callable[[str], bool]) -> None:
        self.slots, self._opening, self._named_proxy = slots, opening, named_proxy
        self._buckets: dict[str, TokenBucket] = {}

    def key_of(self, peer: str) -> str | None:
        """Return what a peer is counted under; None for a named proxy."""
        return None if self._named_proxy(peer) else peer

    def take(self, key: str | None) -> bool:
        """Count a new connection and return True, or return False where it is one too many or came too soon."""
        if key is not None and self._bucket(key).take():
            return False
        return self.slots.take(key)

    def _bucket(self, key: str) -> TokenBucket:
        bucket = self._buckets.get(key)
        if bucket is None:
            if len(self._buckets) >= MAX_BUCKETS:
                self._buckets = {each: kept for each, kept in self._buckets.items() if not kept.is_full}
            bucket = self._buckets[key] = TokenBucket(self._opening)
        return bucket
