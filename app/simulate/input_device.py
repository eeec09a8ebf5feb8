"""The keyboard or touch screen of a synthetic player: keys are pressed as people do, and reported as a browser does.

Time is compressed, and the telemetry is not: a wait of 320 ms sleeps 320 / speed ms and moves the page's clock on by 320,
so labels, pauses and decision times come out as they would at human speed. Only the round trips are real.
"""

from __future__ import annotations

import asyncio
import time
from typing import Any

import numpy as np

from app.simulate.outcome_log import OutcomeLog
from app.simulate.persona import Persona

KEYS = {"north": "ArrowUp", "east": "ArrowRight", "south": "ArrowDown", "west": "ArrowLeft"}
SEND_AFTER_EVENTS = 100
"""The number of events after which they are sent."""

PAUSE_AFTER_MS = 60_000.0
SHORTEST_SLEEP_S = 0.0005
"""asyncio cannot sleep for less; a shorter wait only moves the clock."""


class PageClock:
    """The monotonic clock of one page, in ms since it was loaded; `speed` compresses waits alone."""

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self._loaded = time.perf_counter()
        self._skipped_ms = 0.0

    def now_ms(self) -> float:
        """Return what performance.now() would return, rounded to a tenth."""
        return round((time.perf_counter() - self._loaded) * 1000 + self._skipped_ms, 1)

    async def wait(self, ms: float) -> None:
        """Wait until `ms` have passed on this clock."""
        began = time.perf_counter()
        seconds = ms / 1000 / self.speed
        await asyncio.sleep(seconds if seconds > SHORTEST_SLEEP_S else 0)
        self._skipped_ms += max(0.0, ms - (time.perf_counter() - began) * 1000)


class InputDevice:
    """Presses and releases; `events` holds their input events that are not sent yet, as the socket takes them."""

    def __init__(
        self,
        persona: Persona,
        clock: PageClock,
        rng: np.random.Generator,
        log: OutcomeLog | None = None,
    ) -> None:
        self.clock = clock
        self.events: list[dict[str, Any]] = []
        self._persona = persona
        self._rng = rng
        self._log = log or OutcomeLog()
        self._down, self._up = (
            ("touchdown", "touchup") if persona.modality == "touch" else ("keydown", "keyup")
        )
        self._up_ms: float | None = None
        self._pressed_ms = 0.0
        self._last = ""

    async def wait_to_decide(self, action: str) -> None:
        """Wait for the time it takes to see a frame and to decide; a turn takes longer than going straight on.

        A robotic player presses at the next multiple of its interval after the frame.
        """
        persona = self._persona
        if persona.kind.is_robotic:
            await self.clock.wait(
                persona.decision_ms - (self.clock.now_ms() - self._pressed_ms) % persona.decision_ms
            )
            return
        turn = 1.0 if action == self._last else 1.5
        await self.clock.wait(
            max(110.0, float(self._rng.lognormal(np.log(persona.decision_ms * turn), 0.35)))
        )

    def press(self, action: str, step: int) -> dict[str, Any]:
        """Press a key and return what the act message says of it: input and times in ms."""
        down = self.clock.now_ms()
        self._last, self._pressed_ms = action, down
        self.record_event(self._down, code=self._code(action), repeat=False, step=step, at_ms=down)
        is_key = self._persona.modality == "keyboard"
        up, self._up_ms = self._up_ms, None
        return {
            "input": "key" if is_key else "touch",
            "key_down_ms": down,
            "key_up_ms": up,
            "client_ms": self.clock.now_ms(),
        }

    async def release(self, action: str, step: int, round_trip_ms: float) -> None:
        """Wait until the key is up again; `step` is the frame that is then on screen."""
        if self._persona.kind.is_robotic:
            return
        held = max(35.0, float(self._rng.lognormal(np.log(self._persona.hold_ms), 0.2)))
        await self.clock.wait(max(0.0, held - round_trip_ms))
        self._up_ms = self.clock.now_ms()
        self.record_event(
            self._up,
            code=self._code(action),
            step=step,
            at_ms=self._up_ms,
            round_trip_ms=round(round_trip_ms, 2),
        )

    async def idle(self, ms: float, step: int) -> None:
        """Stay away for a time: the page is hidden and, after PAUSE_AFTER_MS, pauses itself."""
        self.record_event("hidden", step=step)
        if ms >= PAUSE_AFTER_MS:
            await self.clock.wait(PAUSE_AFTER_MS)
            self.record_event("pause", step=step)
        await self.clock.wait(ms - PAUSE_AFTER_MS if ms >= PAUSE_AFTER_MS else ms)
        self.record_event("visible", step=step)
        if ms >= PAUSE_AFTER_MS:
            self.record_event("resume", step=step)

    def take_events(self) -> list[dict[str, Any]]:
        """Remove the events of the next batch and return them."""
        taken, self.events = self.events, []
        return taken

    def record_event(self, kind: str, at_ms: float | None = None, **rest: Any) -> None:
        """Keep an input event for the next batch."""
        is_press = kind in ("keydown", "keyup", "touchdown", "touchup")
        event = dict.fromkeys(("code", "repeat", "trusted", "step", "round_trip_ms"))
        at = self.clock.now_ms() if at_ms is None else at_ms
        self._log.events_recorded += 1
        self.events.append(
            {**event, "kind": kind, "trusted": True if is_press else None, "client_ms": at, **rest}
        )

    def _code(self, action: str) -> str | None:
        return KEYS[action] if self._persona.modality == "keyboard" else None
