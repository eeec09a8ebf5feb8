"""What stands before every request: which hosts are served, whose forwarded headers count, which pages may change anything, and
how much one client may ask.

The middleware of this package leaves its judgement in the connection; handlers ask `client_address`, `has_own_origin` and
`is_secure`, and read no Origin or forwarded header themselves.
"""

from app.protection.addresses import client_address, is_secure
from app.protection.admission import Admission, limited_as
from app.protection.cookies import OwnCookies
from app.protection.headers import NO_CACHE, SHARED, SecurityHeaders, page_policy, viewer_policy
from app.protection.hosts import AllowedHosts, own_names
from app.protection.origins import OwnPages, has_own_origin
from app.protection.protocols import limited_protocols
from app.protection.proxies import ForwardedHeaders
from app.protection.service import Protection
from app.protection.socket_budget import POLICY_VIOLATION, SocketBudget, TooManyMessagesError

__all__ = [
    "NO_CACHE",
    "POLICY_VIOLATION",
    "SHARED",
    "Admission",
    "AllowedHosts",
    "ForwardedHeaders",
    "OwnCookies",
    "OwnPages",
    "Protection",
    "SecurityHeaders",
    "SocketBudget",
    "TooManyMessagesError",
    "client_address",
    "has_own_origin",
    "is_secure",
    "limited_as",
    "limited_protocols",
    "own_names",
    "page_policy",
    "viewer_policy",
]
