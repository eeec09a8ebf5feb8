"""What one client may hold open, send and ask for beside everybody else.

An address (behind a named proxy the one that it reports) and a player's cookie have token buckets
for requests, handshakes and what costs the most: joins, boards and episodes. Every socket has one
for its messages. Whoever sends the operator's token is not limited: that is how `humanplay
simulate` plays a whole study.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import math
import re
import shutil
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from websockets.exceptions import ProtocolError
from websockets.frames import Frame, Opcode
from websockets.server import ServerProtocol

from humanplay.board.charges import DAY_S, Charges, Owner
from humanplay.web.protection.gate import RefusedRequestError
from humanplay.web.protection.hosts import client_address
from humanplay.web.settings import Limits, read_bucket

T = TypeVar("T")
TOKEN_HEADER = "x-humanplay-token"
"""The header that holds the operator's token, `limits.token`."""

MOST_OTHER_FRAMES, OTHER_FRAMES_PER_SECOND = 100, 10.0
"""Pings, pongs and parts of messages of one websocket that are read at once, and a second after
that.

Browsers send no pings of their own, and programs one in many seconds.
"""

TOO_MANY_FRAMES = (
    f"too many pings, pongs or parts of messages: {MOST_OTHER_FRAMES} at once and "
    f"{OTHER_FRAMES_PER_SECOND:g} a second are read"
)
"""Why a websocket is closed that sends more of them."""

PROBES = frozenset({"/healthz", "/readyz"})
"""What watches over the server: these requests have a bucket of their own."""

PLAYER_COOKIE, PARTICIPANT_COOKIE = "humanplay_player", "humanplay_participant"

ACTIONS = {
    "joins": re.compile(r"/api/studies/[^/]+/(join|answers|settings)"),
    "sessions": re.compile(r"/api/(sessions|daily)"),
    "episodes": re.compile(r"/api/(sessions|studies)/[^/]+/(episodes|next)"),
}
"""The POST requests of each action, by the end of their path."""

COUNTED = {
    "requests": "requests",
    "handshakes": "new sockets",
    "joins": "joins, answers and settings of a study",
    "sessions": "new boards",
    "episodes": "new episodes",
}
"""What is counted -> what a refusal calls it."""
OWNERS = {"address": "this network", "player": "this browser", "study": "this study"}
"""Against whom it counts -> what a refusal calls them."""

POLICY_VIOLATION = 1008
"""The close code (RFC 6455, section 7.4.1) of a socket that was sent too much."""

PATIENCE = 100
"""Messages in a row that came before the one before them was answered, while they were slowed down,
after which a socket is closed. A script that waits for each answer is closed never."""

PENALTY = 100
"""Handshakes that a socket which is closed for too much costs its address."""

FULL_WAIT_S = 30
"""When a browser may come again that found all places for sockets taken."""

MAX_BUCKETS = 10_000
"""Addresses or players whose rates are remembered; beyond, those that have a full bucket go."""


class TokenBucket:
    """A bucket of `burst` tokens, full at first, that gets `rate` new ones a second."""

    __slots__ = ("_at_s", "_burst", "_clock_s", "_rate", "_tokens")

    def __init__(
        self, burst: int, rate: float, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._burst, self._rate, self._clock_s = burst, rate, clock_s
        self._tokens, self._at_s = float(burst), clock_s()

    def take(self) -> float:
        """Take a token, or none where one is missing.

        Returns:
            0, or for how many seconds it is missing.
        """
        if (missing := 1.0 - self._refilled()) > 1e-9:
            return missing / self._rate
        self._tokens -= 1.0
        return 0.0

    def reserve(self) -> float:
        """Take a token, also one that is missing.

        Returns:
            For how many seconds it is missing.
        """
        self._tokens = self._refilled() - 1.0
        return max(0.0, -self._tokens / self._rate)

    def owe(self, count: int) -> None:
        """Take so many tokens; the bucket owes no more than that."""
        self._tokens = max(self._refilled() - count, -float(count))

    @property
    def is_full(self) -> bool:
        """Return whether a new bucket would be the same."""
        return self._refilled() >= self._burst

    def _refilled(self) -> float:
        now_s = self._clock_s()
        self._tokens = min(self._burst, self._tokens + (now_s - self._at_s) * self._rate)
        self._at_s = now_s
        return self._tokens


class Buckets:
    """A bucket for each address or player, all of one size.

    Those that are full are forgotten.
    """

    def __init__(self, size: str) -> None:
        self._burst, self._rate = read_bucket(size)
        self._most, self._buckets = MAX_BUCKETS, dict[str, TokenBucket]()
        self.size = f"{self._burst} at once and {self._rate:g} a second"

    def of(self, key: str) -> TokenBucket:
        """Return the bucket of an address or a player."""
        bucket = self._buckets.get(key)
        if bucket is None:
            if len(self._buckets) >= self._most:
                used = {owner: one for owner, one in self._buckets.items() if not one.is_full}
                self._buckets, self._most = used, max(MAX_BUCKETS, 2 * len(used))
            bucket = self._buckets[key] = TokenBucket(self._burst, self._rate)
        return bucket

    def forget(self, key: str) -> None:
        """Forget the bucket of an address or a player: the next one is full."""
        self._buckets.pop(key, None)

    def __len__(self) -> int:
        """Return how many are in memory."""
        return len(self._buckets)


@dataclass
class Asker:
    """Who asks just now: by a connection, limited or with the operator's token."""

    scope: Scope
    is_limited: bool

    def owners(self, study: str) -> tuple[Owner, ...]:
        """Against whom what is stored counts.

        Args:
            study: Of the board; "" without one.
        """
        player = _player_of(self.scope, PARTICIPANT_COOKIE if study else PLAYER_COOKIE)
        address = client_address(HTTPConnection(self.scope))
        place = ("study", study) if study else ("address", address)
        return (place,) if player is None else (place, ("player", player))


ASKER: ContextVar[Asker | None] = ContextVar("asker", default=None)
"""None where the server acts by itself."""


class BudgetedCharges(Charges):
    """What was charged to each owner, against their budgets for a day.

    Owners are addresses, players and studies.

    Args:
        count_refusal: Called where something may not begin.
    """

    def __init__(
        self, limits: Limits, database: Path, count_refusal: Callable[[], None] = lambda: None
    ) -> None:
        super().__init__()
        self._limits, self._folder, self._count_refusal = limits, database.parent, count_refusal

    def owners(self, study: str) -> tuple[Owner, ...]:
        """Who asks just now; nobody where the server acts by itself."""
        asker = ASKER.get()
        return () if asker is None else asker.owners(study)

    def check(self, study: str) -> None:
        """Check that an episode may begin.

        Raises:
            RefusedRequestError: 507 for a full disk, 429 for a full budget.
        """
        asker = ASKER.get()
        if asker is None or not asker.is_limited:
            return
        try:
            self._check_disk()
            for kind, _ in self._full(asker.owners(study)):
                raise self._refusal(kind)
        except RefusedRequestError:
            self._count_refusal()
            raise

    def is_full(self, study: str) -> bool:
        """Whether who asks just now has spent their budget."""
        asker = ASKER.get()
        return asker is not None and asker.is_limited and bool(self._full(asker.owners(study)))

    def largest(self, count: int = 3) -> list[dict[str, str | int]]:
        """Those with the most bytes: their `kind`, `bytes` and `budget`.

        A study has its `name` as well, and nobody else.
        """
        return [
            {
                "kind": kind,
                "name": name if kind == "study" else "",
                "bytes": size,
                "budget": self._budget(kind),
            }
            for (kind, name), size in self.today().most_common(count)
        ]

    def most(self, kind: str) -> int:
        """The bytes of the address, player or study that was charged most."""
        return max((size for (owner, _), size in self.today().items() if owner == kind), default=0)

    def _check_disk(self) -> None:
        free = self._limits.free_mb
        if shutil.disk_usage(self._folder).free < free * 1e6:
            raise RefusedRequestError(
                507,
                f"the server's disk has less than {free:g} MB left: what is open goes on, and "
                "new boards begin once its operator has made room",
            )

    def _full(self, owners: tuple[Owner, ...]) -> list[Owner]:
        charged = self.today()
        return [owner for owner in owners if charged[owner] >= self._budget(owner[0])]

    def _refusal(self, kind: str) -> RefusedRequestError:
        return RefusedRequestError(
            429,
            f"{OWNERS[kind]} may store {self._budget(kind) / 1e6:.3g} MB a day, and all of it was stored or is charged to "
            "boards that are open: these go on, and new ones begin when they have ended, or after midnight (UTC)",
            DAY_S - int(time.time()) % DAY_S,
        )

    def _budget(self, kind: str) -> int:
        percent: float = getattr(self._limits, f"stored_{kind}_percent")
        return round(shutil.disk_usage(self._folder).total * percent / 100)


class Protection:
    """What one server counts of its clients; it lives as long as its app.

    Attributes:
        refusals: How often something was refused, by reason; `count` is called with each reason
            too.
        sockets: How many are open, but for those that came with the operator's token.
        charges: What was written for whom.
    """

    def __init__(
        self, limits: Limits, database: Path, count: Callable[[str], None] = lambda reason: None
    ) -> None:
        self.limits, self._count = limits, count
        self.charges = BudgetedCharges(limits, database, lambda: self.count_refusal("stored"))
        self.refusals: Counter[str] = Counter()
        self.sockets = 0
        self._sockets_of: Counter[str] = Counter()
        self._buckets = {
            name: Buckets(getattr(limits, name))
            for name in Limits.model_fields
            if name.endswith(("_per_address", "_per_player")) and name != "sockets_per_address"
        }
        self._token = b"" if limits.token is None else limits.token.get_secret_value().encode()

    def count_refusal(self, reason: str) -> None:
        """Count a refusal; reasons are few words of the code, never a stranger's."""
        self.refusals[reason] += 1
        self._count(reason)

    def has_token(self, scope: Scope) -> bool:
        """Whether the operator's token came with a request."""
        sent = Headers(scope=scope).get(TOKEN_HEADER, "").encode()
        return bool(self._token) and hmac.compare_digest(sent, self._token)

    async def admit(self, scope: Scope) -> None:
        """Count a request, and let it wait for its turn.

        Raises:
            RefusedRequestError: 429 where it is one too many.
        """
        address = client_address(HTTPConnection(scope))
        key = f"{address} probes" if scope["path"] in PROBES else address
        self._take("requests", key)
        if "/static/" not in scope["path"]:
            await asyncio.sleep(self._buckets["paced_per_address"].of(key).reserve())
        if (action := _action_of(scope)) is not None:
            self._take(action, address)
            of_study = "/api/studies/" in scope["path"]
            cookie = PARTICIPANT_COOKIE if of_study else PLAYER_COOKIE
            if (player := _player_of(scope, cookie)) is not None:
                self._take(action, player, "player")

    def check_episode(self, scope: Scope) -> None:
        """Count an episode that begins by another call than the API's.

        Raises:
            RefusedRequestError: 429 where it is one too many.
        """
        self._take("episodes", client_address(HTTPConnection(scope)))

    def open_socket(self, address: str) -> None:
        """Count a socket that opens.

        Raises:
            RefusedRequestError: 503 or 429 where it is one too many.
        """
        most, most_of_one = self.limits.sockets, self.limits.sockets_per_address
        if self.sockets >= most or self._sockets_of[address] >= most_of_one:
            self.count_refusal("sockets")
            detail = "too many sockets are open; close some pages, or wait half a minute"
            raise RefusedRequestError(503, detail, FULL_WAIT_S)
        self._take("handshakes", address)
        self.sockets += 1
        self._sockets_of[address] += 1

    def close_socket(self, address: str) -> None:
        """Count a socket that has closed."""
        self.sockets -= 1
        self._sockets_of[address] -= 1
        if not self._sockets_of[address]:
            del self._sockets_of[address]

    def punish(self, address: str) -> None:
        """Let an address open fewer sockets, since one of its own was closed for too much."""
        self.count_refusal("messages")
        self._buckets["handshakes_per_address"].of(address).owe(PENALTY)

    def _take(self, action: str, key: str, by: str = "address") -> None:
        buckets = self._buckets[f"{action}_per_{by}"]
        if missing_s := buckets.of(key).take():
            self.count_refusal(f"rate_{action}")
            wait_s = math.ceil(missing_s)
            raise RefusedRequestError(
                429,
                f"too many {COUNTED[action]} from {OWNERS[by]} ({buckets.size} at most): "
                f"try again in {wait_s} s",
                wait_s,
            )


def _action_of(scope: Scope) -> str | None:
    """Which action a request asks for; None for any other."""
    path = scope["path"].rstrip("/")
    if scope["method"] != "POST" or (at := path.rfind("/api/")) < 0:
        return None
    return next((action for action, ends in ACTIONS.items() if ends.fullmatch(path, at)), None)


def _player_of(scope: Scope, name: str) -> str | None:
    """A digest of a cookie of that name as it came.

    Whoever forges many is one address.
    """
    cookie = HTTPConnection(scope).cookies.get(name + scope["app"].state.cookies)
    return None if cookie is None else hashlib.sha256(cookie.encode()).hexdigest()


class _SlowReaderError(Exception):
    """A client did not take what was sent to it."""


class LimitedFrames:
    """Reads a websocket's frames, but only a few that are no message.

    The app hears nothing of those.

    Args:
        connection: Its `recv_frame` is called for each frame.
    """

    def __init__(self, connection: ServerProtocol) -> None:
        self.is_exceeded = False
        self._connection, self._read = connection, connection.recv_frame
        self._bucket = TokenBucket(MOST_OTHER_FRAMES, OTHER_FRAMES_PER_SECOND)

    def take(self, frame: Frame) -> None:
        """Read a frame.

        Raises:
            ProtocolError: There were too many; the socket is being closed, and what came with it is
                discarded.
        """
        is_message = frame.fin and frame.opcode in (Opcode.TEXT, Opcode.BINARY)
        if not is_message and frame.opcode is not Opcode.CLOSE and self._bucket.take():
            self.is_exceeded = True
            self._connection.fail(POLICY_VIOLATION, TOO_MANY_FRAMES)
            raise ProtocolError(TOO_MANY_FRAMES)
        self._read(frame)


class LimitedClients:
    """Refuses requests and sockets that are too many.

    It ends those that come or are read too slowly.

    Args:
        most_bytes: Of a request's body; beyond, it is refused with 413.
    """

    def __init__(self, app: ASGIApp, *, protection: Protection, most_bytes: int) -> None:
        self._app, self._protection, self._most_bytes = app, protection, most_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        is_limited = not self._protection.has_token(scope)
        ASKER.set(Asker(scope, is_limited))
        if scope["type"] == "http":
            if is_limited:
                await self._protection.admit(scope)
            await self._serve_request(scope, receive, send)
        elif is_limited:
            await self._serve_socket(scope, receive, send)
        else:
            await self._app(scope, receive, send)

    async def _serve_request(self, scope: Scope, receive: Receive, send: Send) -> None:
        limits, size, is_whole = self._protection.limits, 0, False
        until_s = asyncio.get_running_loop().time() + limits.body_s

        async def receive_body() -> Message:
            nonlocal size, is_whole
            if is_whole:
                return await receive()
            try:
                async with asyncio.timeout_at(until_s):
                    message = await receive()
            except TimeoutError as error:
                self._protection.count_refusal("slow_body")
                detail = f"the body of a request must come within {limits.body_s:g} s"
                raise HTTPException(408, detail, {"Connection": "close"}) from error
            size += len(message.get("body", b""))
            is_whole = not message.get("more_body")
            if size > self._most_bytes:
                detail = f"a body must be at most {self._most_bytes} bytes, got {size} or more"
                raise HTTPException(413, detail, {"Connection": "close"})
            return message

        async def send_in_time(message: Message) -> None:
            try:
                async with asyncio.timeout(limits.answer_s):
                    await send(message)
            except TimeoutError as error:
                raise _SlowReaderError from error

        try:
            await self._app(scope, receive_body, send_in_time)
        except _SlowReaderError:  # uvicorn closes a connection whose answer is not whole
            self._protection.count_refusal("slow_reader")

    async def _serve_socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        protection, address = self._protection, client_address(HTTPConnection(scope))
        burst, rate = read_bucket(protection.limits.messages)
        bucket, early = TokenBucket(burst, rate), 0
        coming: asyncio.Task[Message] | None = None

        def note_flood() -> None:
            protection.punish(address)
            scope["noted"]["status"] = POLICY_VIOLATION

        async def receive_at_rate() -> Message:
            nonlocal coming, early
            message = await (receive() if coming is None else coming)
            coming = None
            if message["type"] == "websocket.disconnect":
                if message["code"] == POLICY_VIOLATION:  # `listening` has closed it
                    note_flood()
                return message
            if message["type"] != "websocket.receive" or not (wait_s := bucket.take()):
                return message
            coming = asyncio.create_task(receive())  # type: ignore[arg-type]
            await asyncio.sleep(wait_s)
            bucket.take()
            early = early + 1 if coming.done() else 0
            if early <= PATIENCE:
                return message
            note_flood()
            reason = f"too many messages: {burst} at once and {rate:g} a second are answered"
            with suppress(RuntimeError, OSError):  # whoever sent them may have gone already
                await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": reason})
            return {"type": "websocket.disconnect", "code": POLICY_VIOLATION}

        protection.open_socket(address)
        try:
            await self._app(scope, receive_at_rate, send)
        finally:
            protection.close_socket(address)
            if coming is not None:
                coming.cancel()
