"""Which hosts the server answers for, so that no name of somebody else's can be made to lead a browser here (DNS rebinding).

Starlette's TrustedHostMiddleware compares names alone: it has no rule for IP literals, reads `[::1]:8000` as the host `[`,
and does not look at X-Forwarded-Host.
"""

from __future__ import annotations

import re
import socket
from collections.abc import Iterable
from functools import lru_cache
from ipaddress import ip_address

from starlette.types import ASGIApp, Receive, Scope, Send

from app.protection.refusals import Answer, refuse

_HOST = re.compile(r"(?P<name>\[[0-9a-f:.]+\]|[^:\[\]/?#@\s]+)(:\d{1,5})?")
MOST_HOSTS = 10
"""Hosts that a request may name: one for each proxy on its way."""

SHOWN = 60
"""Characters of a stranger's input that a refusal repeats, at most."""


def own_names(public_url: str | None = None, listening: str = "") -> frozenset[str]:
    """Return the names that the server answers for: of loopback, of this machine, of `public_url` and of `listening`."""
    machine = socket.gethostname().lower()
    short = machine.partition(".")[0]
    names = {"localhost", machine, short, f"{short}.local", listening.lower()}
    if public_url is not None and (
        public := name_of(public_url.partition("://")[2].partition("/")[0])
    ):
        names.add(public)
    return frozenset(names - {""})


def name_of(host: str) -> str | None:
    """Return the name in a Host header, in lower case, without its port and a final dot; None when it is malformed."""
    found = _HOST.fullmatch(host.strip().lower())
    return None if found is None else found["name"].strip("[]").removesuffix(".")


def is_literal(name: str) -> bool:
    """Return whether a name is an IP address: no name server can make one lead elsewhere."""
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


@lru_cache(maxsize=1000)
def is_loopback(name: str) -> bool:
    """Return whether a name leads to the browser's own machine, whatever a name server says."""
    return (
        name == "localhost"
        or name.endswith(".localhost")
        or (is_literal(name) and ip_address(name).is_loopback)
    )


class AllowedHosts:
    """Refuses with 400 what asks for a host that is not the server's: in Host, or in X-Forwarded-Host, whoever sent it.

    names   what the server answers for, in lower case; IP literals and names under `localhost` pass as well
    """

    def __init__(self, app: ASGIApp, names: Iterable[str], answer: Answer) -> None:
        self._app, self._names, self._answer = app, frozenset(names), answer

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] in ("http", "websocket"):
            given = [
                value for name, value in scope["headers"] if name in (b"host", b"x-forwarded-host")
            ]
            hosts = b",".join(given).decode("latin-1").split(",", MOST_HOSTS)
            if len(hosts) > MOST_HOSTS:
                await refuse(
                    scope,
                    receive,
                    send,
                    400,
                    f"a request must name {MOST_HOSTS} hosts at most",
                    self._answer,
                )
                return
            for host in hosts:
                if host.strip() and not self.serves(host):
                    await refuse(
                        scope, receive, send, 400, self._sentence(host.strip()), self._answer
                    )
                    return
        await self._app(scope, receive, send)

    def serves(self, host: str) -> bool:
        """Return whether the server answers for a Host header."""
        name = name_of(host)
        return name is not None and (
            name in self._names or name.endswith(".localhost") or is_literal(name)
        )

    def _sentence(self, host: str) -> str:
        return (
            f"this server does not answer for the host {host[:SHOWN]!r}: open it by its IP address or as localhost; "
            "its operator makes a public address known with serve --public-url URL"
        )
