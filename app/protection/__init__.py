"""What stands before every request: hosts, proxies, origins and cookies, and how much one may ask.

`Gate` looks at each request and at the handshake of each socket once; `LimitedClients` counts.
"""

from app.protection.gate import Gate
from app.protection.headers import NO_CACHE, SHARED, page_policy, viewer_policy
from app.protection.hosts import Proxies, client_address, is_secure, own_names
from app.protection.limits import LimitedClients, Protection
from app.protection.origins import has_own_origin

__all__ = [
    "NO_CACHE",
    "SHARED",
    "Gate",
    "LimitedClients",
    "Protection",
    "Proxies",
    "client_address",
    "has_own_origin",
    "is_secure",
    "own_names",
    "page_policy",
    "viewer_policy",
]
