"""Input events of a synthetic player on their way to the server: in batches, each told until it is kept, as a page does."""

from __future__ import annotations

from typing import Any

from app.simulate.board import Board, Fault
from app.simulate.client import ConnectionLostError

MOST_EVENTS = 200
"""In a batch."""


class Outbox:
    """Batches that the server has not answered, in order; they outlive the line and the page."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._batches: list[dict[str, Any]] = []

    @property
    def is_empty(self) -> bool:
        """Whether everything was answered."""
        return not self._batches

    def add(self, episode: str, events: list[dict[str, Any]]) -> None:
        """Return with an episode's events in batches, which never change from then on."""
        for start in range(0, len(events), MOST_EVENTS):
            batch = events[start : start + MOST_EVENTS]
            self._batches.append({"kind": "events", "episode": episode, "events": batch})

    async def tell(self, board: Board) -> None:
        """Return when every batch is kept; ConnectionLostError when the connection breaks: the next one takes the rest."""
        while self._batches:
            batch = self._batches[0]
            answer = await board.tell(batch)
            count, reason = answer["count"], answer["reason"]
            if reason is not None:
                self._fault(f"input events of episode {batch['episode']} are not kept: {reason}")
            elif count != len(batch["events"]):
                raise ConnectionLostError("the server cannot keep input events now")
            self._batches.pop(0)
