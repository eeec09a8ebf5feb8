"""A synthetic player's way through a study, from the link to the completion code.

Each turn begins with `GET me`: where the study says that the player stands, there it goes on. So a reload, a lost
connection and a stopped server need no memory here, and the player cannot believe anything that the study does not.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

from app.simulate.board import Board, Rule
from app.simulate.cheating import Cheats
from app.simulate.client import ConnectionLostError, Page, RequestRefusedError
from app.simulate.keyboard import BATCH, Clock, Hands
from app.simulate.outbox import Outbox
from app.simulate.outcome_log import Line, Tally
from app.simulate.persona import PHASES, Nature, Persona

FIRST_RETRY_S, LONGEST_RETRY_S = 0.25, 2.0
"""Waits between attempts to find the server again, as the page's."""
SETBACKS = 30
"""Refusals and lost connections without any progress after which a player gives up."""

STEPS_BEFORE_LEAVING = 3
"""Moves that a player makes in the episode which it leaves for ever."""


class StudyOverError(Exception):
    """The study cannot go on for anybody; one sentence."""


@dataclass
class Seat:
    """What a player needs to come back as itself: its cookie and its outside ids; `has_left` for ever."""

    cookie: str | None = None
    outside_ids: dict[str, str] | None = None
    has_left: bool = False


@dataclass(frozen=True)
class Place:
    """Where a study is played: server, name, what its protocol says, and how fast time goes.

    patience_s  how long to wait for a server that has gone away
    """

    url: str
    study: str
    radius: int
    speed: float
    patience_s: float


class Participant:
    """One player in one study; `play` goes all the way."""

    def __init__(self, persona: Persona, place: Place, seat: Seat, tally: Tally, neighbours: list[Participant]) -> None:
        self.persona, self.place, self.seat, self._tally = persona, place, seat, tally
        self.line = Line(persona.number, persona.kind.name, "left" if seat.has_left else "joining")
        self.session: str | None = None
        self.progress = 0
        """Episodes ended since the player joined, in this run of the command or an earlier one."""
        self._neighbours = neighbours
        self._outbox = Outbox(tally.fault)
        self._setbacks = 0
        self._loads = 0
        self._answers: list[int] = []
        self._last: tuple[tuple[str, int] | None, dict[str, Any]] = (None, {})
        tally.lines.append(self.line)
        self._load_page()

    async def play(self) -> None:
        """Return when the player is done, as far as its kind goes; StudyOverError when nobody can go on."""
        try:
            while not self.line.is_done:
                try:
                    where = await self._where()
                    await self._tell_rest()
                    await self._turn(where)
                except ConnectionLostError as error:
                    self._tally.lost += 1
                    self._set_back(str(error))
                    await self._find_server()
                except RequestRefusedError as refusal:
                    await self._refused(refusal)
        finally:
            await self._page.close()

    async def _where(self) -> dict[str, Any]:
        if self.seat.cookie is None:
            where = await self._page.join(self.seat.outside_ids or {}, self.persona.kind.name)
            self.seat.cookie = self._page.cookie
        else:
            where = await self._page.call("me")
        self.line.stage = where["stage"]
        self.progress = int(where["tutorial"]["done"]) + where["warm_up"]["done"] + where["ranked"]["done"]
        return where

    async def _turn(self, where: dict[str, Any]) -> None:
        """Do what is next at a stage."""
        page, stage = self._page, where["stage"]
        if stage == "consent":
            await self._read(where["consent"]["text"])
            await page.call("consent", {"version": where["consent"]["version"], "agree": True})
            await page.call("settings", {"modality": self.persona.modality, "palette": "mars", "keys": {}})
        elif stage == "instructions":
            await self._clock.wait(20_000)
            await page.call("advance", {"from": "instructions"})
        elif stage == "tutorial" and where["tutorial"]["done"]:
            await page.call("advance", {"from": "tutorial"})
        elif stage == "questions":
            await self._answer(where)
        elif stage in ("tutorial", "warm_up", "ranked"):
            await self._trial(where, stage)
        elif stage == "debrief":
            await self._debrief(where)
        elif stage == "complete":
            self.line.debrief, self.line.code = where["debrief"], where["debrief"]["completion_code"]
        self._setbacks = 0

    async def _read(self, text: str) -> None:
        """Return after the time it takes to read a text, four words a second."""
        await self._clock.wait(250.0 * len(text.split()))

    async def _answer(self, where: dict[str, Any]) -> None:
        """Answer the questions: the first choice, and after each wrong one the next."""
        questions = where["questions"]
        self._answers = self._answers or [0] * len(questions)
        await self._clock.wait(4000.0 * len(questions))
        found = await self._page.call("answers", {"answers": self._answers})
        for i, is_right in enumerate(found["right"] or []):
            if not is_right:
                self._answers[i] = (self._answers[i] + 1) % len(questions[i]["choices"])

    async def _trial(self, where: dict[str, Any], phase: str) -> None:
        """Play one episode, from where it stands; leave in the middle of it, or before it, if the time has come."""
        counts = where.get(phase, {})
        done, of = (0, 1) if phase == "tutorial" else (counts["done"], counts["of"])
        leaves = self.persona.leaves_after is not None and phase == "ranked" and done >= int(self.persona.leaves_after * of)
        if leaves and self.persona.withdraws:
            await self._page.call("withdraw", {})
            self._leave()
            return
        if where["break_due"]:
            await self._clock.wait(45_000)
        where = await self._page.call("next", {})
        self.session, frame = where["session"], where["about"]["frame"]
        self._check_resumed(frame, (phase, done))
        rule = Rule(frame["episode"], hides=phase == "ranked", shows_end=done + 1 == of)
        try:
            if await self._drive(rule, phase, done, STEPS_BEFORE_LEAVING if leaves else None):
                self.line.episodes[phase] += 1
        finally:
            self._outbox.add(rule.episode, self._hands.take())
        await self._outbox.tell(self._board)
        if leaves:
            self._leave()
            return
        await self._clock.wait(1500)

    def _leave(self) -> None:
        """Go for ever."""
        self.seat.has_left = True
        self.line.stage = "left"

    def _check_resumed(self, frame: dict[str, Any], place: tuple[str, int]) -> None:
        """Find a fault when an episode that ran has become another one, or has lost or gained moves."""
        was, seen = self._last
        if was == place and seen["outcome"] is None:
            who = f"player {self.persona.number}: {place[0]} {place[1]}"
            if frame["episode"] != seen["episode"]:
                self._tally.fault(f"{who} became another episode")
            elif not seen["step"] <= frame["step"] <= seen["step"] + 1:
                self._tally.fault(f"{who} went from move {seen['step']} to {frame['step']}")
        self._last = (place, frame)

    async def _drive(self, rule: Rule, phase: str, trial: int, until: int | None) -> bool:
        """Return True when the episode has ended, False after `until` moves."""
        assert self.session is not None
        kind, place = self.persona.kind, (phase, trial)
        nature, habits = self.persona.nature(phase, trial), self.persona.rng(9, self._loads, PHASES.index(phase), trial)
        cheats = Cheats(self._page, self._tally) if kind.cheats else None
        await self._board.show(self.session, rule)
        while (frame := self._board.frame)["outcome"] is None:
            self._last = (place, frame)
            if until is not None and frame["step"] >= until:
                return False
            if habits.random() < kind.pauses:
                await self._hands.idle(habits.uniform(61_000, 180_000), frame["step"])
            if habits.random() < kind.reloads:
                await self._tell_events(rule.episode)
                await self._reload(bool(habits.random() < 0.5))
                await self._board.show(self.session, rule)
                continue
            if cheats is not None:
                await cheats.maybe(self.session, frame, phase, self._other_session())
            await self._move(nature)
        self._last = (place, self._board.frame)
        return True

    def _other_session(self) -> str | None:
        """Return the session of somebody else in this study, None while there is none."""
        return next((each.session for each in self._neighbours if each is not self and each.session), None)

    async def _move(self, nature: Nature) -> None:
        """Make one move: think, press, see the frame, release."""
        board, hands = self._board, self._hands
        step, action = board.frame["step"], board.decide(nature)
        await hands.think(action)
        round_trip = await board.act(action, hands.press(action, step))
        if not board.is_refused:
            self._setbacks = 0
            self._tally.round_trips_ms.append(round_trip)
        await hands.release(action, board.frame["step"], round_trip)
        if len(hands.events) >= BATCH:
            await self._tell_events(board.frame["episode"])

    async def _tell_events(self, episode: str) -> None:
        self._outbox.add(episode, self._hands.take())
        await self._outbox.tell(self._board)

    async def _tell_rest(self) -> None:
        """Return when nothing is left of what a lost line did not bring."""
        if self.session is not None and not self._outbox.is_empty:
            await self._page.open(self.session)
            await self._outbox.tell(self._board)
            await self._page.close_socket()

    async def _debrief(self, where: dict[str, Any]) -> None:
        """Look at the first replay, then go on to the completion code."""
        if (where["debrief"] or {}).get("warm_up_terrains"):
            await self._page.call("debrief/0")
            await self._clock.wait(20_000)
        await self._page.call("advance", {"from": "debrief"})

    async def _reload(self, is_second_tab: bool) -> None:
        """Return on a fresh page; a second tab looks in for a moment, and the first one goes on."""
        self._tally.reloads += 1
        if is_second_tab and self.session is not None:
            other = Page(self.place.url, self.place.study, self.seat.cookie)
            try:
                await other.call("me")
                await other.open(self.session)
                await other.receive()
            finally:
                await other.close()
            return
        await self._page.close()
        self._load_page()
        await self._where()

    def _load_page(self) -> None:
        self._loads += 1
        self._clock = Clock(self.place.speed)
        self._hands = Hands(self.persona, self._clock, self.persona.rng(8, self._loads), self._tally)
        self._page = Page(self.place.url, self.place.study, self.seat.cookie)
        self._board = Board(self._page, self.place.radius, self._tally.fault)

    async def _find_server(self) -> None:
        """Return on a fresh page once the server answers; StudyOverError when it stays away."""
        waited, pause = 0.0, FIRST_RETRY_S
        await self._page.close()
        while True:
            await asyncio.sleep(pause)
            waited, pause = waited + pause, min(LONGEST_RETRY_S, 2 * pause)
            self._load_page()
            try:
                await self._page.ask("GET", "api/health")
                return
            except ConnectionLostError as error:
                await self._page.close()
                if waited > self.place.patience_s:
                    raise StudyOverError(
                        f"the server at {self.place.url} has been away for {waited:.0f} s ({error}); start it again, and go on "
                        "with the same --state FILE if you gave one"
                    ) from error

    async def _refused(self, refusal: RequestRefusedError) -> None:
        """Take a refusal: the study was closed, or things stand otherwise than thought (after a lost answer)."""
        if "closed" in refusal.detail:
            raise StudyOverError(f"the study {self.place.study!r} cannot go on: {refusal.detail}")
        self._set_back(refusal.detail)
        if refusal.status in (404, 422):
            raise StudyOverError(
                f"the server refused player {self.persona.number} at stage {self.line.stage!r}: {refusal.detail}"
            )
        await asyncio.sleep(0.05)

    def _set_back(self, why: str) -> None:
        """Count a refusal or a lost connection; StudyOverError after SETBACKS of them without any progress."""
        self._setbacks += 1
        if self._setbacks >= SETBACKS:
            raise StudyOverError(f"player {self.persona.number} gets no further at stage {self.line.stage!r}: {why}")
