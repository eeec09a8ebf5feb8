"""The newest frame of a session, for any number of subscribers.

Nothing is queued: a slow subscriber finds the newest frame and never sees those between. All of it runs on one event loop,
so there are no locks.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from types import TracebackType
from typing import Self
from weakref import WeakSet


class Channel:
    """Holds the newest frame, encoded; `publish` replaces it and wakes subscribers and listeners.

    count_dropped  called whenever a frame is replaced before a subscriber got it
    """

    def __init__(self, count_dropped: Callable[[], None] = lambda: None) -> None:
        self.frame = ""
        self._count_dropped = count_dropped
        self._subscribers: WeakSet[Subscriber] = WeakSet()
        self._listeners: dict[int, Callable[[], None]] = {}
        self._listeners_added = 0

    @property
    def subscribers(self) -> int:
        """Return how many subscribers there are now."""
        return len(self._subscribers)

    def publish(self, frame: str) -> None:
        """Replace the frame and wake everybody."""
        for subscriber in self._subscribers:
            if subscriber.is_behind:
                self._count_dropped()
            subscriber.is_behind = True
        self.frame = frame
        self.notify()

    def notify(self) -> None:
        """Wake everybody without a new frame: something else that is shown with it (the pace) has changed."""
        for subscriber in list(self._subscribers):
            subscriber.wake()
        for listener in list(self._listeners.values()):
            listener()

    def subscribe(self) -> Subscriber:
        """Return a new subscriber; close it, use it as a context manager, or simply drop it."""
        subscriber = Subscriber(self)
        self._subscribers.add(subscriber)
        return subscriber

    def unsubscribe(self, subscriber: Subscriber) -> None:
        """Forget the subscriber; a second call changes nothing."""
        self._subscribers.discard(subscriber)

    def add_listener(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call `listener` at each wake; return a function that removes it. A listener does not count as a subscriber."""
        self._listeners_added += 1
        number = self._listeners_added
        self._listeners[number] = listener

        def remove() -> None:
            self._listeners.pop(number, None)

        return remove


class Subscriber:
    """`async for frame in channel.subscribe()`: the present frame at once, then the newest after each wake.

    is_behind  whether there is a frame that it has not been given yet
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._closed = False
        self.is_behind = bool(channel.frame)
        self._woken = asyncio.Event()
        if channel.frame:
            self._woken.set()

    def wake(self) -> None:
        """Let the next `anext` return."""
        self._woken.set()

    def close(self) -> None:
        """End the iteration and leave the channel."""
        self._closed = True
        self._channel.unsubscribe(self)
        self._woken.set()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> str:
        await self._woken.wait()
        if self._closed:
            raise StopAsyncIteration
        self._woken.clear()
        self.is_behind = False
        return self._channel.frame

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
