"""The input events of one board: the keys and touches that its page reports.

A page sends the events before the moves that they cause, and they are stored first. At the end of
an episode its moves are compared with them (`humanplay.board.attestation`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from functools import partial

from humanplay.board.attestation import (
    AttestationResult,
    Conditions,
    Ending,
    attest_stored,
    key_map_of,
    prepare_end,
)
from humanplay.board.charges import event_room
from humanplay.board.controls import Controls, HeldKeys, controls_of
from humanplay.board.messages import KEY_CODES, UNIDENTIFIED, Events
from humanplay.board.participation import HUMAN, Participation, RefusedError
from humanplay.db.input_events import (
    InputEventRow,
    PageLoad,
    TooManyEventsError,
    add_input_events,
    input_events,
)
from humanplay.db.rows import EventRow, PlayerSettings
from humanplay.db.store import Closing, SessionRow, StepRow, Store
from humanplay.db.trial import Trial
from humanplay.task import Run, Task


class InputLog:
    """The input events of a board's current episode; hold `changing` for every call.

    Attributes:
        is_persons: Whether a move of the board can be a person's, so that events are stored.
        is_incomplete: Whether a batch could not be stored: a move without its press would be
            held against the person.
        newest_ms: Server time of the newest batch.
    """

    def __init__(
        self, board: SessionRow, task: Task, store: Store, participation: Participation | None
    ) -> None:
        self._board, self._task, self._store = board, task, store
        self._participation = participation
        is_human = board.driver_name == HUMAN
        self.is_persons = is_human and (board.control == "cookie" or participation is not None)
        self._has_clock = is_human and task.clock is not None
        self.is_incomplete = False
        self.newest_ms = 0
        self._batches = set[str]()
        self._writing: asyncio.Future[None] | None = None

    def begin(self, newest_ms: int, batches: Iterable[str]) -> None:
        """Go on with the events that an episode has.

        Args:
            newest_ms: Server time of its newest move or event.
            batches: The ids of its batches.
        """
        self.newest_ms = newest_ms
        self._batches = {*batches}

    def remember_batch(self, batch: str) -> bool:
        """Remember a batch. True if it comes for the first time."""
        is_new = batch not in self._batches
        self._batches.add(batch)
        return is_new

    def write(self, events: Events, at_ms: int, episode: Trial) -> asyncio.Future[None]:
        """Have a batch written, before the next move and with the same commit.

        Args:
            at_ms: When it came, server's time.
            episode: The current one, whose moves the events may cause.
        """
        # until it is stored: the writes that follow must not miss it
        self.is_incomplete = True
        self.newest_ms = at_ms
        work = partial(self._write, events, at_ms, episode)
        self._writing = self._store.put_write(work, undone=self._note_undone)
        return self._writing

    def drop(self, batch: str) -> None:
        """Forget a batch that was not stored, so that it may come again."""
        self._batches.discard(batch)

    async def load_keys(self, episode: str) -> tuple[Controls, HeldKeys]:
        """The keys that apply now, and what is down by the stored events."""
        await self._wait_for_batch()

        def read() -> tuple[list[EventRow], list[PlayerSettings]]:
            study = self._participation
            return input_events(self._store, episode), study.settings() if study else []

        events, settings = await self._store.read(read)
        keys = HeldKeys()
        for event in events:
            keys.take_row(event)
        return controls_of(self._task, settings)[-1], keys

    async def prepare_end(
        self, episode: Trial, run: Run, last: StepRow | None = None
    ) -> Ending | None:
        """Compare an episode with its input events before it ends.

        There may be 50,000 events. On the thread of the writes that would take long, and
        everybody's moves wait for that thread.

        Args:
            run: The episode as it has ended.
            last: The move that ends it; None if it is abandoned.

        Returns:
            None if the board is a policy's.
        """
        if self._board.driver_name != HUMAN:
            return None
        # an event that is stored after the comparison would have to be compared on the thread of the writes
        await self._wait_for_batch()

        def prepare() -> Ending:
            row = None if last is None else last.row()
            return prepare_end(self._store, episode.id, self._conditions(episode, run), row)

        return await self._store.read(prepare)

    def closing(
        self, episode: Trial, run: Run, at_ms: int, ending: Ending | None
    ) -> tuple[Closing, AttestationResult | None]:
        """What closes an ended episode, and its attestation; call it in `Store.write`.

        Args:
            ending: What `prepare_end` returned.
        """
        conditions = self._conditions(episode, run)
        attestation = None
        if conditions is not None:
            attestation = attest_stored(self._store, episode.id, conditions, ending)
        level = None if attestation is None else attestation.level
        reason = None if attestation is None else attestation.reason
        events = None if ending is None else ending.events
        return Closing(episode.id, run.record(), at_ms, level, reason, events), attestation

    async def _wait_for_batch(self) -> None:
        """Wait for the newest batch."""
        if self._writing is not None:
            await asyncio.wait([self._writing])

    def _write(self, events: Events, at_ms: int, episode: Trial) -> None:
        try:
            self._add(events, at_ms, episode)
        except RefusedError:
            # moves that follow do not depend on a refused batch; with a clock, ticks have used its keys
            self.is_incomplete = self._has_clock and self.is_persons
            raise
        self.is_incomplete = False

    def _note_undone(self) -> None:
        self.is_incomplete = True

    def _add(self, events: Events, at_ms: int, episode: Trial) -> None:
        self._check_board(events.episode)
        unknown = self._unknown_codes(events)
        rows = [InputEventRow(**event.model_dump()) for event in events.events]
        rows = [row._replace(code=UNIDENTIFIED) if row.code in unknown else row for row in rows]
        page_load = PageLoad(events.page_load, events.tab)
        room = event_room(episode) if self.is_persons else 0
        try:
            add_input_events(
                self._store, events.episode, rows, at_ms, events.batch, page_load, room
            )
        except TooManyEventsError as error:
            raise RefusedError(str(error)) from None

    def _check_board(self, episode_id: str) -> None:
        """Raise RefusedError if no events of the episode are stored."""
        if self._participation is not None:
            self._participation.check_events(episode_id)
        elif self._board.driver_name != HUMAN:
            raise RefusedError(
                "input events are kept of a board that a person drives; a policy drives this one"
            )
        elif not self.is_persons:
            raise RefusedError(
                "input events are kept of a board that the page has begun; on this one every move is a script's"
            )
        elif not self._store.is_episode_of(self._board.id, episode_id):
            raise RefusedError(
                f"episode {episode_id!r} is none of this board's: no input events were kept"
            )

    def _unknown_codes(self, events: Events) -> set[str]:
        """Codes that are no standard key and cannot have driven a move here.

        They are stored as UNIDENTIFIED: no honest episode loses its attestation, and nobody chooses
        what is stored.
        """
        codes = {event.code for event in events.events if event.code is not None}
        unknown = codes - KEY_CODES - {*self._task.actions}
        if unknown and self._participation is not None:
            key_map = key_map_of(self._task.keys, self._participation.settings())
            unknown -= {code for _, code in key_map}
        return unknown

    def _conditions(self, episode: Trial, run: Run) -> Conditions | None:
        """What the level of an episode depends on besides its rows.

        None if no move can be a person's. An episode that a script has moved may have begun as a
        person's.
        """
        study = self._participation
        began_as_persons = self.is_persons and (study is None or study.driver == HUMAN)
        if episode.driver != HUMAN and not began_as_persons:
            return None
        settings = study.settings() if study is not None else ()
        return Conditions(
            started_ms=episode.started_ms,
            key_map=key_map_of(self._task.keys, settings),
            supervised_ms=study.supervised_ms() if study is not None else (),
            types_ahead=study is None,
            controls=controls_of(self._task, settings) if self._has_clock else (),
            allowed=run.allowed() if self._has_clock else (),
        )
