"""A synthetic player's input events on their way: nothing is lost with a connection, and what will never be kept is a fault."""

import asyncio

import pytest

from app.simulate.client import ConnectionLostError
from app.simulate.outbox import MAX_EVENTS_PER_BATCH, Outbox


class FakeBoard:
    """A board with prepared answers; `received` is all that it was sent."""

    def __init__(self, *answers):
        self.answers, self.received = list(answers), []

    async def send_events(self, batch):
        self.received.append(batch)
        answer = (
            self.answers.pop(0) if self.answers else {"count": len(batch["events"]), "reason": None}
        )
        if answer is ConnectionLostError:
            raise ConnectionLostError("the connection is lost")
        return answer


def test_a_batch_whose_answer_is_lost_is_sent_again_unchanged_and_first():
    faults = []
    outbox, board = (
        Outbox(faults.append),
        FakeBoard({"count": MAX_EVENTS_PER_BATCH, "reason": None}, ConnectionLostError),
    )
    outbox.add("e1", [{"client_ms": k} for k in range(MAX_EVENTS_PER_BATCH + 2)])
    outbox.add("e1", [])
    with pytest.raises(ConnectionLostError):
        asyncio.run(outbox.send_all(board))
    outbox.add("e2", [{"client_ms": 900}])
    asyncio.run(outbox.send_all(board))
    sent = [
        (batch["episode"], len(batch["events"]), batch["events"][0]["client_ms"])
        for batch in board.received
    ]
    assert sent == [
        ("e1", MAX_EVENTS_PER_BATCH, 0),
        ("e1", 2, MAX_EVENTS_PER_BATCH),
        ("e1", 2, MAX_EVENTS_PER_BATCH),
        ("e2", 1, 900),
    ]
    assert outbox.is_empty
    assert faults == []


def test_what_is_not_kept_now_is_sent_again_and_what_never_will_be_is_a_fault():
    faults = []
    never = {"count": 0, "reason": "none of this participant's"}
    outbox, board = Outbox(faults.append), FakeBoard({"count": 0, "reason": None}, never)
    outbox.add("e1", [{"client_ms": 1}])
    with pytest.raises(ConnectionLostError, match="now"):
        asyncio.run(outbox.send_all(board))
    asyncio.run(outbox.send_all(board))
    assert outbox.is_empty
    assert len(board.received) == 2
    assert faults == ["input events of episode e1 are not kept: none of this participant's"]
