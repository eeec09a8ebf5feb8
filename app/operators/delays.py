"""How fast passwords may be guessed: after some wrong ones an address waits, twice as long each time, and nobody else does."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable

FREE_ATTEMPTS = 5
"""Wrong attempts of an address before it waits."""

FIRST_WAIT_S, LONGEST_WAIT_S = 10.0, 300.0
FORGOTTEN_AFTER_S = 3600.0
"""Seconds without an attempt after which an address begins anew."""

MAX_ADDRESSES = 10_000
"""Addresses that are remembered; the one that tried longest ago is forgotten first."""


class TooManyAttemptsError(Exception):
    """An address has guessed too often; `wait_s` says when its next attempt is looked at, in whole seconds."""

    def __init__(self, wait_s: int) -> None:
        super().__init__(
            f"too many wrong attempts from this address: wait {wait_s} seconds, then try again"
        )
        self.wait_s = wait_s


class Delays:
    """The attempts of each address; `clock` gives seconds that never go back."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._attempts: OrderedDict[str, tuple[int, float, float]] = OrderedDict()

    def begin_attempt(self, address: str) -> None:
        """Count an attempt as wrong until `forgive` says otherwise; TooManyAttemptsError while the address has to wait.

        It counts before the password is looked at, so attempts at the same time are no way around the wait.
        """
        now = self._clock()
        count, until, last = self._attempts.get(address, (0, 0.0, now))
        if now < until:
            raise TooManyAttemptsError(max(1, round(until - now)))
        count = 1 if now - last > FORGOTTEN_AFTER_S else count + 1
        wait_s = (
            min(LONGEST_WAIT_S, FIRST_WAIT_S * 2.0 ** min(count - FREE_ATTEMPTS, 30))
            if count >= FREE_ATTEMPTS
            else 0.0
        )
        self._attempts[address] = (count, now + wait_s, now)
        self._attempts.move_to_end(address)
        if len(self._attempts) > MAX_ADDRESSES:
            self._attempts.popitem(last=False)

    def forgive(self, address: str) -> None:
        """Forget the attempts of an address: the last one was right."""
        self._attempts.pop(address, None)
