"""Headers that every answer has.

They keep a browser to our own files, and what is private out of every cache. What a handler has set
stays.
"""

from __future__ import annotations

from starlette.requests import HTTPConnection

from humanplay.web.protection.hosts import is_loopback, is_secure, name_of

NO_CACHE = {"Cache-Control": "no-cache"}
"""Of pages and files that are the same for everybody: a browser may keep them, and asks each time
whether they still stand."""

SHARED = {"Cross-Origin-Resource-Policy": "cross-origin"}
"""Of pictures that pages of other sites may show."""

HSTS_S = 365 * 24 * 3600
"""Seconds for which a browser that has come by TLS comes by nothing else."""


def page_policy(framed: str = "'self'") -> str:
    """The Content-Security-Policy of a page.

    Args:
        framed: Which pages may show it in a frame.
    """
    return (
        "default-src 'self'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
        f"connect-src 'self'; frame-src 'self'; frame-ancestors {framed}; base-uri 'none'; form-action 'self'; "
        "object-src 'none'"
    )


def viewer_policy(script_hashes: tuple[str, ...], framed: str = "'self'") -> str:
    """The Content-Security-Policy of viser's page.

    Its scripts of its own are known by their hashes ("sha256-..."). They unpack and start the rest
    ('strict-dynamic'), which compiles WebAssembly and, for decoders of its own, strings.
    """
    hashes = " ".join(f"'{script_hash}'" for script_hash in script_hashes)
    return (
        f"default-src 'none'; script-src {hashes} 'strict-dynamic' 'wasm-unsafe-eval' 'unsafe-eval'; "
        "worker-src blob: data:; style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; "
        f"connect-src 'self' blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors {framed}"
    )


USES = ("camera", "microphone", "geolocation", "payment", "usb", "midi", "display-capture")
"""What no page of ours asks a browser for."""
HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": page_policy(),
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": ", ".join(f"{use}=()" for use in USES),
    "referrer-policy": "same-origin",
    "x-content-type-options": "nosniff",
}
"""Of every answer that says nothing else: above all, nothing is stored unless a handler knows that
it is the same for all."""

BY_TLS = {"strict-transport-security": f"max-age={HSTS_S}"}
ISOLATED = {"cross-origin-opener-policy": "same-origin"}


def headers_of(connection: HTTPConnection) -> dict[str, str]:
    """The headers of an answer to a connection.

    The site that `app.state.framed_by` names may frame it. Cross-Origin-Opener-Policy goes where
    browsers heed it: by TLS and on loopback. Elsewhere they complain in their console.
    """
    by_tls = is_secure(connection)
    near = by_tls or is_loopback(name_of(connection.headers.get("host", "")) or "")
    headers = {**HEADERS, **(BY_TLS if by_tls else {}), **(ISOLATED if near else {})}
    return {**headers, "content-security-policy": page_policy(framing_sites(connection))}


def framing_sites(connection: HTTPConnection) -> str:
    """Which sites' pages may show ours in a frame.

    It is written as a Content-Security-Policy says it.
    """
    site: str | None = connection.app.state.framed_by
    return f"'self' {site}" if site else "'self'"
