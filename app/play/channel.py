"""The newest frame of a session, to any number of followers.

Nothing is queued: a follower that was slow finds the newest frame and never sees those between. All of it runs on one
event loop, so there are no locks.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from types import TracebackType
from typing import Self
from weakref import WeakSet


class Channel:
    """Holds the newest frame, encoded; `publish` replaces it and wakes whoever follows or listens."""

    def __init__(self) -> None:
        self.frame = ""
        self._followers: WeakSet[Follower] = WeakSet()
        self._listeners: dict[int, Callable[[], None]] = {}
        self._count = 0

    @property
    def followers(self) -> int:
        """How many follow now."""
        return len(self._followers)

    def publish(self, frame: str) -> None:
        """Put the frame in the place of the last and wake everybody."""
        self.frame = frame
        self.nudge()

    def nudge(self) -> None:
        """Wake everybody without a new frame: something beside it (the pace) has changed."""
        for follower in list(self._followers):
            follower.wake()
        for listener in list(self._listeners.values()):
            listener()

    def follow(self) -> Follower:
        """Return a new follower; close it, use it as a context manager, or simply drop it."""
        follower = Follower(self)
        self._followers.add(follower)
        return follower

    def leave(self, follower: Follower) -> None:
        """Return with the follower forgotten; a second time changes nothing."""
        self._followers.discard(follower)

    def listen(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call `listener` at each wake; return a function that ends it. A listener does not count as a follower."""
        self._count += 1
        number = self._count
        self._listeners[number] = listener
        return lambda: void(self._listeners.pop(number, None))


def void(_: object) -> None:
    """Return None, whatever came."""


class Follower:
    """`async for frame in channel.follow()`: the frame that stands at once, then the newest after each wake."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._closed = False
        self._woken = asyncio.Event()
        if channel.frame:
            self._woken.set()

    def wake(self) -> None:
        """Let the next `anext` return."""
        self._woken.set()

    def close(self) -> None:
        """End the iteration and leave the channel."""
        self._closed = True
        self._channel.leave(self)
        self._woken.set()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> str:
        await self._woken.wait()
        if self._closed:
            raise StopAsyncIteration
        self._woken.clear()
        return self._channel.frame

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
