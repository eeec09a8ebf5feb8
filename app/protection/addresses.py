"""The address that a connection came from: the only thing that a stranger cannot choose freely."""

from __future__ import annotations

from ipaddress import IPv6Address, IPv6Network, ip_address

from starlette.requests import HTTPConnection

IPV6_PREFIX = 64
"""Bits of an IPv6 address that say whose it is: each home has the 2**64 addresses behind them, and may change among them."""

UNKNOWN = "unknown"
"""The address where none is known: over a Unix socket, or when a named proxy sends something else."""


def client_address(connection: HTTPConnection) -> str:
    """Return whose connection this is, for limits and counts: an IPv4 address, the /64 network of an IPv6 one, or UNKNOWN.

    Behind a named proxy (`serve --trusted-proxy`) it is the address that the proxy reports; nobody else's report counts.
    """
    return network_of(connection.client.host if connection.client else "")


def network_of(host: str) -> str:
    """Return whose address this is: an IPv4 address, the /64 network of an IPv6 one, or UNKNOWN."""
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
    """Return whether the browser speaks TLS, with us or with a named proxy before us."""
    return connection.scope["scheme"] in ("https", "wss")
