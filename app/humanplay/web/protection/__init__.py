"""What stands before every request.

That is hosts, proxies, origins and cookies, and how much one may ask. `Gate` looks at each request
and at the handshake of each socket once; `LimitedClients` counts.
"""

from humanplay.web.protection.gate import Gate, RefusedRequestError, has_own_origin
from humanplay.web.protection.headers import (
    NO_CACHE,
    SHARED,
    framing_sites,
    page_policy,
    viewer_policy,
)
from humanplay.web.protection.hosts import Proxies, client_address, is_secure, own_names
from humanplay.web.protection.limits import OWNERS, BudgetedCharges, LimitedClients, Protection

__all__ = [
    "NO_CACHE",
    "OWNERS",
    "SHARED",
    "BudgetedCharges",
    "Gate",
    "LimitedClients",
    "Protection",
    "Proxies",
    "RefusedRequestError",
    "client_address",
    "framing_sites",
    "has_own_origin",
    "is_secure",
    "own_names",
    "page_policy",
    "viewer_policy",
]  # fmt: skip
