"""One board: its running episode, its record in the store, its only way to move.

Every move goes through `Session.act`, or `Session.tick` on a board with a clock. The move must
answer the current frame. Then it is held, recorded and told: the run is taken off the board and
steps; the store commits; only then the run comes back and its frame is published. Meanwhile
everybody sees the frame that was published last. A move that cannot be committed did not happen:
its run does not come back, and the next move starts from a replay.

`Channel` holds the newest frame for any number of subscribers. Nothing is queued: a slow one gets
the newest frame and never sees those between.

All of it runs on one event loop, so there are no locks between threads. `Session.changing` keeps
two changes of one episode apart.
"""

from __future__ import annotations

import asyncio
import dataclasses
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from types import TracebackType
from typing import Literal, Self, cast
from weakref import WeakSet

from humanplay.board.attestation import AttestationResult, Ending, level_reaches
from humanplay.board.charges import Charges, most_bytes, stored_bytes
from humanplay.board.clock import TAKES_KEYS, BoardClock
from humanplay.board.controls import PAUSE_MS, ClockLimits, Controls, HeldKeys
from humanplay.board.input_log import InputLog
from humanplay.board.messages import Events, Pace, RepeatProgress
from humanplay.board.participation import HUMAN, SCRIPT, Participation, RefusedError
from humanplay.db.input_events import EVENT_BYTES, TOO_MANY_EVENTS, batch_bytes
from humanplay.db.store import Notice, SessionRow, StepRow, Store, StoreError, Trial
from humanplay.task import (
    AgentObservation,
    Run,
    RunElsewhere,
    RunEndedError,
    Task,
    View,
    not_allowed,
    on_threads,
)
from humanplay.task.sentences import Sentence, sentence_of

SessionKind = Literal["ranked", "practice", "challenge", "watch", "daily", "study"]
"""What an episode on a board is.

ranked     played by a person alone, on a terrain that the server drew: it may count
practice   beside a policy, on a terrain that was chosen, or moved by a script
challenge  by a person, on the terrain of a finished episode and against its result
watch      by a policy
daily      by a person, on the day's terrain
study      by a participant
"""

NOT_STORED = Sentence(
    "board.not_stored",
    "the key press before this move could not be recorded: nothing has changed; press again in a moment",
)


@dataclass(frozen=True)
class Move:
    """A move as asked for, and who drives: "human", "script" or "policy:NAME"."""

    episode: str
    step: int
    action: int
    driver: str
    input: Literal["key", "touch"] | None = None
    key_down_ms: float | None = None
    key_up_ms: float | None = None
    client_ms: float | None = None

    def row(self, reward: float, discovered: int, server_ms: int) -> StepRow:
        """The move as it is stored, with what came of it."""
        return StepRow(
            episode_id=self.episode,
            step=self.step,
            action=self.action,
            reward=reward,
            discovered=discovered,
            server_ms=server_ms,
            client_ms=self.client_ms,
            key_down_ms=self.key_down_ms,
            key_up_ms=self.key_up_ms,
            input=self.input,
            driver=self.driver,
        )


class Channel:
    """Holds the newest frame, encoded, and wakes those who listen when it changes.

    Args:
        count_dropped: Called whenever a frame is replaced before a subscriber got it.
    """

    def __init__(self, count_dropped: Callable[[], None] = lambda: None) -> None:
        self.frame = ""
        self._count_dropped = count_dropped
        self._subscribers: WeakSet[Subscriber] = WeakSet()
        self._listeners: dict[int, Callable[[], None]] = {}
        self._listeners_added = 0

    @property
    def subscribers(self) -> int:
        """How many subscribers there are now."""
        return len(self._subscribers)

    def publish(self, frame: str) -> None:
        """Replace the frame and wake everybody."""
        for subscriber in self._subscribers:
            if subscriber.is_behind:
                self._count_dropped()
            subscriber.is_behind = True
        self.frame = frame
        self.notify()

    def notify(self) -> None:
        """Wake everybody without a new frame: something beside it (the pace) has changed."""
        for subscriber in list(self._subscribers):
            subscriber.wake()
        for listener in list(self._listeners.values()):
            listener()

    def subscribe(self) -> Subscriber:
        """A new subscriber; close it, use it as a context manager, or simply drop it."""
        subscriber = Subscriber(self)
        self._subscribers.add(subscriber)
        return subscriber

    def unsubscribe(self, subscriber: Subscriber) -> None:
        """Forget the subscriber; a second call changes nothing."""
        self._subscribers.discard(subscriber)

    def add_listener(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call `listener` at each wake; it does not count as a subscriber.

        Returns:
            A function that removes it.
        """
        self._listeners_added += 1
        number = self._listeners_added
        self._listeners[number] = listener

        def remove() -> None:
            self._listeners.pop(number, None)

        return remove


class Subscriber:
    """Yields the present frame at once, then the newest after each wake.

    Use it as `async for frame in channel.subscribe()`.

    Attributes:
        is_behind: Whether there is a frame that it has not yielded yet.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._closed = False
        self.is_behind = bool(channel.frame)
        self._woken = asyncio.Event()
        if channel.frame:
            self._woken.set()

    def wake(self) -> None:
        """Let the next `anext` return."""
        self._woken.set()

    def close(self) -> None:
        """End the iteration and leave the channel."""
        self._closed = True
        self._channel.unsubscribe(self)
        self._woken.set()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> str:
        await self._woken.wait()
        if self._closed:
            raise StopAsyncIteration
        self._woken.clear()
        self.is_behind = False
        return self._channel.frame

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class ServerTime:
    """A server time in ms that never runs backwards, even if the system clock does.

    Args:
        system_ms: Reads the system clock, in milliseconds since 1970.
    """

    def __init__(self, system_ms: Callable[[], int]) -> None:
        self._system_ms = system_ms
        self._newest_ms = self._read_ms = self._ahead_ms = 0

    def begin(self, newest_ms: int) -> None:
        """Start from the newest time that the episode has."""
        self._newest_ms = self._read_ms = newest_ms
        self._ahead_ms = 0

    def now_ms(self) -> int:
        """Read the time."""
        read_ms = self._system_ms()
        # if the system clock was set back, add as much to every later reading
        self._ahead_ms += max(0, self._read_ms - read_ms)
        self._read_ms = read_ms
        self._newest_ms = max(self._newest_ms, read_ms + self._ahead_ms)
        return self._newest_ms

    def move_past(self, at_ms: int) -> None:
        """Make the next reading later than a time."""
        self._newest_ms = max(self._newest_ms, at_ms + 1)


class Session:
    """One board: its row in the store, its running episode, its input log.

    Args:
        row: The board as the store has it.
        system_ms: Reads the system clock, in milliseconds since 1970.

    Attributes:
        task: What is played on it.
        pace: How the policy that drives it moves; None for a person's board.
        number: Of the current episode, counting from 1; 0 before the first.
        current: The current episode.
        shown: The episode as it was published last. All that anybody learns of it comes from here.
        participation: The participant's, for a board of a study; else None.
        fault: One sentence when the policy that drives it has failed, else None.
        remade: How far a lost environment has repeated its moves; None if none was lost.
        paired_with: The board shown with it on the same terrain (a rival's, its player's, a
            replay's), else None.
        is_second: Whether it is the second of the two: a rival's or a replay's.
        attestation: The attestation of the current episode once it has ended here, else None.
        clock: The clock of a person's board whose task has one, else None.
        inputs: The input events of its current episode.
        changing: Held from the check of a change of the episode or its input events until the
            change is committed.
    """

    def __init__(
        self,
        row: SessionRow,
        task: Task,
        store: Store,
        system_ms: Callable[[], int],
        charges: Charges,
        participation: Participation | None = None,
    ) -> None:
        self.id, self.task = row.id, task
        self.participation = participation
        self.row = row
        self.channel = Channel(store.metrics.dropped_frames.inc)
        pace = Pace(mode=row.pace_mode, moves_per_second=row.moves_per_second)
        self.pace = pace if self.has_policy else None
        self.number = 0
        self.fault: str | None = None
        self.remade: RepeatProgress | None = None
        self.attestation: AttestationResult | None = None
        self.changing = asyncio.Lock()
        self.current: Trial
        self.shown: View
        self._run: Run | None = None
        """The episode at the view `shown`. None while a move is being recorded, and after a move
        that could not be."""
        self._hides_scores = False
        self.paired_with: Session | None = None
        self.is_second = row.rival_of is not None
        self._store = store
        self._charges = charges
        self._time = ServerTime(system_ms)
        ticks_per_second = None if self.has_policy else task.clock
        self.clock: BoardClock | None = None
        if ticks_per_second is not None:
            self.clock = BoardClock(self, ticks_per_second)
        self.inputs = InputLog(row, task, store, participation)
        self._controls: Controls
        """The keys that apply. `load_keys` reads them when the clock starts, `tick` uses them."""

    @property
    def has_policy(self) -> bool:
        """Whether a policy drives this board; else a person or a script does."""
        return self.row.driver_name != HUMAN

    @property
    def episode(self) -> str:
        """The id of the current episode."""
        return self.current.id

    @property
    def frame(self) -> str:
        """The newest frame, encoded."""
        return self.channel.frame

    @property
    def kind(self) -> SessionKind:
        """What the board's current episode is."""
        if self.has_policy:
            return "watch"
        if self.participation is not None:
            return "study"
        if self.current.day is not None:
            return "daily"
        if self.row.challenges is not None:
            return "challenge"
        is_drawn = not (self.current.assisted or self.current.seed_chosen)
        return "ranked" if is_drawn and self.inputs.is_persons else "practice"

    @property
    def counts(self) -> bool:
        """Whether the episode counts for the volunteers' estimate.

        A running episode counts as long as nothing speaks against it.
        """
        episode = self.current
        if self.kind != "ranked" or episode.driver != HUMAN or episode.terrain_met_before:
            return False
        level = None if self.attestation is None else self.attestation.level
        return level is None or level_reaches(level, "attested")

    @property
    def study(self) -> str:
        """The name of the study whose board it is; "" for none."""
        return "" if self.participation is None else self.participation.study

    @property
    def driver(self) -> str:
        """Who drives an episode at its start: "human", "script" or "policy:NAME"."""
        if self.participation is not None:
            return self.participation.driver
        return f"policy:{self.row.driver_name}" if self.has_policy else HUMAN

    async def act(self, move: Move, notice: Notice | None = None) -> None:
        """Make a move, commit it and publish its frame.

        After RefusedError or StoreError nothing has changed.

        Args:
            notice: Called with one sentence when the move has waited for the database for a while.
        """
        async with self.changing:
            self._check_current(move.episode, move.step)
            if self.has_policy and move.driver in (HUMAN, SCRIPT):
                raise RefusedError(
                    f"this board is driven by the policy {self.row.driver_name!r}; only its pace can be changed"
                )
            if self.clock is not None and move.driver == HUMAN:
                raise RefusedError(TAKES_KEYS)
            allowed = self.shown.allowed
            # a policy may try what is not allowed: the environment answers it
            if (
                allowed is not None
                and move.action not in allowed
                and move.driver in (HUMAN, SCRIPT)
            ):
                raise RefusedError(not_allowed(self.task.actions, allowed, move.action))
            await self._make(move, self.now_ms(), notice)

    async def agent_observation(
        self, picture: bool, observation: bool
    ) -> tuple[View, AgentObservation]:
        """The newest frame's view, and what an agent may see of it.

        Args:
            picture, observation: What `humanplay.task.Run.agent_observation` is asked for.
        """
        async with self.changing:
            run = await self._take_run()
            seen_by_agent = await on_threads(self.task, run.agent_observation, picture, observation)
            self._run = run
            return self.shown, seen_by_agent

    async def tick(self, held: HeldKeys) -> None:
        """Make the move that follows from the keys that are held.

        It is committed together with others' ticks, then its frame is published.
        """
        async with self.changing:
            if self.clock is None or self.clock.is_standing:
                return
            try:
                self._check_current(self.current.id, self.shown.steps)
                before = self.shown.actions[-1] if self.shown.steps else 0
                action, input = self._controls.action(held.down, before, self.shown.allowed)
                driver = self.driver if held.is_trusted else SCRIPT
                move = Move(self.current.id, self.shown.steps, action, driver, input)
                # an event belongs to the ticks after it: no tick has the time of an event before it
                self._time.move_past(self.inputs.newest_ms)
                # boards that tick beside many others wait a moment, and share a commit with them
                commit_at_once = not self.clock.shares_commits
                await self._make(move, self.now_ms(), commit_at_once=commit_at_once)
            except RefusedError as refusal:
                self.clock.stand(sentence_of(refusal))

    async def load_keys(self) -> HeldKeys:
        """What is down by the stored input events; hold `changing`.

        It also reads the keys that apply, for the ticks that follow.
        """
        self._controls, keys = await self.inputs.load_keys(self.current.id)
        return keys

    async def end_if_left(self) -> None:
        """End the episode as left if its board stood still too often or too long."""
        async with self.changing:
            participation = self.participation
            limits = ClockLimits() if participation is None else participation.clock_limits
            # the stop lasts until the first tick, which comes after a countdown of PAUSE_MS
            until_ms = self.now_ms() + PAUSE_MS
            read = partial(self._store.pauses, self.current.id, PAUSE_MS, until_ms)
            number, paused_ms = await self._store.read(read)
            if number > limits.pauses or paused_ms > limits.paused_s * 1000:
                note = None
                if participation is not None:
                    note = partial(participation.note_stopped, self.current.id)
                await self._end_here(await self.take_abandoned(), note)

    async def _make(
        self, move: Move, at_ms: int, notice: Notice | None = None, commit_at_once: bool = True
    ) -> None:
        """Make a move that may be made, commit it and publish its frame; hold `changing`.

        Args:
            commit_at_once: Whether the commit is due now; else it may wait a moment for others.
        """
        started_s = time.perf_counter()
        current = self.current
        is_deviation = move.driver == SCRIPT and current.driver == HUMAN
        if is_deviation:
            current = dataclasses.replace(current, driver=SCRIPT)
        # hold: while the run is off the board, everybody sees the frame before the move
        run = await self._take_run()
        try:
            reward, view = await self._step_run(run, move.action)
        except RunEndedError as failure:
            note = partial(self._store.note_failure, current.id, failure.report)
            await self._end_here(run, note)
            raise RefusedError(sentence_of(failure)) from failure
        step_row = move.row(reward, view.discovered, at_ms)
        ending = await self.inputs.prepare_end(current, run, step_row) if view.ended else None

        # record: the press was queued before the move, so both are in one commit
        def record() -> tuple[AttestationResult | None, bool]:
            # without its press a person's move would look like a script's
            if self.inputs.is_incomplete:
                raise StoreError(NOT_STORED)
            # nearly every move: one statement, without a transaction around it
            if not is_deviation and not view.ended:
                self._store.add_step(step_row)
                return None, self._hides_scores
            with self._store.transaction():
                if is_deviation and self.participation is not None:
                    self.participation.note_script(current.id)
                self._store.add_step(step_row)
                attestation = self._close(current, run, at_ms, ending) if view.ended else None
            return attestation, self.hides_scores(current.id)

        # tell: only after the commit
        def publish(recorded: tuple[AttestationResult | None, bool]) -> None:
            self.go_on(current, run, view, *recorded)
            if view.ended:
                self.charge(current, view.steps, ending)
            metrics, seconds = self._store.metrics, time.perf_counter() - started_s
            metrics.moves[move.driver.partition(":")[0]].inc()
            metrics.step.observe(seconds)
            metrics.newest_s.append(seconds)

        await self._store.writes.put(record, notice, publish, commit_at_once)

    async def abandon(
        self, episode: str, step: int | None, note: Callable[[], None] | None = None
    ) -> None:
        """Abandon the running episode for good and publish its last frame.

        Args:
            step: The frame to abandon at. None for the newest one; a board with a clock always
                abandons at the newest.
            note: Called in the same transaction.
        """
        async with self.changing:
            if step is None or self.clock is not None:
                step = self.shown.steps
            self._check_current(episode, step)
            await self._end_here(await self.take_abandoned(), note)

    async def _step_run(self, run: Run, action: int) -> tuple[float, View]:
        """Make a move of a run that was taken off the board: its reward and new view."""

        def step() -> tuple[float, View]:
            return run.step(action), run.view()

        if self.task.steps_on is None:
            return step()
        elsewhere, loop = cast(RunElsewhere, run), asyncio.get_running_loop()
        if await elsewhere.ask(action):
            return step()
        # its process was lost: repeating the moves before this one takes too long for the event loop
        elsewhere.tell = lambda *progress: loop.call_soon_threadsafe(self._tell_progress, *progress)
        return await on_threads(self.task, step)

    def _tell_progress(self, done: int, of: int) -> None:
        """Tell the page how many of the moves a new process has repeated."""
        self.remade = RepeatProgress(episode=self.current.id, done=done, of=of)
        self.notify()

    async def _end_here(self, run: Run, note: Callable[[], None] | None = None) -> None:
        """End the episode for good, without a move, and publish its last frame.

        Hold `changing`.

        Args:
            run: As it has ended.
            note: Called in the same transaction.
        """
        current, at_ms = self.current, self.now_ms()
        ending = await self.inputs.prepare_end(current, run)

        def record() -> tuple[AttestationResult | None, bool]:
            with self._store.transaction():
                if note is not None:
                    note()
                attestation = self._close(current, run, at_ms, ending)
            return attestation, self.hides_scores(current.id)

        def publish(recorded: tuple[AttestationResult | None, bool]) -> None:
            self.go_on(current, run, run.view(), *recorded)
            self.charge(current, self.shown.steps, ending)

        await self._store.write(record, then=publish)

    def now_ms(self) -> int:
        """The time in the current episode, ms since 1970: it never runs backwards."""
        return self._time.now_ms()

    def begin(
        self,
        episode: Trial,
        run: Run,
        hides_scores: bool,
        newest_ms: int = 0,
        batches: Iterable[str] = (),
    ) -> None:
        """Put an episode that the store holds on the board and publish its frame.

        Args:
            newest_ms: Time of its newest move or input event.
            batches: Ids of the batches of input events that it has.
        """
        newest_ms = max(episode.started_ms, newest_ms)
        self.inputs.begin(newest_ms, batches)
        self._time.begin(newest_ms)
        self.number, self.fault = episode.number, None
        shown = run.view()
        if not shown.ended:
            self._charges.open(episode.id, self.study, most_bytes(episode, self.inputs.is_persons))
        self.go_on(episode, run, shown, None, hides_scores)

    def go_on(
        self,
        current: Trial,
        run: Run,
        shown: View,
        attestation: AttestationResult | None,
        hides_scores: bool,
    ) -> None:
        """Put a run on the board as the store holds it now, and publish its frame.

        Args:
            attestation: The episode's, if it has ended.
        """
        self.current, self._run, self.shown = current, run, shown
        self.attestation, self._hides_scores = attestation, hides_scores
        self.remade = None
        if self.clock is not None and (shown.ended or self.clock.state.episode != current.id):
            self.clock.stand(tells_anyway=True)
        self.channel.publish(shown.frame(current.id, hides_scores))

    async def take_abandoned(self) -> Run:
        """Take the run off the board and abandon it; call it with `changing` locked.

        `go_on` puts it back once its end is recorded.
        """
        run = await self._take_run()
        run.abandon()
        return run

    async def _take_run(self) -> Run:
        """Take the run off the board; hold `changing`.

        `go_on` puts it back once its move is recorded. A caller that fails leaves it off.
        """
        run, self._run = self._run, None
        if run is not None:
            return run
        # the last move was not recorded: only a replay is where the board is
        return await on_threads(self.task, self.task.replay, self.current, self.shown.actions)

    def hides_scores(self, episode_id: str) -> bool:
        """Whether frames of an episode leave out its scores.

        Call it in `Store.write` or `Store.read`.
        """
        return self.participation is not None and self.participation.hides_scores(episode_id)

    def history(self) -> str:
        """The path so far, encoded."""
        return self.shown.history(self.current.id, self._hides_scores)

    async def keep_events(self, events: Events) -> None:
        """Store input events of an episode of this board, each once.

        The next move need not wait: it is written behind them, with the same commit.

        Raises:
            RefusedError: If the board accepts no input events for it.
        """
        async with self.changing:
            is_running = events.episode == self.current.id and not self.shown.ended
            if self.inputs.is_persons and not is_running:
                if self._charges.is_full(self.study):
                    raise RefusedError(TOO_MANY_EVENTS)
                self._charges.add(self.study, batch_bytes(len(events.events), events.batch))
            writing = self.inputs.write(events, self.now_ms(), self.current)
            if self.clock is not None and is_running:
                # a batch sent again after a lost connection must not move the clock twice
                is_new = self.inputs.remember_batch(events.batch)
                if is_new:
                    self.clock.take(events.events)
        try:
            await asyncio.shield(writing)
        except (StoreError, RefusedError):
            self.inputs.drop(events.batch)
            if self.clock is not None:
                self.clock.stand(NOT_STORED)  # it goes on by the events that are stored
            raise

    def charge(self, episode: Trial, steps: int, ending: Ending | None) -> None:
        """Charge what an ended episode has stored instead of the most that it could."""
        event_bytes = 0 if ending is None else ending.events.until * EVENT_BYTES
        self._charges.close(episode.id, stored_bytes(episode, steps, event_bytes))

    def pair_with(self, second: Session) -> None:
        """Show `second`, a rival's board or a replay's, with this one from now on."""
        second.paired_with, second.is_second = self, True
        self.paired_with = second
        self.notify()

    def unpair(self) -> None:
        """Show no board with this one; the other board stays paired with it."""
        self.paired_with = None

    async def set_pace(self, pace: Pace) -> None:
        """Store the pace, forget a failure of the policy, and notify subscribers."""

        def change(_: None) -> None:
            self.fault, self.pace = None, pace
            self.notify()

        set_pace = partial(self._store.set_pace, self.id, pace.mode, pace.moves_per_second)
        await self._store.write(set_pace, then=change)

    def notify(self) -> None:
        """Wake whoever looks at the board, without a new frame."""
        self.channel.notify()

    def fail(self, fault: str) -> None:
        """Keep the policy's failure, one sentence, and notify subscribers."""
        self.fault = fault
        self.notify()

    def _close(
        self, current: Trial, run: Run, at_ms: int, ending: Ending | None
    ) -> AttestationResult | None:
        """Close an ended episode in the store; call it in a transaction.

        Returns:
            Its attestation; None for a policy's.
        """
        closing, attestation = self.inputs.closing(current, run, at_ms, ending)
        self._store.next_episode([closing], ())
        if self.participation is not None:
            self.participation.note_end()
        return attestation

    def _check_current(self, episode: str, step: int) -> None:
        if self.participation is not None:
            self.participation.check_open()
        if episode != self.current.id:
            raise RefusedError(f"episode {episode!r} is not the current one, {self.current.id!r}")
        if self.shown.ended:
            raise RefusedError(f"the episode has ended ({self.shown.outcome}); begin the next one")
        if step != self.shown.steps:
            raise RefusedError(f"step {step} is not the current one, which is {self.shown.steps}")
