"""What stands before every request: which hosts are served, whose forwarded headers count, and which pages may change anything.

The middleware of this package leaves its judgement in the connection; handlers ask `client_address`, `has_own_origin` and
`is_secure`, and read no Origin or forwarded header themselves.
"""

from app.protection.addresses import client_address, is_secure
from app.protection.headers import NO_CACHE, SHARED, SecurityHeaders, page_policy, viewer_policy
from app.protection.hosts import AllowedHosts, own_names
from app.protection.origins import OwnPages, has_own_origin
from app.protection.proxies import ForwardedHeaders

__all__ = [
    "NO_CACHE",
    "SHARED",
    "AllowedHosts",
    "ForwardedHeaders",
    "OwnPages",
    "SecurityHeaders",
    "client_address",
    "has_own_origin",
    "is_secure",
    "own_names",
    "page_policy",
    "viewer_policy",
]
