"""The limits of one server and what they have refused: one object that the protocols, the middleware and the sockets share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

from app.protection.buckets import AddressBuckets, BucketSize
from app.protection.connections import Connections, Slots, make_room
from app.protection.slow_readers import SlowReaders
from app.protection.socket_budget import Kind, SocketBudget
from app.protection.turns import Turns
from app.settings import Limits


class Protection:
    """What one server counts and limits; it lives as long as its app.

    refusals     how often something was refused, by reason; `count` is called with each reason as well
    connections  the TCP connections
    sockets      the websockets among them, by the address that a named proxy reports
    messages     those of all sockets of an address, of any kind
    requests     the HTTP requests of an address
    files        those for the files of the pages
    slow_readers  closes connections whose client does not take what is sent to it
    turns        in which requests, sockets and messages of an address begin
    """

    def __init__(
        self,
        limits: Limits,
        trusted_proxies: Sequence[str] = (),
        count: Callable[[str], None] = lambda reason: None,
    ) -> None:
        self.limits, self._count = limits, count
        self.refusals: Counter[str] = Counter()
        self.bucket_sizes = {name: BucketSize.parse(getattr(limits, name)) for name in BUCKETS}
        named = ProxyHeadersMiddleware(None, list(trusted_proxies)).trusted_hosts  # type: ignore[arg-type]
        room = make_room(limits.connections)
        slots = Slots(room, limits.connections_per_address)
        self.connections = Connections(
            slots, self.bucket_sizes["opened"], self.bucket_sizes["served"], named.__contains__
        )
        self.messages = AddressBuckets(self.bucket_sizes["messages_per_address"])
        self.requests = AddressBuckets(self.bucket_sizes["requests"])
        self.files = AddressBuckets(self.bucket_sizes["files"])
        self.turns = Turns()
        self.slow_readers = SlowReaders(limits.answer_s, self.count_refusal)
        self._together = {
            kind: AddressBuckets(self.bucket_sizes[name].times(limits.busy_sockets))
            for kind, name in KINDS.items()
        }
        sockets = max(1, limits.sockets * room // limits.connections)  # the others load pages
        self.sockets = Slots(sockets, limits.sockets_per_address)

    def count_refusal(self, reason: str) -> None:
        """Count a refusal; reasons are few words of the code, never a stranger's."""
        self.refusals[reason] += 1
        self._count(reason)

    def socket_budget(self, address: str | None) -> SocketBudget:
        """Return full buckets for the messages of one play socket, beside those of all sockets of its address (None: alone)."""
        sizes = {kind: self.bucket_sizes[name] for kind, name in KINDS.items()}
        together = (
            {}
            if address is None
            else {kind: buckets.of(address) for kind, buckets in self._together.items()}
        )
        return SocketBudget(sizes, together, self.count_refusal)


KINDS: dict[Kind, str] = {
    "act": "acts",
    "events": "events",
    "history": "histories",
    "expected": "expectations",
    "bad": "bad_messages",
    "refused": "refused_acts",
}
"""The setting of each kind of message."""

BUCKETS = (
    "opened",
    "served",
    "requests",
    "files",
    "pings",
    "messages",
    "messages_per_address",
    *KINDS.values(),
)
"""The settings that are sizes of token buckets."""
