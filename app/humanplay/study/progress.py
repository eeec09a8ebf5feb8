"""A participant's progress through a study, from consent to completion code; the server decides what comes next.

What is no coroutine asks or writes the database where it stands: call it in `Store.write`. Everything is in the database
before it is answered, so a reload, another tab or a killed server goes on exactly there.
"""

from __future__ import annotations

import asyncio
import json
import logging
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial

from humanplay.board.lobby import Lobby, Locks
from humanplay.board.participation import RefusedError
from humanplay.board.session import Session
from humanplay.db.file import StoreError
from humanplay.db.rows import Phase
from humanplay.db.series import StudyStore, add_series
from humanplay.db.study_rows import BLOCK_EVENT, Participant, Stage, is_same_study
from humanplay.db.trial import Trial
from humanplay.study.arms import arm_name, arm_of, questions_of, reach_stage
from humanplay.study.asking import DueBlock, break_due, due_blocks, skip, store_answers
from humanplay.study.closing import give_up_left, left_open, note_closed
from humanplay.study.elsewhere import (
    WRONG_CODE,
    Ticket,
    holder_of_ticket,
    is_recovery_code,
    mark_of,
    named_by_code,
    recovery_code,
    ticket_of,
)
from humanplay.study.flow import ENDING_EVENTS, missed_checks, outcome_of
from humanplay.study.folder import Folder, Study
from humanplay.study.outcome import Outcome
from humanplay.study.outcomes import Ending, ending, read_texts
from humanplay.study.participation import CLOSED_MESSAGE, Participations, StageError
from humanplay.study.places import is_full
from humanplay.study.protocol import Arm, DraftStudyError, StudyError, UnknownStudyError
from humanplay.study.questions import EARLY_POSITIONS, Sent
from humanplay.study.recruitment import (
    MAX_WRONG_CODES,
    UNREADABLE,
    Arrival,
    Recruitment,
    supervise,
)
from humanplay.study.seeds import TUTORIAL_SEED, order_group
from humanplay.task import counted, on_threads

__all__ = ["NotJoinedError", "ParticipantProgress", "StageError"]

_log = logging.getLogger(__name__)
NOT_HERE = "the study {!r} cannot be played on this server now; tell whoever invited you"
WENT_ON_ELSEWHERE = "you have gone on with this study on another device: go on there, or come back here with your recovery code"
NO_TICKET = (
    "this link leads nowhere any more: it holds for 15 minutes and for one device. Make another on the device on which you "
    "take part, or type your recovery code"
)
NO_CODE = "this is not a recovery code of this study: type it just as you noted it, or ask whoever invited you"
_WARM_UP: Stage = "warm_up"
_SUPERVISED: tuple[Stage, ...] = ("instructions", "tutorial", "questions", "warm_up", "ranked")
"""Stages at which the operator's code can be typed."""
_AFTER: dict[str, Stage] = {
    "instructions": "tutorial",
    "tutorial": "questions",
    "debrief": "complete",
}


class NotJoinedError(LookupError):
    """Nobody with this cookie takes part."""


class ParticipantProgress:
    """The progress of every participant of one server's studies."""

    def __init__(self, lobby: Lobby, folder: Folder, study_store: StudyStore) -> None:
        self.lobby, self.folder, self.study_store = lobby, folder, study_store
        self._sources = lobby.sources
        self.recruitment = Recruitment(folder, study_store)
        invitations = self.recruitment.invitations
        self._participations = Participations(folder, study_store, lobby.sources, invitations)
        self._locks = Locks()
        self._note_freezings()

    def _note_freezings(self) -> None:
        for name in self.folder.names():
            with suppress(StudyError):  # a draft, or `study show` says what is wrong with it
                self.study_store.note_freezing(self.folder.study(name).row())

    def study(self, name: str) -> Study:
        """Return a frozen study as the public may see it; or UnknownStudyError, DraftStudyError, StageError."""
        try:
            study = self.folder.study(name)
        except (UnknownStudyError, DraftStudyError):
            raise
        except StudyError as error:
            _log.warning("%s", error)
            raise StageError(
                f"the study {name!r} cannot go on: its files have changed; tell whoever invited you"
            ) from error
        return study

    async def note_if_closed(self, study: Study) -> None:
        """Note in the database that a study is closed, where it does not know so yet."""
        store = self.lobby.store
        if study.is_running:
            return
        is_noted = (await store.read(self.study_store.open_names)).get(study.name)
        if is_noted is not None and not (study.is_open and is_noted):
            task, left = self.lobby.task, {}
            for trial, steps in await store.read(partial(left_open, store, study)):
                environment = task if trial.task == task.name else trial.environment
                left[trial.id] = await on_threads(task, give_up_left, trial, steps, environment)
            await store.write(partial(note_closed, store, study, left), then=self.lobby.forget)

    async def note_all_closed(self) -> None:
        """Note in the database every study that was closed since."""
        for name in await self.lobby.store.read(self.study_store.open_names):
            try:
                await self.note_if_closed(self.folder.study(name))
            except StudyError as error:
                _log.warning("%s", error)
            except Exception:
                _log.exception("the end of the study %s could not be noted", name)

    async def let_erased_go(self) -> None:
        """Unload the boards of participants whom the command erased: nothing more is recorded of them."""
        taking_part = [each for each in self.lobby.sessions() if each.participation is not None]

        def find_erased() -> list[str]:
            return [
                each.id
                for each in taking_part
                if each.participation and each.participation.is_erased()
            ]

        if erased := await self.lobby.store.read(find_erased) if taking_part else []:
            self.lobby.forget(erased)

    async def watch_commands(self, every_s: float = 2.0) -> None:
        """Take note of what commands closed and erased beside this server, until cancelled."""
        while True:
            await asyncio.sleep(every_s)
            with suppress(StoreError, sqlite3.Error):  # it is tried again
                await self.let_erased_go()
            with suppress(StoreError, sqlite3.Error):  # it is tried again
                for name in await self.lobby.store.read(self.study_store.open_names):
                    try:
                        if self.folder.status(name) in ("closed", "secret kept"):
                            await self.note_if_closed(self.folder.study(name))
                    except (StudyError, StoreError, sqlite3.Error):
                        pass  # it is named at its next use, or tried again
                    except Exception:
                        _log.exception("the end of the study %s could not be noted", name)

    def open_study(self, name: str) -> Study:
        """Return a study that people may take part in; StageError when it is closed or made for other rules."""
        return self.check_open(self.study(name))

    def check_open(self, study: Study) -> Study:
        """Return a study that can be played; StageError when it is not open or of other rules."""
        name = study.name
        if not study.is_running or self.study_store.is_closed(name):
            raise StageError(CLOSED_MESSAGE.format(name))
        environment = study.protocol.environment
        if study.protocol.task != self.lobby.task.name:
            other = self.lobby.task.about.title
            raise StageError(
                f"the study {name!r} is of {environment.about.title}, and this server plays {other}: "
                "whoever invited you must start it with --env"
            )
        unlike = environment.lock.differences(study.protocol.lock)
        if study.protocol.core_version != environment.version or unlike:
            what = "study %s is for core version %s, this is %s; here is: %s"
            other = unlike or "nothing else that differs"
            _log.warning(what, name, study.protocol.core_version, environment.version, other)
            raise StageError(NOT_HERE.format(name))
        return study

    def participant(self, name: str, player_id: str | None) -> Participant:
        """Return who asks; NotJoinedError before joining."""
        find = self.study_store.participant_of_player
        found = None if player_id is None else find(name, player_id)
        if found is None:
            if player_id is not None and self._has_left_device(name, player_id):
                raise NotJoinedError(WENT_ON_ELSEWHERE)
            raise NotJoinedError(
                f"you have not joined the study {name!r} in this browser; POST /api/studies/{name}/join does"
            )
        return found

    def join(self, name: str, player_id: str, comes: Arrival) -> tuple[Participant, bool]:
        """Return the participant, and whether it is a new one; joining again resumes."""
        study = self.open_study(name)
        found = self.study_store.participant_of_player(name, player_id)
        came = comes.outside_ids
        kept = {name: came[name] for name in study.protocol.outside_ids if name in came}
        script, now, invitation = comes.script, self._now(), None
        if found is None and script is None and self._has_left_device(name, player_id):
            raise StageError(WENT_ON_ELSEWHERE)
        if found is not None and script is not None and found.script != script:
            who = "a person" if found.script is None else f"the script {found.script!r}"
            what = f"this browser takes part as {who} already"
            raise StageError(f"{what}; a script needs a cookie of its own")
        if script is None and (found is None or found.kind == "human"):
            with self.recruitment.noting(now):
                invitation = self.recruitment.admit(study, player_id, comes, found)
        if found is not None:
            self._note_return(study, found, invitation, kept, now)
            self._turn_away_if_full(study, found, now)
            return self.study_store.participant(found.id), False
        self.add_study(study)
        new = Participant(
            id=self._sources.participant_id(), study=name, player_id=player_id, session_id=None,
            kind="human" if script is None else "script", script=script, stage="consent",
            consent_version=None, consent_ms=None, joined_ms=now, completed_ms=None, completion_code=None,
            settings="{}", invitation=invitation,
        )  # fmt: skip
        with self.lobby.store.transaction():
            self._add(study, new, kept)
            self._turn_away_if_full(study, new, now)
        return self.study_store.participant(new.id), True

    def consent(
        self, name: str, player_id: str | None, version: str, agree: bool, unfit: bool = False
    ) -> None:
        """Note the answer to the consent text: on to the instructions, or withdrawn.

        Whoever agrees when every place is taken is withdrawn, too.

        Args:
            unfit: The page finds that the device does not fit, so that nobody is asked.
        """
        study, participant = self._at(name, player_id, "consent")
        if version != study.protocol.consent.version:
            raise StageError(
                f"the consent text is version {study.protocol.consent.version!r}, not {version!r}: reload the page"
            )
        if not agree:
            outcome = Outcome.UNFIT_DEVICE if unfit else None
            self.study_store.withdraw(participant, self._now(), outcome=outcome)
            return
        now = self._now()
        with self.recruitment.noting(now), self.lobby.store.transaction():
            if participant.kind == "human":
                self.recruitment.check_consent(study, participant)
                # counted in the transaction that takes the place: two people never take one
                if is_full(self.lobby.store, study, now):
                    self.study_store.withdraw(participant, now, outcome=Outcome.OVER_QUOTA)
                    return
            agreed: dict[str, str | int] = {"consent_version": version, "consent_ms": now}
            if study.protocol.platform == "code":
                agreed["completion_code"] = self._sources.completion_code()
            self._reach(study, participant, "instructions", **agreed)

    def advance(self, name: str, player_id: str | None, stage: str) -> None:
        """Go on from instructions, tutorial or debrief."""
        if stage == "debrief":
            participant = self.participant(name, player_id)
        else:
            _, participant = self._at(name, player_id)
        if participant.stage != stage:
            at = f"you are at {_describe(participant.stage)}, not at {_describe(stage)}"
            raise StageError(f"{at}; nothing has changed")
        trials = self.study_store.trials(participant.id)
        study = self.study(name)
        self._check_asked(study, participant, trials)
        if stage == "tutorial" and not any(trial.ended_ms for trial in trials):
            raise StageError("play the tutorial to its end first, or give it up")
        self._reach(study, participant, _AFTER[stage])

    def answer(
        self, name: str, player_id: str | None, answers: Sequence[int]
    ) -> tuple[list[bool], list[str]]:
        """Check the answers to the instructions' questions; move on if all are right.

        Returns:
            Which are right, and for each that is not, why.
        """
        study, participant = self._at(name, player_id, "questions")
        questions = questions_of(study.protocol, self.arm(study, participant))
        if len(answers) != len(questions):
            expected = f"one choice for each of {counted(len(questions), 'question')}"
            raise ValueError(f"answers must hold {expected}, got {len(answers)}")
        right = []
        for number, (choice, question) in enumerate(zip(answers, questions, strict=True)):
            try:
                right.append(question.is_right(choice))
            except ValueError as error:
                raise ValueError(f"answer {number} {error}") from error
        with self.lobby.store.transaction():
            self.study_store.add_stage_event(
                participant.id, self._now(), "answers", {"answers": list(answers), "right": right}
            )
            if all(right):
                stage: Stage = _WARM_UP if study.protocol.warm_up else "ranked"
                self._reach(study, participant, stage)
            elif self.tries_left(study, participant) == 0:
                failed = Outcome.FAILED_QUESTIONS
                self.study_store.withdraw(participant, self._now(), outcome=failed)
        marks = zip(right, questions, strict=True)
        return right, ["" if is_right else question.why for is_right, question in marks]

    def answer_block(
        self, name: str, player_id: str | None, block: str, turn: int, answers: Mapping[str, Sent]
    ) -> None:
        """Store the answers to the block that is due; ValueError where an answer is none."""
        participant, due = self._due(name, player_id, block, turn)
        with self.lobby.store.transaction():
            store_answers(self.study_store, participant.id, due[0], answers, self._now())
            if due[0].block.at in EARLY_POSITIONS and participant.kind == "human":
                self._screen_attention(name, participant)

    def _screen_attention(self, name: str, participant: Participant) -> None:
        """Screen out whoever has missed more attention checks than the protocol allows."""
        limit = self.study(name).protocol.attention_limit
        missed = missed_checks(self.study_store.events(participant.id, [BLOCK_EVENT]))
        if limit is not None and missed > limit:
            failed = Outcome.FAILED_ATTENTION
            self.study_store.withdraw(participant, self._now(), outcome=failed)

    def skip_blocks(self, name: str, player_id: str | None, block: str, turn: int) -> None:
        """Skip the block that is due, and all that follow it before the debrief."""
        participant, due = self._due(name, player_id, block, turn)
        if due[0].block.at != "after":
            raise StageError(
                f"the block {block!r} cannot be skipped: leave out what need not be answered, or choose prefer not to say"
            )
        with self.lobby.store.transaction():
            skip(self.study_store, participant.id, due, self._now())

    def due_blocks(
        self, study: Study, participant: Participant, trials: Sequence[Trial]
    ) -> list[DueBlock]:
        """Return the blocks of questions that come before anything else, in order."""
        return due_blocks(self.study_store, study, participant, trials)

    def arm(self, study: Study, participant: Participant) -> Arm | None:
        """The arm of a participant; None before they are assigned, and without arms."""
        return arm_of(self.study_store, study, participant)

    def tries_left(self, study: Study, participant: Participant) -> int | None:
        """How often a participant may still answer the questions; None where that has no limit."""
        tries = study.protocol.question_tries
        if tries is None or participant.kind == "script":  # which can but guess
            return None
        return max(0, tries - self.study_store.count_stage_events(participant.id, "answers"))

    async def begin_next(self, name: str, player_id: str | None) -> None:
        """Begin the next episode of the stage; nothing changes while one runs."""
        store = self.lobby.store
        present = await store.read(partial(self.participant, name, player_id))
        async with self._locks.of(present.id):
            planned = await store.write(partial(self._plan, name, player_id))
            if planned is None:
                return
            study, participant, trials, phase, trial, terrain, seed = planned
            board = await self._board(participant)

            @contextmanager
            def within(row: Trial) -> Iterator[None]:
                # withdrawn in another tab, or closed, while the terrain grew
                self._at(name, player_id, participant.stage)
                if participant.session_id is None:
                    store.add_session(board.row)
                    self.study_store.set_session(participant.id, board.id)
                self._note_break(study, participant, trials)
                yield
                self.study_store.add_trial(participant.id, row.id, phase, trial, terrain)

            await self.lobby.begin(board, study.protocol.env_config, seed, within, study.name)

    async def abandon(self, name: str, player_id: str | None, episode: str, step: int) -> None:
        """Abandon the running episode; RefusedError when it is not the one on screen."""
        find = partial(self._at, name, player_id, "tutorial", "warm_up", "ranked")
        found = await self.lobby.store.write(find)
        session = await self.session(found[1])
        if session is None:
            raise StageError("no episode has begun: there is nothing to give up")
        await session.abandon(episode, step)

    async def withdraw(self, name: str, player_id: str | None, erase: bool = False) -> None:
        """Let the participant go: the running episode is abandoned, the rest is kept.

        Args:
            erase: They ask that it be erased, which `humanplay forget` does.
        """
        if erase and self.study(name).protocol.keep_episodes_when_forgotten:
            raise StageError(
                "this study keeps what was played, without your name: leave without asking to have it erased"
            )
        participant = await self.lobby.store.read(partial(self.participant, name, player_id))
        session = await self.session(participant)
        note = partial(self._note_withdrawal, participant.id, erase)
        if session is None or session.shown.ended or not self.study(name).is_running:
            await self.lobby.store.write(note)
            return
        try:
            await session.abandon(session.current.id, None, note)
        except RefusedError:  # it has ended meanwhile
            await self.lobby.store.write(note)

    def ending(
        self, study: Study, participant: Participant, trials: Sequence[Trial]
    ) -> Ending | None:
        """What a participant reads at their end; None for whoever can go on."""
        events = self.study_store.events(participant.id, ENDING_EVENTS)
        outcome = outcome_of(participant, study.is_running, events, trials)
        if outcome is None:
            return None
        ids = self.study_store.identities_of(participant.id)
        texts = read_texts(self.folder.path(study.name))
        return ending(study.protocol, texts, outcome, ids, participant.completion_code)

    def ticket(self, name: str, player_id: str | None) -> Ticket:
        """What leads to a participant's place from another device, for some minutes."""
        study, participant = self._at(name, player_id)
        self._check_can_move(participant)
        return ticket_of(study, participant, self._now())

    def recovery_code(self, study: Study, participant: Participant) -> str | None:
        """The code with which a participant can go on elsewhere; None for whoever cannot."""
        if not study.is_running or not _can_move(participant):
            return None
        return recovery_code(study, participant)

    async def go_on_here(
        self, name: str, player_id: str, token: str | None, code: str | None
    ) -> Participant:
        """Let a participant go on on another device; the one before stops at once.

        Args:
            player_id: Of the new device's cookie.
            token: Of a link; None with a code.
        """

        def hand_over_board(participant: Participant) -> None:
            if participant.session_id is not None:
                self.lobby.hand_over(participant.session_id, participant.player_id)

        move = partial(self._move_here, name, player_id, token, code)
        return await self.lobby.store.write(move, then=hand_over_board)

    def _move_here(
        self, name: str, player_id: str, token: str | None, code: str | None
    ) -> Participant:
        study, now = self.open_study(name), self._now()
        people = self.study_store.people_who_agreed(name)
        if token is not None:
            person, way = holder_of_ticket(study, people, token, now), "link"
            if person is None:
                raise StageError(NO_TICKET)
        else:
            person, way = self._holder_of_code(study, people, code or "", now), "code"
        self._check_can_move(person)
        if person.player_id == player_id:
            return person
        present = self.study_store.participant_of_player(name, player_id)
        if present is not None and present.consent_ms is not None:
            raise StageError(
                "this browser takes part in the study as somebody else: use another one, or a private window"
            )
        with self.lobby.store.transaction():
            if present is not None:  # opened here, and not answered: that stays counted
                self.study_store.change_cookie(present.id, self._sources.player_id(), now)
            detail = {"by": way, "left": mark_of(study, person.player_id)}
            self.study_store.hand_over(person, player_id, now, detail)
        return self.study_store.participant(person.id)

    def _holder_of_code(
        self, study: Study, people: Sequence[Participant], typed: str, now: int
    ) -> Participant:
        """Whose recovery code was typed.

        Raises:
            StageError: For a wrong one, which is noted with whoever has its label.
        """
        person = named_by_code(people, typed)
        if person is None:
            raise StageError(NO_CODE)
        if self.study_store.count_stage_events(person.id, WRONG_CODE) >= MAX_WRONG_CODES:
            raise StageError(
                f"{MAX_WRONG_CODES} wrong recovery codes were typed for this place, and none is looked at any more: make a "
                "link on the device on which you take part, or write to whoever invited you"
            )
        if not is_recovery_code(study, person, typed):
            self.study_store.add_stage_event(person.id, now, WRONG_CODE, {})
            raise StageError(NO_CODE)
        return person

    def _check_can_move(self, participant: Participant) -> None:
        if not _can_move(participant):
            raise StageError(
                "only a person who has agreed to take part, and has not left, can go on on another device"
            )

    def _has_left_device(self, name: str, player_id: str) -> bool:
        try:
            study = self.folder.study(name)
        except StudyError:
            return False
        return self.study_store.has_left_device(name, mark_of(study, player_id))

    def supervise(self, name: str, player_id: str | None, code: str) -> None:
        """Note that the operator typed their code for a participant; StageError for a wrong one."""
        study, participant = self._at(name, player_id, *_SUPERVISED)
        supervise(self.study_store, study, participant, code, self._now())

    def set_settings(self, name: str, player_id: str | None, changed: Mapping[str, object]) -> None:
        """Keep what a participant chose: modality, palette, keys; what is not given stays."""
        participant = self.participant(name, player_id)
        settings = {**json.loads(participant.settings), **changed}
        self.study_store.set_settings(participant.id, self._now(), settings)

    async def session(self, participant: Participant) -> Session | None:
        """Return the participant's board; None before the first episode."""
        ident = participant.session_id
        return None if ident is None else await self.lobby.get(ident)

    def _plan(
        self, name: str, player_id: str | None
    ) -> tuple[Study, Participant, list[Trial], Phase, int, int, int] | None:
        """Return what the next episode is (study, participant, trials, phase, trial, terrain, seed); None while one runs."""
        study, participant = self._at(name, player_id, "tutorial", "warm_up", "ranked")
        trials = self.study_store.trials(participant.id)
        if any(trial.ended_ms is None for trial in trials):
            return None
        self._check_asked(study, participant, trials)
        phase: Phase = participant.stage  # type: ignore[assignment]  # checked by _at
        trial = sum(each.phase == phase for each in trials)
        where = self._terrain(study, participant, phase, trial)
        return study, participant, trials, phase, trial, *where

    def _due(
        self, name: str, player_id: str | None, block: str, turn: int
    ) -> tuple[Participant, list[DueBlock]]:
        """Return who asks and the blocks that are due; StageError where another one, or none, is the first."""
        study, participant = self._at(name, player_id)
        due = self.due_blocks(study, participant, self.study_store.trials(participant.id))
        if not due or (due[0].block.name, due[0].turn) != (block, turn):
            now = f"the questions {due[0].block.title!r}" if due else "no questions of a block"
            raise StageError(f"{now} are asked now, and not {block!r}; nothing has changed")
        return participant, due

    def _check_asked(self, study: Study, participant: Participant, trials: Sequence[Trial]) -> None:
        if due := self.due_blocks(study, participant, trials):
            raise StageError(
                f"the questions {due[0].block.title!r} come first; nothing has changed"
            )

    def _note_withdrawal(self, participant_id: str, erase: bool) -> None:
        """Withdraw a participant as they are now; StageError when they are at the end already."""
        participant = self.study_store.participant(participant_id)
        if participant.stage in ("complete", "withdrawn"):
            at = _describe(participant.stage)
            raise StageError(f"you are at {at}: there is nothing to withdraw from")
        self.study_store.withdraw(participant, self._now(), erase)

    def _at(self, name: str, player_id: str | None, *stages: str) -> tuple[Study, Participant]:
        """Return an open study and who asks; StageError at other stages than those named."""
        study, participant = self.open_study(name), self.participant(name, player_id)
        if stages and participant.stage not in stages:
            wanted = " or ".join(map(_describe, stages))
            raise StageError(
                f"you are at {_describe(participant.stage)}; this belongs to {wanted}, and nothing has changed"
            )
        return study, participant

    def _note_return(
        self,
        study: Study,
        found: Participant,
        invitation: str | None,
        ids: Mapping[str, str],
        now: int,
    ) -> None:
        """Note that a participant opened the study again, with the newest IDs of the platform's session."""
        if found.stage == "withdrawn":
            self.recruitment.note(found.id, "after leaving", now)
            return
        if invitation is not None and invitation != found.invitation:
            self.study_store.set_invitation(found.id, invitation)
        for name in study.protocol.outside_ids[1:]:
            if name in ids and ids[name] != self.study_store.identity(found.id, name):
                self.study_store.set_identity(found.id, name, ids[name])

    def _turn_away_if_full(self, study: Study, participant: Participant, now: int) -> None:
        """Withdraw a person who has not agreed yet where every place is taken."""
        is_asked = participant.kind == "human" and participant.stage == "consent"
        if is_asked and is_full(self.lobby.store, study, now):
            self.study_store.withdraw(participant, now, outcome=Outcome.OVER_QUOTA)

    def _reach(
        self, study: Study, participant: Participant, stage: Stage, **columns: str | int
    ) -> None:
        now, invitations = self._now(), self.recruitment.invitations
        try:
            reach_stage(self.study_store, study, participant, now, stage, invitations, **columns)
        except StudyError as error:
            raise StageError(UNREADABLE) from error

    def _add(self, study: Study, new: Participant, kept: Mapping[str, str]) -> None:
        """Add a participant, with what is known of their outside id if they are a person."""
        id_is = self.recruitment.repeats_outside_id(study, kept) if new.kind == "human" else None
        with self.lobby.store.transaction():
            if id_is == "repeated":
                self.recruitment.note_repeated_id(study, kept, new.joined_ms)
            joined = {} if id_is is None else {"outside_id": id_is}
            self.study_store.add_participant(new, kept, joined)

    def add_study(self, study: Study) -> None:
        """Add the study to the database; StageError when another study of its name is there."""
        known = add_series(self.lobby.store, study.row())
        if is_same_study(known, study):
            return
        _log.warning(
            "%s holds another study %r (protocol hash %s): serve this one on a database of its own, or give it another name",
            self.study_store.path, study.name, known.protocol_hash[:12],
        )  # fmt: skip
        raise StageError(NOT_HERE.format(study.name))

    async def _board(self, participant: Participant) -> Session:
        found = await self.session(participant)
        own = self._participations.of(participant)
        return found or self.lobby.new_board(participant.player_id, own)

    def _note_break(self, study: Study, participant: Participant, trials: Sequence[Trial]) -> None:
        if break_due(study.protocol, participant, trials):
            length = self._now() - (trials[-1].ended_ms or 0)
            done = sum(trial.phase == "ranked" for trial in trials)
            detail = {"after": done, "length_ms": length}
            self.study_store.add_stage_event(participant.id, self._now(), "break", detail)

    def _terrain(
        self, study: Study, participant: Participant, phase: Phase, trial: int
    ) -> tuple[int, int]:
        """Return the terrain's index and seed of a participant's trial."""
        if phase == "tutorial":
            return 0, TUTORIAL_SEED
        if phase == "warm_up":
            return trial, study.seed("warm-up", trial)
        number = self.study_store.order_number(participant, self._now())
        arm = arm_name(self.study_store, study, participant)
        group = order_group(participant.kind, arm)
        terrain = study.balanced_order(group, number)[trial]
        return terrain, study.seed("ranked", terrain)

    def _now(self) -> int:
        return self._sources.clock_ms()


def _can_move(participant: Participant) -> bool:
    has_agreed = participant.kind == "human" and participant.consent_ms is not None
    return has_agreed and participant.stage != "withdrawn"


def _describe(stage: str) -> str:
    words = {
        "questions": "the questions",
        "complete": "the end",
        "withdrawn": "the end (withdrawn)",
        "warm_up": "the warm-up",
    }
    return words.get(stage, "the ranked episodes" if stage == "ranked" else f"the {stage}")
