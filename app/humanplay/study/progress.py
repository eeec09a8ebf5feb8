"""A participant's progress through a study, from consent to completion code.

The server decides what comes next. Everything is stored before it is answered, so a reload, another
tab or a restarted server goes on at the same place. Methods that are no coroutines use the database
directly: call them in `Store.write`.
"""

from __future__ import annotations

import asyncio
import json
import logging
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple

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
from humanplay.study.protocol import SOURCE_LANGUAGE, DraftStudyError, StudyError, UnknownStudyError
from humanplay.study.protocol_arms import Arm
from humanplay.study.questions import EARLY_POSITIONS, Sent
from humanplay.study.recruitment import (
    MAX_WRONG_CODES,
    UNREADABLE,
    Arrival,
    Recruitment,
    supervise,
)
from humanplay.study.seeds import TUTORIAL_SEED, order_group
from humanplay.study.translation import localized, own_sentence
from humanplay.task import counted, on_threads
from humanplay.task.sentences import Sentence

__all__ = ["NotJoinedError", "ParticipantProgress", "StageError"]

_log = logging.getLogger(__name__)
NOT_HERE = Sentence(
    "refused.not_here",
    "the study '{name}' cannot be played on this server now; tell whoever invited you",
)
FILES_CHANGED = Sentence(
    "refused.files_changed",
    "the study '{name}' cannot go on: its files have changed; tell whoever invited you",
)
ON_OTHER_DEVICE = Sentence(
    "refused.elsewhere",
    "you have gone on with this study on another device: go on there, or come back here with your recovery code",
)
NO_TICKET = Sentence(
    "refused.no_ticket",
    "this link leads nowhere any more: it holds for 15 minutes and for one device. Make another on the device on which you "
    "take part, or type your recovery code",
)
NO_CODE = Sentence(
    "refused.no_code",
    "this is not a recovery code of this study: type it just as you noted it, or ask whoever invited you",
)
NO_MORE_CODES = Sentence(
    "refused.no_more_recovery_codes",
    "{most} wrong recovery codes were typed for this place, and none is looked at any more: make a link on the device on "
    "which you take part, or write to whoever invited you",
)
SOMEBODY_ELSE = Sentence(
    "refused.somebody_else",
    "this browser takes part in the study as somebody else: use another one, or a private window",
)
CANNOT_CHANGE_DEVICE = Sentence(
    "refused.cannot_move",
    "only a person who has agreed to take part, and has not left, can go on on another device",
)
NOT_JOINED = Sentence(
    "refused.not_joined",
    "you have not joined the study '{name}' in this browser; POST /api/studies/{name}/join does",
)
OTHER_CONSENT = Sentence(
    "refused.other_consent", "the consent text is version '{now}', not '{version}': reload the page"
)
AT_OTHER_STAGE = Sentence(
    "refused.other_stage", "you are at {stage}, not at {other}; nothing has changed"
)
BELONGS_TO = Sentence(
    "refused.belongs_to", "you are at {stage}; this belongs to {other}, and nothing has changed"
)
PLAY_TUTORIAL = Sentence(
    "refused.play_tutorial", "play the tutorial to its end first, or give it up"
)
NOTHING_BEGUN = Sentence(
    "refused.nothing_begun", "no episode has begun: there is nothing to give up"
)
KEEPS_EPISODES = Sentence(
    "refused.keeps_episodes",
    "this study keeps what was played, without your name: leave without asking to have it erased",
)
QUESTIONS_FIRST = Sentence(
    "refused.questions_first", "the questions '{title}' come first; nothing has changed"
)
OTHER_BLOCK = Sentence(
    "refused.other_block", "{now} are asked now, and not '{block}'; nothing has changed"
)
THE_BLOCK = Sentence("refused.the_block", "the questions '{title}'")
NO_BLOCK = Sentence("refused.no_block", "no questions of a block")
NO_WITHDRAWAL = Sentence(
    "refused.no_withdrawal", "you are at {stage}: there is nothing to withdraw from"
)
LANGUAGE_AT_CONSENT = Sentence(
    "refused.language", "the language is chosen before you agree to take part"
)
_WARM_UP: Stage = "warm_up"
_SUPERVISED: tuple[Stage, ...] = ("instructions", "tutorial", "questions", "warm_up", "ranked")
"""Stages at which the operator's code can be typed."""
_AFTER: dict[str, Stage] = {
    "instructions": "tutorial",
    "tutorial": "questions",
    "debrief": "complete",
}


class NextEpisode(NamedTuple):
    """The episode that a participant begins next.

    Attributes:
        trials: The participant's so far.
        number: Its place among those of its phase, from 0 on.
        terrain: The index of its terrain in the study.
    """

    study: Study
    participant: Participant
    trials: list[Trial]
    phase: Phase
    number: int
    terrain: int
    seed: int


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
        """A frozen study, with errors that the public may read.

        Raises:
            UnknownStudyError, DraftStudyError: If it is not frozen.
            StageError: If its files have changed.
        """
        try:
            study = self.folder.study(name)
        except (UnknownStudyError, DraftStudyError):
            raise
        except StudyError as error:
            _log.warning("%s", error)
            raise StageError(FILES_CHANGED.format(name=name)) from error
        return study

    async def note_if_closed(self, study: Study) -> None:
        """Note in the database that a study is closed, unless it is noted already."""
        store = self.lobby.store
        if study.is_running:
            return
        unclosed = await store.read(self.study_store.unclosed_studies)
        if study.name not in unclosed:
            return  # noted already, or nobody has joined it
        if study.is_open and unclosed[study.name]:
            return  # that the secret is kept is noted already
        task, abandoned = self.lobby.task, {}
        for trial, steps in await store.read(partial(left_open, store, study)):
            environment = task if trial.task == task.name else trial.environment
            abandoned[trial.id] = await on_threads(task, give_up_left, trial, steps, environment)
        await store.write(partial(note_closed, store, study, abandoned), then=self.lobby.forget)

    async def note_all_closed(self) -> None:
        """Note in the database every study that was closed meanwhile."""
        for name in await self.lobby.store.read(self.study_store.unclosed_studies):
            try:
                await self.note_if_closed(self.folder.study(name))
            except StudyError as error:
                _log.warning("%s", error)
            except Exception:
                _log.exception("the end of the study %s could not be noted", name)

    async def let_erased_go(self) -> None:
        """Unload the boards of participants whom `humanplay forget` has erased."""
        sessions = [session for session in self.lobby.sessions() if session.participation]

        def find_erased() -> list[str]:
            return [
                session.id
                for session in sessions
                if session.participation and session.participation.is_erased()
            ]

        if erased := await self.lobby.store.read(find_erased) if sessions else []:
            self.lobby.forget(erased)

    async def watch_commands(self, every_s: float = 2.0) -> None:
        """Follow what commands close and erase beside this server, until cancelled."""
        while True:
            await asyncio.sleep(every_s)
            with suppress(StoreError, sqlite3.Error):  # it is tried again
                await self.let_erased_go()
            with suppress(StoreError, sqlite3.Error):  # it is tried again
                for name in await self.lobby.store.read(self.study_store.unclosed_studies):
                    try:
                        if self.folder.status(name) in ("closed", "secret kept"):
                            await self.note_if_closed(self.folder.study(name))
                    except (StudyError, StoreError, sqlite3.Error):
                        pass  # it is named at its next use, or tried again
                    except Exception:
                        _log.exception("the end of the study %s could not be noted", name)

    def open_study(self, name: str) -> Study:
        """A study that people can take part in; errors as of `study` and `check_open`."""
        return self.check_open(self.study(name))

    def check_open(self, study: Study) -> Study:
        """Return the study.

        Raises:
            StageError: If it is closed, or cannot be played the same on this server.
        """
        name = study.name
        if not study.is_running or self.study_store.is_closed(name):
            raise StageError(CLOSED_MESSAGE.format(name=name))
        environment = study.protocol.environment
        if study.protocol.task != self.lobby.task.name:
            other = self.lobby.task.about.title
            raise StageError(
                f"the study {name!r} is of {environment.about.title}, and this server plays {other}: "
                "whoever invited you must start it with --env"
            )
        differences = environment.lock.differences(study.protocol.lock)
        if study.protocol.core_version != environment.version or differences:
            _log.warning(
                "study %s is for core version %s, this is %s; here is: %s",
                name,
                study.protocol.core_version,
                environment.version,
                differences or "nothing else that differs",
            )
            raise StageError(NOT_HERE.format(name=name))
        return study

    def participant(self, name: str, player_id: str | None) -> Participant:
        """The participant with a cookie; NotJoinedError before they join."""
        if player_id is None:
            raise NotJoinedError(NOT_JOINED.format(name=name))
        participant = self.study_store.participant_of_player(name, player_id)
        if participant is not None:
            return participant
        if self._has_left_device(name, player_id):
            raise NotJoinedError(ON_OTHER_DEVICE)
        raise NotJoinedError(NOT_JOINED.format(name=name))

    def join(self, name: str, player_id: str, arrival: Arrival) -> tuple[Participant, bool]:
        """Let a person or a script join, or come back.

        Returns:
            The participant, and whether they are new.
        """
        study = self.open_study(name)
        returning = self.study_store.participant_of_player(name, player_id)
        sent = arrival.outside_ids
        outside_ids = {
            parameter: sent[parameter]
            for parameter in study.protocol.outside_ids
            if parameter in sent
        }
        script, now, invitation = arrival.script, self._now(), None
        if returning is None and script is None and self._has_left_device(name, player_id):
            raise StageError(ON_OTHER_DEVICE)
        if returning is not None and script is not None and returning.script != script:
            is_person = returning.script is None
            player = "a person" if is_person else f"the script {returning.script!r}"
            raise StageError(
                f"this browser takes part as {player} already; a script needs a cookie of its own"
            )
        if script is None and (returning is None or returning.kind == "human"):
            with self.recruitment.noting(now):
                invitation = self.recruitment.admit(study, player_id, arrival, returning)
        if returning is not None:
            self._note_return(study, returning, invitation, outside_ids, now)
            self._turn_away_if_full(study, returning, now)
            return self.study_store.participant(returning.id), False
        self.add_study(study)
        settings = {"language": arrival.language} if len(study.protocol.languages) > 1 else {}
        newcomer = Participant(
            id=self._sources.participant_id(),
            study=name,
            player_id=player_id,
            session_id=None,
            kind="human" if script is None else "script",
            script=script,
            stage="consent",
            consent_version=None,
            consent_ms=None,
            joined_ms=now,
            completed_ms=None,
            completion_code=None,
            settings=json.dumps(settings),
            invitation=invitation,
        )
        with self.lobby.store.transaction():
            self._add(study, newcomer, outside_ids)
            self._turn_away_if_full(study, newcomer, now)
        return self.study_store.participant(newcomer.id), True

    def consent(
        self, name: str, player_id: str | None, version: str, agree: bool, unfit: bool = False
    ) -> None:
        """Note the answer to the consent text: on to the instructions, or withdrawn.

        Whoever agrees when every place is taken is withdrawn, too.

        Args:
            unfit: Whether the device does not suit the study; the page asks nobody then.
        """
        study, participant = self._at(name, player_id, "consent")
        present_version = study.protocol.consent.version
        if version != present_version:
            raise StageError(OTHER_CONSENT.format(now=present_version, version=version))
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
            columns: dict[str, str | int] = {"consent_version": version, "consent_ms": now}
            if study.protocol.platform == "code":
                columns["completion_code"] = self._sources.completion_code()
            self._reach(study, participant, "instructions", **columns)

    def advance(self, name: str, player_id: str | None, stage: str) -> None:
        """Go on from instructions, tutorial or debrief."""
        if stage == "debrief":
            participant = self.participant(name, player_id)
        else:
            _, participant = self._at(name, player_id)
        if participant.stage != stage:
            stages = {"stage": _describe(participant.stage), "other": _describe(stage)}
            raise StageError(AT_OTHER_STAGE.format(**stages))
        trials = self.study_store.trials(participant.id)
        study = self.study(name)
        self._check_asked(study, participant, trials)
        if stage == "tutorial" and not any(trial.ended_ms for trial in trials):
            raise StageError(PLAY_TUTORIAL)
        self._reach(study, participant, _AFTER[stage])

    def answer(
        self,
        name: str,
        player_id: str | None,
        answers: Sequence[int],
        language: str = SOURCE_LANGUAGE,
    ) -> tuple[list[bool], list[str]]:
        """Check the answers to the instructions' questions; move on if all are right.

        Args:
            language: In which they were asked.

        Returns:
            Which are right, and for each that is not, why.
        """
        study, participant = self._at(name, player_id, "questions")
        spoken = replace(study, protocol=localized(study.protocol, language))
        questions = questions_of(spoken.protocol, self.arm(spoken, participant))
        if len(answers) != len(questions):
            count = counted(len(questions), "question")
            raise ValueError(
                f"answers must hold one choice for each of {count}, got {len(answers)}"
            )
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
                outcome = Outcome.FAILED_QUESTIONS
                self.study_store.withdraw(participant, self._now(), outcome=outcome)
        marks = zip(right, questions, strict=True)
        return right, ["" if is_right else question.why for is_right, question in marks]

    def answer_block(
        self, name: str, player_id: str | None, block: str, turn: int, answers: Mapping[str, Sent]
    ) -> None:
        """Store the answers to the block that is due; ValueError if one is not valid."""
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
            outcome = Outcome.FAILED_ATTENTION
            self.study_store.withdraw(participant, self._now(), outcome=outcome)

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
        """The blocks of questions that come before anything else, in order."""
        return due_blocks(self.study_store, study, participant, trials)

    def arm(self, study: Study, participant: Participant) -> Arm | None:
        """The arm of a participant; None before they are assigned, and without arms."""
        return arm_of(self.study_store, study, participant)

    def tries_left(self, study: Study, participant: Participant) -> int | None:
        """How many tries at the questions a participant has left; None: no limit."""
        tries = study.protocol.question_tries
        if tries is None or participant.kind == "script":  # a script can only guess
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
            study, participant, trials, phase, number, terrain, seed = planned
            board = await self._board(participant)

            @contextmanager
            def with_trial(row: Trial) -> Iterator[None]:
                # withdrawn in another tab, or closed, while the terrain grew
                self._at(name, player_id, participant.stage)
                if participant.session_id is None:
                    store.add_session(board.row)
                    self.study_store.set_session(participant.id, board.id)
                self._note_break(study, participant, trials)
                yield
                self.study_store.add_trial(participant.id, row.id, phase, number, terrain)

            await self.lobby.begin(board, study.protocol.env_config, seed, with_trial, study.name)

    async def abandon(self, name: str, player_id: str | None, episode: str, step: int) -> None:
        """Abandon the running episode; RefusedError if it is not the one on screen."""
        find = partial(self._at, name, player_id, "tutorial", "warm_up", "ranked")
        _, participant = await self.lobby.store.write(find)
        session = await self.session(participant)
        if session is None:
            raise StageError(NOTHING_BEGUN)
        await session.abandon(episode, step)

    async def withdraw(self, name: str, player_id: str | None, erase: bool = False) -> None:
        """Withdraw a participant: the running episode is abandoned, the others are kept.

        Args:
            erase: Whether they ask for erasure, which `humanplay forget` does.
        """
        if erase and self.study(name).protocol.keep_episodes_when_forgotten:
            raise StageError(KEEPS_EPISODES)
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
        """What a participant reads who cannot go on; None while they can."""
        events = self.study_store.events(participant.id, ENDING_EVENTS)
        outcome = outcome_of(participant, study.is_running, events, trials)
        if outcome is None:
            return None
        ids = self.study_store.identities_of(participant.id)
        texts = read_texts(self.folder.path(study.name))
        return ending(study.protocol, texts, outcome, ids, participant.completion_code)

    def ticket(self, name: str, player_id: str | None) -> Ticket:
        """A ticket with which a participant can go on on another device, for some minutes."""
        study, participant = self._at(name, player_id)
        self._check_can_change_device(participant)
        return ticket_of(study, participant, self._now())

    def recovery_code(self, study: Study, participant: Participant) -> str | None:
        """The code with which a participant can go on elsewhere; None if they cannot."""
        if not study.is_running or not _can_change_device(participant):
            return None
        return recovery_code(study, participant)

    async def go_on_here(
        self, name: str, player_id: str, token: str | None, code: str | None
    ) -> Participant:
        """Let a participant go on on another device; the previous one stops at once.

        Args:
            player_id: Of the new device's cookie.
            token: The link's; None if a code was typed.
            code: The recovery code that was typed; None with a token.
        """

        def hand_over_board(participant: Participant) -> None:
            if participant.session_id is not None:
                self.lobby.hand_over(participant.session_id, participant.player_id)

        hand_over = partial(self._hand_over_to, name, player_id, token, code)
        return await self.lobby.store.write(hand_over, then=hand_over_board)

    def _hand_over_to(
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
        self._check_can_change_device(person)
        if person.player_id == player_id:
            return person
        present = self.study_store.participant_of_player(name, player_id)
        if present is not None and present.consent_ms is not None:
            raise StageError(SOMEBODY_ELSE)
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
            raise StageError(NO_MORE_CODES.format(most=MAX_WRONG_CODES))
        if not is_recovery_code(study, person, typed):
            self.study_store.add_stage_event(person.id, now, WRONG_CODE, {})
            raise StageError(NO_CODE)
        return person

    def _check_can_change_device(self, participant: Participant) -> None:
        if not _can_change_device(participant):
            raise StageError(CANNOT_CHANGE_DEVICE)

    def _has_left_device(self, name: str, player_id: str) -> bool:
        """Whether whoever took part in this browser went on with another device."""
        try:
            study = self.folder.study(name)
        except StudyError:
            return False
        return self.study_store.has_left_device(name, mark_of(study, player_id))

    def supervise(self, name: str, player_id: str | None, code: str) -> None:
        """Note that the operator typed their code; StageError for a wrong one."""
        study, participant = self._at(name, player_id, *_SUPERVISED)
        supervise(self.study_store, study, participant, code, self._now())

    def set_settings(
        self,
        name: str,
        player_id: str | None,
        changed: Mapping[str, object],
        stage: str | None = None,
    ) -> None:
        """Store what a participant chose: modality, palette, keys, language.

        Settings that are not in `changed` stay. Keys stay too if they come from the `stage` of the
        consent and the consent is over: meanwhile an arm has given keys.
        """
        participant = self.participant(name, player_id)
        is_late = stage == "consent" != participant.stage
        if is_late and any(arm.keys for arm in self.study(name).protocol.arms):
            changed = {key: setting for key, setting in changed.items() if key != "keys"}
        if "language" in changed and participant.consent_ms is not None:
            raise StageError(LANGUAGE_AT_CONSENT)
        settings = {**json.loads(participant.settings), **changed}
        self.study_store.set_settings(participant.id, self._now(), settings)

    async def session(self, participant: Participant) -> Session | None:
        """The participant's board; None before the first episode."""
        session_id = participant.session_id
        return None if session_id is None else await self.lobby.get(session_id)

    def _plan(self, name: str, player_id: str | None) -> NextEpisode | None:
        """The participant's next episode; None while one runs."""
        study, participant = self._at(name, player_id, "tutorial", "warm_up", "ranked")
        trials = self.study_store.trials(participant.id)
        if any(trial.ended_ms is None for trial in trials):
            return None
        self._check_asked(study, participant, trials)
        phase: Phase = participant.stage  # type: ignore[assignment]  # checked by _at
        number = sum(trial.phase == phase for trial in trials)
        terrain, seed = self._terrain(study, participant, phase, number)
        return NextEpisode(study, participant, trials, phase, number, terrain, seed)

    def _due(
        self, name: str, player_id: str | None, block: str, turn: int
    ) -> tuple[Participant, list[DueBlock]]:
        """The participant and the blocks that are due.

        Raises:
            StageError: If the first of them is another one, or none is due.
        """
        study, participant = self._at(name, player_id)
        due = self.due_blocks(study, participant, self.study_store.trials(participant.id))
        if not due or (due[0].block.name, due[0].turn) != (block, turn):
            now = THE_BLOCK.format(title=_title(study, due[0])) if due else NO_BLOCK
            raise StageError(OTHER_BLOCK.format(now=now, block=block))
        return participant, due

    def _check_asked(self, study: Study, participant: Participant, trials: Sequence[Trial]) -> None:
        if due := self.due_blocks(study, participant, trials):
            raise StageError(QUESTIONS_FIRST.format(title=_title(study, due[0])))

    def _note_withdrawal(self, participant_id: str, erase: bool) -> None:
        """Withdraw a participant; StageError if they are at the end already."""
        participant = self.study_store.participant(participant_id)
        if participant.stage in ("complete", "withdrawn"):
            raise StageError(NO_WITHDRAWAL.format(stage=_describe(participant.stage)))
        self.study_store.withdraw(participant, self._now(), erase)

    def _at(self, name: str, player_id: str | None, *stages: str) -> tuple[Study, Participant]:
        """An open study and a participant; StageError if they are at none of the stages.

        Without `stages` they may be at any.
        """
        study, participant = self.open_study(name), self.participant(name, player_id)
        if stages and participant.stage not in stages:
            expected = _describe(stages[0])
            for stage in stages[1:]:
                expected = OR.format(one=expected, other=_describe(stage))
            present = _describe(participant.stage)
            raise StageError(BELONGS_TO.format(stage=present, other=expected))
        return study, participant

    def _note_return(
        self,
        study: Study,
        participant: Participant,
        invitation: str | None,
        outside_ids: Mapping[str, str],
        now: int,
    ) -> None:
        """Note that a participant came back, with another invitation or new IDs if so."""
        if participant.stage == "withdrawn":
            self.recruitment.note(participant.id, "after leaving", now)
            return
        if invitation is not None and invitation != participant.invitation:
            self.study_store.set_invitation(participant.id, invitation)
        # the first one names the person; the others may be of the platform's session
        for name in study.protocol.outside_ids[1:]:
            stored_id = self.study_store.identity(participant.id, name)
            if name in outside_ids and outside_ids[name] != stored_id:
                self.study_store.set_identity(participant.id, name, outside_ids[name])

    def _turn_away_if_full(self, study: Study, participant: Participant, now: int) -> None:
        """Withdraw a person who has not agreed yet, if every place is taken."""
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

    def _add(self, study: Study, participant: Participant, outside_ids: Mapping[str, str]) -> None:
        """Add a new participant, and note whether a person's ID came before."""
        newness = None
        if participant.kind == "human":
            newness = self.recruitment.newness_of_id(study, outside_ids)
        with self.lobby.store.transaction():
            if newness == "repeated":
                self.recruitment.note_repeated_id(study, outside_ids, participant.joined_ms)
            detail = {} if newness is None else {"outside_id": newness}
            self.study_store.add_participant(participant, outside_ids, detail)

    def add_study(self, study: Study) -> None:
        """Add the study to the database; StageError if it has another study of this name."""
        stored = add_series(self.lobby.store, study.row())
        if is_same_study(stored, study):
            return
        _log.warning(
            "%s holds another study %r (protocol hash %s): serve this one on a database of its own, or give it another name",
            self.study_store.path,
            study.name,
            stored.protocol_hash[:12],
        )
        raise StageError(NOT_HERE.format(name=study.name))

    async def _board(self, participant: Participant) -> Session:
        session = await self.session(participant)
        if session is not None:
            return session
        participation = self._participations.of(participant)
        return self.lobby.new_board(participant.player_id, participation)

    def _note_break(self, study: Study, participant: Participant, trials: Sequence[Trial]) -> None:
        if break_due(study.protocol, participant, trials):
            length = self._now() - (trials[-1].ended_ms or 0)
            done = sum(trial.phase == "ranked" for trial in trials)
            detail = {"after": done, "length_ms": length}
            self.study_store.add_stage_event(participant.id, self._now(), "break", detail)

    def _terrain(
        self, study: Study, participant: Participant, phase: Phase, trial: int
    ) -> tuple[int, int]:
        """The index and the seed of the terrain of a participant's trial."""
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


def _can_change_device(participant: Participant) -> bool:
    has_agreed = participant.kind == "human" and participant.consent_ms is not None
    return has_agreed and participant.stage != "withdrawn"


def _describe(stage: str) -> Sentence:
    return _STAGES[stage]


def _title(study: Study, due: DueBlock) -> Sentence:
    """The title of a block, which a refusal says in its reader's language."""
    place = study.protocol.blocks.index(due.block)
    return own_sentence(f"blocks[{place}].title", due.block.title)


OR = Sentence("stage.or", "{one} or {other}")
_STAGES = {
    "consent": Sentence("stage.consent", "the consent"),
    "instructions": Sentence("stage.instructions", "the instructions"),
    "tutorial": Sentence("stage.tutorial", "the tutorial"),
    "questions": Sentence("stage.questions", "the questions"),
    "warm_up": Sentence("stage.warm_up", "the warm-up"),
    "ranked": Sentence("stage.ranked", "the ranked episodes"),
    "debrief": Sentence("stage.debrief", "the debrief"),
    "complete": Sentence("stage.complete", "the end"),
    "withdrawn": Sentence("stage.withdrawn", "the end (withdrawn)"),
}
