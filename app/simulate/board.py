"""A synthetic player's board: the frames of its session, watched for what they must not say, and the mind that drives it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.simulate.client import ConnectionLostError, Page, RequestRefusedError
from app.simulate.decisions import Minds
from app.simulate.persona import Nature
from marsexplorer.config import ACTIONS

CELLS = bytes.maketrans(b"?.@#", bytes(range(4)))
HIDDEN = ("reward", "return", "score")
"""Fields of a frame that are null while ranked episodes are played."""

Fault = Callable[[str], None]


@dataclass(frozen=True)
class Rule:
    """What the frames of an episode must keep to themselves.

    hides      reward, return and score are null
    shows_end  but for its last frame: no ranked episode comes after it
    """

    episode: str
    hides: bool = False
    shows_end: bool = False


class Board:
    """One session as its page sees it, over any number of sockets; `frame` is the newest."""

    def __init__(self, page: Page, radius: int, fault: Fault) -> None:
        self.page, self._radius, self._fault = page, radius, fault
        self.frame: dict[str, Any] = {}
        self._rule = Rule("")
        self.is_refused = False
        self._minds: Minds | None = None

    async def show(self, session: str, rule: Rule) -> None:
        """Return with the newest frame of an episode on the board and its path known; ConnectionLostError when none comes."""
        self._rule, episode = rule, rule.episode
        if not self.page.is_open or self.page.session != session:
            await self.page.open(session)
            history = await self._until("history", episode)
        elif self.frame.get("episode") == episode:
            return
        else:
            history = await self._until("history", episode)
        self._remember(history)

    async def act(self, action: str, press: dict[str, Any]) -> float:
        """Return the round trip (ms) of a move; the frame after it is on the board. A refusal leaves the frame it brings."""
        frame, self.is_refused = self.frame, False
        step, episode = frame["step"], frame["episode"]
        began = time.perf_counter()
        await self.page.send({"kind": "act", "episode": episode, "step": step, "action": action, **press})
        while not self.is_refused and self.frame["episode"] == episode and self.frame["step"] <= step:
            await self._take()
        return (time.perf_counter() - began) * 1000

    async def tell(self, events: dict[str, Any]) -> dict[str, Any]:
        """Return the answer to input events; RequestRefusedError when the study is closed."""
        await self.page.send(events)
        while (answer := await self._take())["kind"] != "kept":
            pass
        if "closed" in (answer["reason"] or ""):
            raise RequestRefusedError(409, answer["reason"])
        return answer

    def decide(self, nature: Nature) -> str:
        """Return the next action in words."""
        frame = self.frame
        assert self._minds is not None
        rows, cols = frame["rows"], frame["cols"]
        codes = np.frombuffer("".join(frame["grid"]).encode().translate(CELLS), np.uint8).reshape(1, rows, cols)
        given = (np.array([nature.slip]), np.array([nature.crash]), np.array([nature.dice], np.uint64))
        at, moves = np.array([frame["position"]], np.int64), np.array([frame["step"]], np.int64)
        self._minds.heading[0] = ACTIONS.index(frame["heading"])
        return ACTIONS[int(self._minds.decide(codes, at, np.ones(1, np.bool_), given, moves)[0])]

    async def _until(self, kind: str, episode: str) -> dict[str, Any]:
        """Return the next message of a kind about an episode, its frame on the board by then."""
        while True:
            message = await self._take()
            if message["kind"] == kind and message["episode"] == episode and self.frame.get("episode") == episode:
                return message

    async def _take(self) -> dict[str, Any]:
        message = await self.page.receive()
        if message["kind"] == "refused":
            self.is_refused = True
            if "closed" in message["reason"]:
                raise RequestRefusedError(409, message["reason"])
            self._see(message["frame"])
        elif message["kind"] == "frame":
            self._see(message)
        elif message["kind"] == "error":
            raise ConnectionLostError(message["detail"])
        return message

    def _see(self, frame: dict[str, Any]) -> None:
        """Take a frame in: it must be no older than the last of its episode, and hide what the study hides."""
        last = self.frame
        if last.get("episode") == frame["episode"] and frame["step"] < last["step"]:
            self._fault(f"episode {frame['episode']} went back from move {last['step']} to {frame['step']}")
        rule = self._rule
        may_tell = not rule.hides or (rule.shows_end and frame["outcome"] is not None)
        if frame["episode"] == rule.episode and not may_tell and any(frame[name] is not None for name in HIDDEN):
            self._fault(f"a ranked frame tells its score: episode {frame['episode']}, move {frame['step']}")
        self.frame = frame

    def _remember(self, history: dict[str, Any]) -> None:
        shape = (self.frame["rows"], self.frame["cols"])
        self._minds = Minds(shape, self._radius)
        for row, col in history["positions"]:
            self._minds.visited[0, row, col] = 1
