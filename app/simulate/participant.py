"""A synthetic player in a study, from the link to the completion code.

Before each step the player asks `GET me` where it stands, and goes on there. So a reload, a lost connection and a stopped
server need no memory here, and the player's state cannot differ from the study's.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

from app.simulate.board import ScoreVisibility, SimulatedBoard
from app.simulate.cheating import Cheater
from app.simulate.client import ConnectionLostError, Page, RequestRefusedError
from app.simulate.input_device import SEND_AFTER_EVENTS, InputDevice, PageClock
from app.simulate.outbox import Outbox
from app.simulate.outcome_log import OutcomeLog, PlayerOutcome
from app.simulate.persona import PHASES, Persona, PlayStyle
from app.simulate.state_file import SavedPlayer

FIRST_RETRY_S, LONGEST_RETRY_S = 0.25, 2.0
"""The first and the longest wait between two attempts to reach the server again, as in the page."""
MAX_SETBACKS = 30
"""Refusals and lost connections without any progress after which a player gives up."""

STEPS_BEFORE_LEAVING = 3
"""Moves that a player makes in the episode in which it leaves for ever."""


class StudyOverError(Exception):
    """The study cannot go on for anybody; one sentence."""


@dataclass(frozen=True)
class PlaySettings:
    """Where a study is played, and how fast.

    radius      sensor radius of its protocol, cells
    speed       how many times faster than people
    patience_s  how long to wait for a server that has gone away
    """

    url: str
    study: str
    radius: int
    speed: float
    patience_s: float


class SimulatedParticipant:
    """One player in one study; `play` plays it to the end."""

    def __init__(
        self,
        persona: Persona,
        settings: PlaySettings,
        saved: SavedPlayer,
        log: OutcomeLog,
        neighbours: list[SimulatedParticipant],
    ) -> None:
        self.persona, self.settings, self.saved, self._log = persona, settings, saved, log
        self.outcome = PlayerOutcome(
            persona.number, persona.kind.name, "left" if saved.has_left else "joining"
        )
        self.session: str | None = None
        self.episodes_done = 0
        """Episodes ended since the player joined, in this run of the command or an earlier one."""
        self._neighbours = neighbours
        self._outbox = Outbox(log.add_fault)
        self._setback_count = 0
        self._loads = 0
        self._answers: list[int] = []
        self._last: tuple[tuple[str, int] | None, dict[str, Any]] = (None, {})
        log.players.append(self.outcome)
        self._load_page()

    async def play(self) -> None:
        """Play until the player is done, as far as its kind goes; StudyOverError when nobody can go on."""
        try:
            while not self.outcome.is_done:
                try:
                    progress = await self._fetch_progress()
                    await self._send_remaining_events()
                    await self._do_stage(progress)
                except ConnectionLostError as error:
                    self._log.lost_connections += 1
                    self._count_setback(str(error))
                    await self._wait_for_server()
                except RequestRefusedError as refusal:
                    await self._handle_refusal(refusal)
        finally:
            await self._page.close()

    async def _fetch_progress(self) -> dict[str, Any]:
        if self.saved.cookie is None:
            progress = await self._page.join(self.saved.outside_ids or {}, self.persona.kind.name)
            self.saved.cookie = self._page.cookie
        else:
            progress = await self._page.call("me")
        self.outcome.stage = progress["stage"]
        self.episodes_done = (
            int(progress["tutorial"]["done"])
            + progress["warm_up"]["done"]
            + progress["ranked"]["done"]
        )
        return progress

    async def _do_stage(self, progress: dict[str, Any]) -> None:
        """Do what is next at the stage where the player stands."""
        page, stage = self._page, progress["stage"]
        if stage == "consent":
            await self._wait_to_read(progress["consent"]["text"])
            await page.call("consent", {"version": progress["consent"]["version"], "agree": True})
            await page.call(
                "settings", {"modality": self.persona.modality, "palette": "mars", "keys": {}}
            )
        elif stage == "instructions":
            await self._clock.wait(20_000)
            await page.call("advance", {"from": "instructions"})
        elif stage == "tutorial" and progress["tutorial"]["done"]:
            await page.call("advance", {"from": "tutorial"})
        elif stage == "questions":
            await self._answer(progress)
        elif stage in ("tutorial", "warm_up", "ranked"):
            await self._play_trial(progress, stage)
        elif stage == "debrief":
            await self._debrief(progress)
        elif stage == "complete":
            self.outcome.debrief, self.outcome.code = (
                progress["debrief"],
                progress["debrief"]["completion_code"],
            )
        self._setback_count = 0

    async def _wait_to_read(self, text: str) -> None:
        """Wait for the time it takes to read a text, four words a second."""
        await self._clock.wait(250.0 * len(text.split()))

    async def _answer(self, progress: dict[str, Any]) -> None:
        """Answer the questions: the first choice, and after each wrong one the next."""
        questions = progress["questions"]
        self._answers = self._answers or [0] * len(questions)
        await self._clock.wait(4000.0 * len(questions))
        found = await self._page.call("answers", {"answers": self._answers})
        for i, is_right in enumerate(found["right"] or []):
            if not is_right:
                self._answers[i] = (self._answers[i] + 1) % len(questions[i]["choices"])

    async def _play_trial(self, progress: dict[str, Any], phase: str) -> None:
        """Play the next episode of a phase; leave in the middle of it, or before it, when it is time for that."""
        counts = progress.get(phase, {})
        done, of = (0, 1) if phase == "tutorial" else (counts["done"], counts["of"])
        leaves = (
            self.persona.leaves_after is not None
            and phase == "ranked"
            and done >= int(self.persona.leaves_after * of)
        )
        if leaves and self.persona.withdraws:
            await self._page.call("withdraw", {})
            self._leave()
            return
        if progress["break_due"]:
            await self._clock.wait(45_000)
        progress = await self._page.call("next", {})
        self.session, frame = progress["session"], progress["about"]["frame"]
        self._check_resumed(frame, (phase, done))
        visibility = ScoreVisibility(
            frame["episode"], hides_scores=phase == "ranked", shows_final_score=done + 1 == of
        )
        try:
            if await self._play_to_end(
                visibility, (phase, done), STEPS_BEFORE_LEAVING if leaves else None
            ):
                self.outcome.episodes[phase] += 1
        finally:
            self._outbox.add(visibility.episode, self._device.take_events())
        await self._outbox.send_all(self._board)
        if leaves:
            self._leave()
            return
        await self._clock.wait(1500)

    def _leave(self) -> None:
        """Leave the study for ever."""
        self.saved.has_left = True
        self.outcome.stage = "left"

    def _check_resumed(self, frame: dict[str, Any], trial: tuple[str, int]) -> None:
        """Add a fault when the running episode has become another one, or has lost or gained moves."""
        was, seen = self._last
        if was == trial and seen["outcome"] is None:
            who = f"player {self.persona.number}: {trial[0]} {trial[1]}"
            if frame["episode"] != seen["episode"]:
                self._log.add_fault(f"{who} became another episode")
            elif not seen["step"] <= frame["step"] <= seen["step"] + 1:
                self._log.add_fault(f"{who} went from move {seen['step']} to {frame['step']}")
        self._last = (trial, frame)

    async def _play_to_end(
        self, visibility: ScoreVisibility, trial: tuple[str, int], until: int | None
    ) -> bool:
        """Play the episode on; return True when it has ended, False after `until` moves."""
        assert self.session is not None
        kind, (phase, number) = self.persona.kind, trial
        style, habits = (
            self.persona.style(phase, number),
            self.persona.rng(9, self._loads, PHASES.index(phase), number),
        )
        cheater = Cheater(self._page, self._log) if kind.cheats else None
        await self._board.show(self.session, visibility)
        while (frame := self._board.frame)["outcome"] is None:
            self._last = (trial, frame)
            if until is not None and frame["step"] >= until:
                return False
            if habits.random() < kind.pauses:
                await self._device.idle(habits.uniform(61_000, 180_000), frame["step"])
            if habits.random() < kind.reloads:
                await self._send_events(visibility.episode)
                await self._reload(bool(habits.random() < 0.5))
                await self._board.show(self.session, visibility)
                continue
            if cheater is not None:
                await cheater.try_all_when_due(self.session, frame, phase, self._other_session())
            await self._move(style)
        self._last = (trial, self._board.frame)
        return True

    def _other_session(self) -> str | None:
        """Return the session of somebody else in this study, None while there is none."""
        return next(
            (each.session for each in self._neighbours if each is not self and each.session), None
        )

    async def _move(self, style: PlayStyle) -> None:
        """Make one move: decide, press the key, wait for the frame, release the key."""
        board, device = self._board, self._device
        step, action = board.frame["step"], board.decide(style)
        await device.wait_to_decide(action)
        round_trip = await board.act(action, device.press(action, step))
        if not board.is_refused:
            self._setback_count = 0
            self._log.round_trips_ms.append(round_trip)
        await device.release(action, board.frame["step"], round_trip)
        if len(device.events) >= SEND_AFTER_EVENTS:
            await self._send_events(board.frame["episode"])

    async def _send_events(self, episode: str) -> None:
        self._outbox.add(episode, self._device.take_events())
        await self._outbox.send_all(self._board)

    async def _send_remaining_events(self) -> None:
        """Send the events that a lost connection did not deliver."""
        if self.session is not None and not self._outbox.is_empty:
            await self._page.open(self.session)
            await self._outbox.send_all(self._board)
            await self._page.close_socket()

    async def _debrief(self, progress: dict[str, Any]) -> None:
        """Fetch the first replay, then go on to the completion code."""
        if (progress["debrief"] or {}).get("warm_up_terrains"):
            await self._page.call("debrief/0")
            await self._clock.wait(20_000)
        await self._page.call("advance", {"from": "debrief"})

    async def _reload(self, is_second_tab: bool) -> None:
        """Reload the page, or open the study in a second tab for a moment and go on in the first one."""
        self._log.reloads += 1
        if is_second_tab and self.session is not None:
            other = Page(self.settings.url, self.settings.study, self.saved.cookie)
            try:
                await other.call("me")
                await other.open(self.session)
                await other.receive()
            finally:
                await other.close()
            return
        await self._page.close()
        self._load_page()
        await self._fetch_progress()

    def _load_page(self) -> None:
        self._loads += 1
        self._clock = PageClock(self.settings.speed)
        self._device = InputDevice(
            self.persona, self._clock, self.persona.rng(8, self._loads), self._log
        )
        self._page = Page(self.settings.url, self.settings.study, self.saved.cookie)
        self._board = SimulatedBoard(self._page, self.settings.radius, self._log.add_fault)

    async def _wait_for_server(self) -> None:
        """Wait until the server answers and load the page anew; StudyOverError when it stays away."""
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
                if waited > self.settings.patience_s:
                    raise StudyOverError(
                        f"the server at {self.settings.url} has been away for {waited:.0f} s ({error}); start it again, and "
                        "go on with the same --state FILE if you gave one"
                    ) from error

    async def _handle_refusal(self, refusal: RequestRefusedError) -> None:
        """Handle a refusal: the study was closed, or an answer was lost and the player stands elsewhere."""
        if "closed" in refusal.detail:
            raise StudyOverError(
                f"the study {self.settings.study!r} cannot go on: {refusal.detail}"
            )
        self._count_setback(refusal.detail)
        if refusal.status in (404, 422):
            raise StudyOverError(
                f"the server refused player {self.persona.number} at stage {self.outcome.stage!r}: {refusal.detail}"
            )
        await asyncio.sleep(0.05)

    def _count_setback(self, why: str) -> None:
        """Count a refusal or a lost connection; StudyOverError after MAX_SETBACKS of them without any progress."""
        self._setback_count += 1
        if self._setback_count >= MAX_SETBACKS:
            raise StudyOverError(
                f"player {self.persona.number} gets no further at stage {self.outcome.stage!r}: {why}"
            )
