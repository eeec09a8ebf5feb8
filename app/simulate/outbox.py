"""The input events that a synthetic player still has to send, in batches that are sent again until the server keeps them."""

from __future__ import annotations

from typing import Any
from uuid import uuid4

from app.simulate.board import ReportFault, SimulatedBoard
from app.simulate.client import ConnectionLostError

MAX_EVENTS_PER_BATCH = 200
"""The most input events that the server takes in one message."""


class Outbox:
    """Batches that the server has not answered, in order; they outlive a connection and a page."""

    def __init__(self, report_fault: ReportFault) -> None:
        self._report_fault = report_fault
        self._batches: list[dict[str, Any]] = []

    @property
    def is_empty(self) -> bool:
        """Whether everything was answered."""
        return not self._batches

    def add(self, episode: str, events: list[dict[str, Any]]) -> None:
        """Add an episode's events in batches, which never change from then on."""
        for start in range(0, len(events), MAX_EVENTS_PER_BATCH):
            batch = events[start : start + MAX_EVENTS_PER_BATCH]
            self._batches.append(
                {"kind": "events", "episode": episode, "batch": uuid4().hex, "events": batch}
            )

    async def send_all(self, board: SimulatedBoard) -> None:
        """Send every batch until it is kept; ConnectionLostError when the connection breaks: the rest is sent over the next."""
        while self._batches:
            batch = self._batches[0]
            answer = await board.send_events(batch)
            count, reason = answer["count"], answer["reason"]
            if reason is not None:
                self._report_fault(
                    f"input events of episode {batch['episode']} are not kept: {reason}"
                )
            elif count != len(batch["events"]):
                raise ConnectionLostError("the server cannot keep input events now")
            self._batches.pop(0)
