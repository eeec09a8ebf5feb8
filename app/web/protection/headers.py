"""Headers that every answer has: they keep a browser to our own files, and what is private out of every cache.

The library `secure` writes the values; what a handler has set stays.
"""

from __future__ import annotations

from secure import (
    CacheControl,
    ContentSecurityPolicy,
    CrossOriginOpenerPolicy,
    CrossOriginResourcePolicy,
    PermissionsPolicy,
    ReferrerPolicy,
    Secure,
    StrictTransportSecurity,
    XContentTypeOptions,
)
from starlette.requests import HTTPConnection

from app.web.protection.hosts import is_loopback, is_secure, name_of

NO_CACHE = {"Cache-Control": "no-cache"}
"""Of pages and files that are the same for everybody: a browser may keep them, and asks each time whether they still stand."""

SHARED = {"Cross-Origin-Resource-Policy": "cross-origin"}
"""Of pictures that pages of other sites may show."""

HSTS_S = 365 * 24 * 3600
"""Seconds for which a browser that has come by TLS comes by nothing else."""


def page_policy(framed: str = "'self'") -> str:
    """Return the Content-Security-Policy of a page; `framed` says which pages may show it in a frame."""
    policy = (
        ContentSecurityPolicy()
        .default_src("'self'")
        .script_src("'self'")
        .style_src("'self'", "'unsafe-inline'")
    )
    policy = (
        policy.img_src("'self'", "data:", "blob:")
        .connect_src("'self'")
        .frame_src("'self'")
        .frame_ancestors(framed)
    )
    return policy.base_uri("'none'").form_action("'self'").object_src("'none'").header_value


def viewer_policy(script_hashes: tuple[str, ...]) -> str:
    """Return the Content-Security-Policy of viser's page, whose scripts of its own are known by their hashes ("sha256-...").

    They unpack and start the rest ('strict-dynamic'), which compiles WebAssembly and, for decoders of its own, strings.
    """
    hashes = (f"'{each}'" for each in script_hashes)
    policy = ContentSecurityPolicy().default_src("'none'")
    policy = policy.script_src(*hashes, "'strict-dynamic'", "'wasm-unsafe-eval'", "'unsafe-eval'")
    policy = (
        policy.worker_src("blob:", "data:")
        .style_src("'unsafe-inline'")
        .img_src("'self'", "data:", "blob:")
        .font_src("data:")
    )
    policy = policy.connect_src("'self'", "blob:", "data:").base_uri("'none'").form_action("'none'")
    return policy.frame_ancestors("'self'").header_value


def _lower(secure: Secure) -> dict[str, str]:
    return {name.lower(): value for name, value in secure.headers.items()}


HEADERS = _lower(
    Secure(
        csp=ContentSecurityPolicy().value(page_policy()),
        xcto=XContentTypeOptions().nosniff(),
        referrer=ReferrerPolicy().same_origin(),
        corp=CrossOriginResourcePolicy().same_origin(),
        permissions=PermissionsPolicy()
        .camera()
        .microphone()
        .geolocation()
        .payment()
        .usb()
        .midi()
        .display_capture(),
        cache=CacheControl().no_store(),
    )
)
"""Of every answer that says nothing else: above all, nothing is stored unless a handler knows that it is the same for all."""

BY_TLS = _lower(Secure(hsts=StrictTransportSecurity().max_age(HSTS_S)))
ISOLATED = _lower(Secure(coop=CrossOriginOpenerPolicy().same_origin()))


def headers_of(connection: HTTPConnection) -> dict[str, str]:
    """Return the headers of an answer to a connection.

    Cross-Origin-Opener-Policy goes where browsers heed it: by TLS and on loopback. Elsewhere they complain in their console.
    """
    by_tls = is_secure(connection)
    near = by_tls or is_loopback(name_of(connection.headers.get("host", "")) or "")
    return {**HEADERS, **(BY_TLS if by_tls else {}), **(ISOLATED if near else {})}
