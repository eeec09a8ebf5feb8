"""A synthetic player's input events on their way: nothing lost with a line, and what will never be kept is a fault."""

import asyncio

import pytest

from app.simulate.client import ConnectionLostError
from app.simulate.outbox import MOST_EVENTS, Outbox


class Line:
    """A board that answers as it is told to; `heard` is all it was sent."""

    def __init__(self, *answers):
        self.answers, self.heard = list(answers), []

    async def tell(self, batch):
        self.heard.append(batch)
        answer = self.answers.pop(0) if self.answers else {"count": len(batch["events"]), "reason": None}
        if answer is ConnectionLostError:
            raise ConnectionLostError("the line is lost")
        return answer


def test_a_batch_whose_answer_is_lost_is_told_again_unchanged_and_first():
    faults = []
    outbox, line = Outbox(faults.append), Line({"count": MOST_EVENTS, "reason": None}, ConnectionLostError)
    outbox.add("e1", [{"client_ms": k} for k in range(MOST_EVENTS + 2)])
    outbox.add("e1", [])
    with pytest.raises(ConnectionLostError):
        asyncio.run(outbox.tell(line))
    outbox.add("e2", [{"client_ms": 900}])
    asyncio.run(outbox.tell(line))
    told = [(batch["episode"], len(batch["events"]), batch["events"][0]["client_ms"]) for batch in line.heard]
    assert told == [("e1", MOST_EVENTS, 0), ("e1", 2, MOST_EVENTS), ("e1", 2, MOST_EVENTS), ("e2", 1, 900)]
    assert outbox.is_empty
    assert faults == []


def test_what_is_not_kept_now_is_told_again_and_what_never_will_be_is_a_fault():
    faults = []
    never = {"count": 0, "reason": "none of this participant's"}
    outbox, line = Outbox(faults.append), Line({"count": 0, "reason": None}, never)
    outbox.add("e1", [{"client_ms": 1}])
    with pytest.raises(ConnectionLostError, match="now"):
        asyncio.run(outbox.tell(line))
    asyncio.run(outbox.tell(line))
    assert outbox.is_empty
    assert len(line.heard) == 2
    assert faults == ["input events of episode e1 are not kept: none of this participant's"]
