"""Rates of requests, and of what costs the most: joining studies, beginning boards and episodes; sockets have caps.

Requests of an address take turns at their rate (behind a named proxy the address is the one that it reports). The rates of what
costs the most are counted by the library `limits`, for each address and for each player's cookie. Whoever sends the operator's
token is not limited: that is how `marsexplorer simulate` plays a whole study.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import math
import re
import time
from http.cookies import CookieError, SimpleCookie
from typing import Literal, get_args

from limits import parse_many
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.protection.addresses import client_address
from app.protection.protocols import RETRY_AFTER_S
from app.protection.refusals import Answer, refuse
from app.protection.service import Protection
from app.settings import Limits

Action = Literal["join", "session", "episode"]
By = Literal["address", "player"]

TOKEN_HEADER = "x-mars-token"
"""The header that holds the operator's token, `limits.token`."""

PROBES = frozenset({"/healthz", "/readyz"})
"""What watches over the server: however many pages an address asks for, these requests have a rate of their own."""

FILES = "/static/"
"""Where the files of the pages are: they have a rate of their own, since each costs little and a page asks for sixty."""

PATIENCE_S = 4.0
"""Seconds that a request may wait for its turn; one that would wait longer is refused. A thousand requests at the default rate
take as long, which is as many as the connections of one address can ask for at once."""

COOKIE = "mars_player"
_PATHS: dict[Action, re.Pattern[str]] = {
    "join": re.compile(r"/api/studies/[^/]+/join"),
    "session": re.compile(r"/api/(sessions|daily)"),
    "episode": re.compile(r"/api/(sessions|studies)/[^/]+/(episodes|next)"),
}
"""The POST requests of each action, by the end of their path."""

WHAT: dict[Action, str] = {
    "join": "joins of a study",
    "session": "new boards",
    "episode": "new episodes",
}
WHERE: dict[By, str] = {"address": "this network", "player": "this browser"}


def limited_as(connection: HTTPConnection) -> str | None:
    """Return the address that a websocket's messages are counted for; None for whoever has the operator's token."""
    key: str | None = connection.scope["limited_as"]
    return key


MAX_IDLE = 1_000
"""Rates of addresses and players who have done nothing of late that are kept all the same, unless as many have."""


class Rates:
    """How often each action was done of late, by address and by player.

    The storage of `limits` forgets what was done, but not who had done it: each hit would leave a name behind for ever, and
    walk over all of them. Here the names go as well, now and then, so that this costs little.
    """

    def __init__(self, limits: Limits) -> None:
        self._storage = MemoryStorage()
        self._limiter = MovingWindowRateLimiter(self._storage)
        self._most_names = MAX_IDLE
        self._rates = {
            (action, by): parse_many(getattr(limits, f"{action}s_per_{by}"))
            for action in get_args(Action)
            for by in get_args(By)
        }

    def refusal(self, action: Action, keys: dict[By, str]) -> tuple[str, int] | None:
        """Count an action, and return None, or why it is refused and for how many seconds."""
        asked = [
            (by, rate, (action, by, key))
            for by, key in keys.items()
            for rate in self._rates[action, by]
        ]
        for by, rate, key in asked:
            if not self._limiter.test(rate, *key):
                wait_s = max(
                    1,
                    math.ceil(self._limiter.get_window_stats(rate, *key).reset_time - time.time()),
                )
                return (
                    f"too many {WHAT[action]} from {WHERE[by]} ({rate} at most): try again in {wait_s} s",
                    wait_s,
                )
        for _, rate, key in asked:
            self._limiter.hit(rate, *key)
        if len(self) > self._most_names:
            self._forget_idle()
        return None

    def __len__(self) -> int:
        """Return how many rates of an address or a player are in memory."""
        return len(self._storage.events)

    def _forget_idle(self) -> None:
        """Forget who has done nothing of late; only the caller's thread adds anything to a list that is empty."""
        events = self._storage.events
        for name in [name for name, done in events.copy().items() if not done]:
            del events[name]
        self._most_names = max(MAX_IDLE, 2 * len(events))


class Admission:
    """Lets requests wait for their turn, and refuses what is too much with 429 (sockets: 503) and when to come back."""

    def __init__(self, app: ASGIApp, protection: Protection, answer: Answer) -> None:
        self._app, self._protection, self._answer = app, protection, answer
        self._rates = Rates(protection.limits)
        token = protection.limits.token
        self._token = b"" if token is None else token.get_secret_value().encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await self._admit_socket(scope, receive, send)
            return
        if scope["type"] != "http" or self._has_token(scope):
            await self._app(scope, receive, send)
            return
        address = client_address(HTTPConnection(scope))
        asker = f"{address} probes" if scope["path"] in PROBES else address
        buckets = (
            self._protection.files if scope["path"].startswith(FILES) else self._protection.requests
        )
        wait_s = buckets.of(asker).take_within(PATIENCE_S)
        if wait_s is None:
            self._protection.count_refusal("rate_request")
            again_s = math.ceil(PATIENCE_S)
            detail = f"too many requests from {WHERE['address']}: try again in {again_s} s"
            await self._refuse(scope, receive, send, 429, detail, again_s)
            return
        if wait_s:
            await asyncio.sleep(wait_s)
        await self._protection.turns.begin(asker)
        action = _action_of(scope)
        if (
            action is not None
            and (refusal := self._rates.refusal(action, _keys_of(scope, address))) is not None
        ):
            self._protection.count_refusal(f"rate_{action}")
            await self._refuse(scope, receive, send, 429, *refusal)
            return
        await self._app(scope, receive, send)

    async def _admit_socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        key = None if self._has_token(scope) else client_address(HTTPConnection(scope))
        if key is not None:
            await self._protection.turns.begin(key)
        sockets = self._protection.sockets
        if not sockets.take(key):
            self._protection.count_refusal("sockets")
            detail = "too many sockets are open; close some pages, or wait half a minute"
            await self._refuse(scope, receive, send, 503, detail, RETRY_AFTER_S)
            return
        try:
            await self._app({**scope, "limited_as": key}, receive, send)
        finally:
            sockets.give_back(key)

    async def _refuse(
        self, scope: Scope, receive: Receive, send: Send, status: int, detail: str, wait_s: int
    ) -> None:
        async def send_with_wait(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                MutableHeaders(scope=message)["retry-after"] = str(wait_s)
            await send(message)

        await refuse(scope, receive, send_with_wait, status, detail, self._answer)

    def _has_token(self, scope: Scope) -> bool:
        given = Headers(scope=scope).get(TOKEN_HEADER)
        return (
            bool(self._token)
            and given is not None
            and hmac.compare_digest(given.encode(), self._token)
        )


def _action_of(scope: Scope) -> Action | None:
    """Return which action a request asks for; None for any other."""
    if scope["method"] != "POST":
        return None
    path = scope["path"].rstrip("/")
    return next(
        (
            action
            for action, ends in _PATHS.items()
            if (at := path.rfind("/api/")) >= 0 and ends.fullmatch(path, at)
        ),
        None,
    )


def _keys_of(scope: Scope, address: str) -> dict[By, str]:
    """Return whom an action is counted for: an address, and the player whose cookie came."""
    player = _player_of(scope)
    return {"address": address} if player is None else {"address": address, "player": player}


def _player_of(scope: Scope) -> str | None:
    """Return a digest of the player's cookie as it came: whoever forges many is still one address."""
    try:
        found = SimpleCookie(Headers(scope=scope).get("cookie", "")).get(COOKIE)
    except CookieError:
        return None
    return (
        hashlib.sha256(found.value.encode()).hexdigest() if found is not None else None
    )  # as short however long it is
