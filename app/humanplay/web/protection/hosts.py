"""The names of the server, and from which address and how a request came.

A page of somebody else's whose name is made to lead here (DNS rebinding) must find nobody.
Starlette's TrustedHostMiddleware compares names alone: it has no rule for IP literals, reads
`[::1]:8000` as the host `[`, and does not look at X-Forwarded-Host.
"""

from __future__ import annotations

import re
import socket
from collections.abc import Sequence
from functools import lru_cache
from ipaddress import IPv6Address, IPv6Network, ip_address
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.types import Scope
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

_HOST = re.compile(r"(?P<name>\[[0-9a-f:.]+\]|[^:\[\]/?#@\s]+)(:\d{1,5})?")
_FORWARDED = frozenset(
    f"x-forwarded-{part}".encode() for part in ("for", "host", "port", "prefix", "proto")
)

MOST_HOSTS = 10
"""Hosts that a request may name: one for each proxy on its way."""

IPV6_PREFIX = 64
"""Bits of an IPv6 address that say whose it is: a home may change among the 2**64 behind them."""

UNKNOWN = "unknown"
"""The address where none is known: over a Unix socket, or when a named proxy sends something else."""


def own_names(public_url: str | None = None, listening: str = "") -> frozenset[str]:
    """The names that the server answers for, in lower case.

    They are those of loopback, of this machine, of `public_url` and of `listening`.
    """
    machine = socket.gethostname().lower()
    short = machine.partition(".")[0]
    public = "" if public_url is None else name_of(urlsplit(public_url).netloc)
    names = {"localhost", machine, short, f"{short}.local", listening.lower(), public or ""}
    return frozenset(names - {""})


def name_of(host: str) -> str | None:
    """The name in a Host header, in lower case, without its port.

    None when malformed.
    """
    match = _HOST.fullmatch(host.strip().lower())
    return None if match is None else match["name"].strip("[]").removesuffix(".")


def is_literal(name: str) -> bool:
    """Whether a name is an IP address: no name server can make one lead elsewhere."""
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


@lru_cache(maxsize=1000)
def is_loopback(name: str) -> bool:
    """Whether a name leads to the browser's own machine, by any name server."""
    is_named = name == "localhost" or name.endswith(".localhost")
    return is_named or (is_literal(name) and ip_address(name).is_loopback)


def hosts_of(scope: Scope) -> list[str]:
    """What Host and X-Forwarded-Host name, at most one more than MOST_HOSTS."""
    values = [value for name, value in scope["headers"] if name in (b"host", b"x-forwarded-host")]
    named = b",".join(values).decode("latin-1").split(",", MOST_HOSTS)
    return [host.strip() for host in named if host.strip()]


def serves(names: frozenset[str] | None, host: str) -> bool:
    """Whether a server answers for a Host header.

    Args:
        names: The server's; None: every name that is well-formed.
    """
    name = name_of(host)
    if name is None or names is None:
        return name is not None
    return name in names or name.endswith(".localhost") or is_literal(name)


class Proxies:
    """The named proxies, whose X-Forwarded headers count.

    Everybody else's are dropped.

    Args:
        named: Their addresses and networks, as text.
        public_url: Says scheme and path prefix of what is asked for under its host, where no proxy
            does.
    """

    def __init__(self, named: Sequence[str], public_url: str | None = None) -> None:
        self._named = ProxyHeadersMiddleware(None, list(named)).trusted_hosts  # type: ignore[arg-type]
        self._public = urlsplit(public_url or "")

    def scope_of(self, scope: Scope) -> Scope:
        """A scope as the browser asked: its address, its scheme and its host.

        The address is the last one in X-Forwarded-For that is no named proxy's. X-Forwarded-Host
        becomes the Host, and X-Forwarded-Prefix alone remains for handlers to read.
        """
        headers = [header for header in scope["headers"] if header[0] not in _FORWARDED]
        peer, asked = scope.get("client"), {**scope, "headers": headers}
        if peer is not None and peer[0] in self._named:
            forwarded = Headers(scope=scope)
            if (scheme := forwarded.get("x-forwarded-proto")) in ("http", "https", "ws", "wss"):
                asked["scheme"] = _scheme_for(scope, scheme in ("https", "wss"))
            addresses = ", ".join(forwarded.getlist("x-forwarded-for"))
            if (came := self._named.get_trusted_client_address(addresses))[0]:
                asked["client"] = came
            if host := forwarded.get("x-forwarded-host", "").partition(",")[0].strip():
                headers[:] = [header for header in headers if header[0] != b"host"]
                headers.append((b"host", host.encode("latin-1")))
            if "x-forwarded-prefix" in forwarded:
                headers.append(
                    (b"x-forwarded-prefix", forwarded["x-forwarded-prefix"].encode("latin-1"))
                )
        return self._as_public(asked)

    def _as_public(self, scope: Scope) -> Scope:
        """A scope with the public address's scheme and prefix, if that is asked."""
        headers = Headers(scope=scope)
        public = self._public
        if public.netloc and headers.get("host", "").lower() in (public.netloc, public.hostname):
            if public.scheme == "https":
                scope["scheme"] = _scheme_for(scope, secure=True)
            if public.path and "x-forwarded-prefix" not in headers:
                scope["headers"].append((b"x-forwarded-prefix", public.path.encode()))
        return scope


def _scheme_for(scope: Scope, secure: bool) -> str:
    return ("ws" if scope["type"] == "websocket" else "http") + "s" * secure


def client_address(connection: HTTPConnection) -> str:
    """Whose connection this is, for limits: the one thing no stranger chooses freely.

    It is an IPv4 address, the /64 network of an IPv6 one, or UNKNOWN; behind a named proxy (`serve
    --trusted-proxy`) that which the proxy reports.
    """
    return network_of(connection.client.host if connection.client else "")


def network_of(host: str) -> str:
    """Whose address this is.

    It is an IPv4 address, the /64 network of an IPv6 one, or UNKNOWN.
    """
    try:
        address = ip_address(host.partition("%")[0])
    except ValueError:
        return UNKNOWN
    if isinstance(address, IPv6Address):
        if address.ipv4_mapped is not None:
            return str(address.ipv4_mapped)
        if not address.is_loopback:
            return str(IPv6Network((address, IPV6_PREFIX), strict=False))
    return str(address)


def is_secure(connection: HTTPConnection) -> bool:
    """Whether the browser speaks TLS, with us or with a named proxy before us."""
    return connection.scope["scheme"] in ("https", "wss")
