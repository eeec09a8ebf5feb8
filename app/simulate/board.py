"""A synthetic player's board: the frames of its session, checked for what they must not show, and the choice of moves."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.simulate.client import ConnectionLostError, Page, RequestRefusedError
from app.simulate.decisions import DecisionKernel
from app.simulate.persona import PlayStyle
from marsexplorer.config import ACTIONS

CODE_OF_CHARACTER = bytes.maketrans(b"?.@#", bytes(range(4)))
SCORE_FIELDS = ("reward", "return", "score")
"""Fields of a frame that are null while ranked episodes are played."""

ReportFault = Callable[[str], None]


@dataclass(frozen=True)
class ScoreVisibility:
    """Which frames of an episode may show its score.

    hides_scores       reward, return and score are null
    shows_final_score  the last frame shows them all the same, because no ranked episode comes after it
    """

    episode: str
    hides_scores: bool = False
    shows_final_score: bool = False


class SimulatedBoard:
    """One session as its page sees it, over any number of sockets; `frame` is the newest."""

    def __init__(self, page: Page, radius: int, report_fault: ReportFault) -> None:
        self.page, self._radius, self._report_fault = page, radius, report_fault
        self.frame: dict[str, Any] = {}
        self._visibility = ScoreVisibility("")
        self.is_refused = False
        self._kernel: DecisionKernel | None = None

    async def show(self, session: str, visibility: ScoreVisibility) -> None:
        """Bring the newest frame of an episode and its path onto the board; ConnectionLostError when none comes."""
        self._visibility, episode = visibility, visibility.episode
        if not self.page.is_open or self.page.session != session:
            await self.page.open(session)
            history = await self._receive_until("history", episode)
        elif self.frame.get("episode") == episode:
            return
        else:
            history = await self._receive_until("history", episode)
        self._restore_path(history)

    async def act(self, action: str, press: dict[str, Any]) -> float:
        """Make a move and return its round trip in ms; the frame after it, or that of a refusal, is then on the board."""
        frame, self.is_refused = self.frame, False
        step, episode = frame["step"], frame["episode"]
        began = time.perf_counter()
        await self.page.send(
            {"kind": "act", "episode": episode, "step": step, "action": action, **press}
        )
        while (
            not self.is_refused and self.frame["episode"] == episode and self.frame["step"] <= step
        ):
            await self._receive()
        return (time.perf_counter() - began) * 1000

    async def send_events(self, events: dict[str, Any]) -> dict[str, Any]:
        """Send input events and return the answer; RequestRefusedError when the study is closed."""
        await self.page.send(events)
        while (answer := await self._receive())["kind"] != "kept":
            pass
        if "closed" in (answer["reason"] or ""):
            raise RequestRefusedError(409, answer["reason"])
        return answer

    def decide(self, style: PlayStyle) -> str:
        """Return the next action in words."""
        frame = self.frame
        assert self._kernel is not None
        rows, cols = frame["rows"], frame["cols"]
        codes = np.frombuffer(
            "".join(frame["grid"]).encode().translate(CODE_OF_CHARACTER), np.uint8
        ).reshape(1, rows, cols)
        style_arrays = (
            np.array([style.slip]),
            np.array([style.crash]),
            np.array([style.stream], np.uint64),
        )
        at, moves = np.array([frame["position"]], np.int64), np.array([frame["step"]], np.int64)
        self._kernel.heading[0] = ACTIONS.index(frame["heading"])
        return ACTIONS[
            int(self._kernel.decide(codes, at, np.ones(1, np.bool_), style_arrays, moves)[0])
        ]

    async def _receive_until(self, kind: str, episode: str) -> dict[str, Any]:
        """Return the next message of a kind about an episode, its frame on the board by then."""
        while True:
            message = await self._receive()
            if (
                message["kind"] == kind
                and message["episode"] == episode
                and self.frame.get("episode") == episode
            ):
                return message

    async def _receive(self) -> dict[str, Any]:
        message = await self.page.receive()
        if message["kind"] == "refused":
            self.is_refused = True
            if "closed" in message["reason"]:
                raise RequestRefusedError(409, message["reason"])
            self._apply_frame(message["frame"])
        elif message["kind"] == "frame":
            self._apply_frame(message)
        elif message["kind"] == "error":
            raise ConnectionLostError(message["detail"])
        return message

    def _apply_frame(self, frame: dict[str, Any]) -> None:
        """Keep a frame as the newest and check it: no older than the last of its episode, and without what the study hides."""
        last = self.frame
        if last.get("episode") == frame["episode"] and frame["step"] < last["step"]:
            self._report_fault(
                f"episode {frame['episode']} went back from move {last['step']} to {frame['step']}"
            )
        visibility = self._visibility
        may_show = not visibility.hides_scores or (
            visibility.shows_final_score and frame["outcome"] is not None
        )
        if (
            frame["episode"] == visibility.episode
            and not may_show
            and any(frame[name] is not None for name in SCORE_FIELDS)
        ):
            self._report_fault(
                f"a ranked frame tells its score: episode {frame['episode']}, move {frame['step']}"
            )
        self.frame = frame

    def _restore_path(self, history: dict[str, Any]) -> None:
        shape = (self.frame["rows"], self.frame["cols"])
        self._kernel = DecisionKernel(shape, self._radius)
        for row, col in history["positions"]:
            self._kernel.visited[0, row, col] = 1
