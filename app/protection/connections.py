"""How many connections and sockets there are, from each address and in all; beyond the caps new ones are refused."""

from __future__ import annotations

import resource
from collections import Counter
from collections.abc import Callable

from app.protection.addresses import network_of
from app.protection.buckets import AddressBuckets, BucketSize

PENALTY, PENALTY_DEBT = 100, 5
"""Connections that an address may open less at once for each of its sockets that was closed for too much, and how many of them
it may come to owe: whoever floods over one socket after the other soon opens one for six tokens of the bare rate."""

MOST_WAITING, MOST_REFUSED = 100, 200
"""Refused connections that may be open for a further one to wait until it is told so, and for one to be told at all. Each is an
open file, and so are those of three turns of the event loop, some 150, that are being closed: OTHER_FILES leaves room."""

OTHER_FILES = 512
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
    return (
        connections
        if soft == resource.RLIM_INFINITY
        else max(1, min(connections, soft - OTHER_FILES))
    )


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
        if self.open >= self._most or (
            address is not None and self._by_address[address] >= self._most_per_address
        ):
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

    opened       how many one address may open
    served       how many of these are served at once; the others wait for their turn
    refused      how many refused ones are still open
    named_proxy  says whether a peer's address is that of a named proxy: it speaks for many, so only the total counts there
    """

    def __init__(
        self,
        slots: Slots,
        opened: BucketSize,
        served: BucketSize,
        named_proxy: Callable[[str], bool],
    ) -> None:
        self.slots, self._named_proxy = slots, named_proxy
        self.refused = 0
        self._opened, self._served = AddressBuckets(opened), AddressBuckets(served)

    def key_of(self, peer: str) -> str | None:
        """Return what a peer is counted under; None for a named proxy."""
        return None if self._named_proxy(peer) else network_of(peer)

    def take(self, key: str | None) -> bool:
        """Count a new connection and return True, or return False where it is one too many or came too soon."""
        if key is not None and not self._opened.of(key).take_if_there():
            return False
        return self.slots.take(key)

    def turn_s(self, key: str | None) -> float:
        """Return for how many seconds a connection that was taken waits until it is served."""
        return 0.0 if key is None else self._served.of(key).take()

    def punish(self, key: str | None) -> None:
        """Let an address open fewer connections at once, since one of its sockets was closed for too much."""
        if key is not None:
            self._opened.of(key).take_away(PENALTY, PENALTY_DEBT)
