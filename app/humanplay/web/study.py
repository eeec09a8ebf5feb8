"""Taking part in a study over HTTP; the study's page uses it, and so do scripts."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Annotated, Literal, TypeVar

import segno
from fastapi import APIRouter, Depends, HTTPException, Path, Request, Response
from pydantic import Field, field_validator, model_validator

from humanplay.board.messages import PRINTABLE, Message
from humanplay.board.participation import RefusedError
from humanplay.db.store import StoreError
from humanplay.db.study_rows import Participant, participant_label
from humanplay.db.trial import Trial
from humanplay.study.arms import keys_of, questions_of
from humanplay.study.asking import DueBlock, break_due
from humanplay.study.debrief import NoTerrainError, Shown, own_trial
from humanplay.study.folder import Study
from humanplay.study.outcome import Outcome
from humanplay.study.outcomes import Ending
from humanplay.study.practice import criterion
from humanplay.study.progress import NotJoinedError, ParticipantProgress, StageError
from humanplay.study.protocol import (
    SOURCE_LANGUAGE,
    DraftStudyError,
    Protocol,
    StudyError,
    UnknownStudyError,
)
from humanplay.study.protocol_arms import Arm
from humanplay.study.questions import shown
from humanplay.study.recruitment import LONGEST_ID, Arrival, supervised_until_ms
from humanplay.study.templates import placeholder_values
from humanplay.study.translation import localized, own_sentence
from humanplay.study.wording import Wording, preferred, software_wording, wording_of
from humanplay.task import describe
from humanplay.task.sentences import Sentence, sentence_of
from humanplay.web.access import PARTICIPANT, participant_of, remember_player, services_of
from humanplay.web.answers.replays import Costs, DebriefRuns
from humanplay.web.answers.studies import ListedStudy, Participation, Ticket
from humanplay.web.answers.studies import Study as StudyAnswer
from humanplay.web.api import session_summary
from humanplay.web.errors import status_of
from humanplay.web.results import costs_of

router = APIRouter(prefix="/api/studies", tags=["studies"])
Name = Annotated[str, Path(max_length=100, description="of the study")]
State = dict[str, object]
T = TypeVar("T")
Index = Annotated[int, Path(ge=0, le=10_000)]

RULES = ("coverage", "lidar_radius", "max_steps")
"""The placeholders of `humanplay.study.templates` that the page's sentences have."""

WITHDRAWN_ANYHOW = Sentence("left.anyhow", "You have withdrawn.")
OPENINGS = {
    Outcome.FAILED_QUESTIONS: Sentence(
        "left.failed_questions",
        "The questions were not all answered rightly in the tries that this study allows: it ends here. Thank you.",
    ),
    Outcome.FAILED_PRACTICE: Sentence(
        "left.failed_practice",
        "The practice was not passed in the tries that this study allows: it ends here. Thank you.",
    ),
    Outcome.FAILED_ATTENTION: Sentence(
        "left.failed_attention",
        "Some questions were there to see whether they are read, and too many were not answered as they asked: the "
        "study ends here. Thank you.",
    ),
}
"""What participants read first for whom the study ends without their wish."""
WITHDRAWN = Sentence(
    "left.kept",
    "{opening} What you had played until then is kept without your name. To have it erased, write to {contact} and "
    "give them your label {label}.",
)
WITHDRAWN_AND_KEPT = Sentence(
    "left.kept_for_good",
    "{opening} What you had played until then is kept without your name.",
)
WITHDRAWN_TO_ERASE = Sentence(
    "left.to_erase",
    "{opening} You asked that what you had played be erased. The people who run the study do that before "
    "anything is published; that one person was erased stays counted. To hear when it is done, write to {contact} and give "
    "them your label {label}.",
)
NOT_AGREED = Sentence(
    "left.not_agreed",
    "You did not agree to take part. Nothing was recorded but that this page was opened.",
)
CLOSED = Sentence(
    "left.closed",
    "This study has been closed: you cannot go on. Thank you for what you have played.",
)
WHOEVER_INVITED = Sentence("left.whoever_invited", "whoever invited you")
UNFIT = Sentence(
    "left.unfit",
    "This study is for a computer with a keyboard and a mouse or the like, and this browser has none. Nothing was recorded but "
    "that this page was opened.",
)
UNFIT_COME_AGAIN = Sentence(
    "left.unfit_come_again",
    "This study is for a computer with a keyboard and a mouse or the like, and this browser has none. Nothing was recorded but "
    "that this page was opened. You can open the link that you were sent again on a computer.",
)
OVER_QUOTA = Sentence(
    "left.over_quota",
    "Every place of this study is taken, so you cannot take part. Nothing was recorded but that this page was opened.",
)
NO_SUCH_STUDY = Sentence("refused.no_such_study", "there is no such study here: check the link")
NOT_BEGUN = Sentence("refused.not_begun", "this study has not begun yet: come back later")
DEBRIEF_LATER = Sentence("refused.debrief_later", "the debrief comes after the last ranked round")
DEBRIEF_AFTER_QUESTIONS = Sentence(
    "refused.debrief_after_questions", "the debrief comes after the questions"
)


Id = Annotated[str, Field(max_length=LONGEST_ID + 1), PRINTABLE]
"""A parameter of a link; one that is an ID of the protocol may have one character less."""


class Join(Message):
    """Who joins: what their link holds, and the script's name if it is no person."""

    outside_ids: dict[str, Id | Annotated[list[Id], Field(max_length=20)]] = Field(
        default_factory=dict,
        max_length=50,
        description="parameters of the link; a list of what a parameter has that is there more than once",
    )
    script: Annotated[str, Field(min_length=1, max_length=80), PRINTABLE] | None = Field(
        default=None,
        description='what plays, for example "noisy-frontier"; a script for ever',
        examples=[None],
    )
    invitation: Annotated[str, Field(max_length=100)] | None = Field(
        default=None, description="the token of the link, in a study by invitation", examples=[None]
    )


class ConsentAnswer(Message):
    """The answer to the consent text of a version."""

    version: str = Field(max_length=40)
    agree: bool
    unfit: bool = Field(
        default=False,
        description="with agree false: nobody was asked, since the device does not fit",
    )


class Withdrawal(Message):
    """What becomes of what was played: it is kept without a name, or erased."""

    erase: bool = False


class Advance(Message):
    """Which stage is left."""

    from_: Literal["instructions", "tutorial", "debrief"] = Field(alias="from")


class Answers(Message):
    """The index of the choice for each question."""

    answers: list[Annotated[int, Field(ge=0)]] = Field(max_length=20, examples=[[0, 1, 1]])


class AskedBlock(Message):
    """The block of questions that is on the page."""

    block: str = Field(max_length=40)
    turn: int = Field(default=0, ge=0)


Choices = Annotated[list[Annotated[int, Field(ge=0)] | None], Field(max_length=40)]


class BlockAnswers(AskedBlock):
    """Question's name -> answer; null is "prefer not to say".

    A question that is left out is not answered.
    """

    answers: dict[
        Annotated[str, Field(max_length=40)],
        bool | int | float | Annotated[str, Field(max_length=5000)] | Choices | None,
    ] = Field(max_length=40, examples=[{"age": 34, "gender": 1, "skills": [3, 4, 2]}])


class OperatorCode(Message):
    """What the operator typed."""

    code: str = Field(max_length=100, examples=["7K3M-XWT5"])


class Page(Message):
    """The address of the study's page, as the participant's browser has it."""

    page: str = Field(max_length=500, examples=["https://play.example.org/study/pilot"])


class GoOn(Message):
    """The token of a link to a place, or a recovery code."""

    token: str | None = Field(default=None, max_length=60)
    code: str | None = Field(default=None, max_length=60, examples=["7F3A-12BC-K3M9-XWT5-9ABC"])

    @model_validator(mode="after")
    def _one_way(self) -> GoOn:
        if (self.token is None) is (self.code is None):
            raise ValueError("expected a token or a code, and not both")
        return self


class AbandonEpisode(Message):
    """The frame on which the episode is abandoned."""

    episode: str = Field(max_length=64)
    step: int = Field(ge=0)


class ParticipantSettings(Message):
    """What a participant chose; what is left out stays as it was."""

    modality: Literal["keyboard", "touch"] | None = None
    palette: Literal["standard", "colour-blind", "high-contrast"] | None = None
    keys: dict[str, list[Annotated[str, Field(max_length=32), PRINTABLE]]] | None = None
    stage: Annotated[str, Field(max_length=20)] | None = Field(
        default=None,
        description="where the page stood: keys that come late from the consent give way to those of an arm",
    )
    language: Annotated[str, Field(max_length=12)] | None = Field(
        default=None, description="one of the study's, before the consent", examples=[None]
    )

    @field_validator("keys")
    @classmethod
    def _no_key_twice(cls, keys: dict[str, list[str]] | None) -> dict[str, list[str]] | None:
        codes = [code for codes_of_action in (keys or {}).values() for code in codes_of_action]
        if len(set(codes)) < len(codes):
            raise ValueError("keys: one key cannot mean two directions")
        if len(codes) > 40:
            raise ValueError(f"keys: at most 40 in all, got {len(codes)}")
        return keys


@contextmanager
def answering_study_errors(wording: Wording) -> Iterator[None]:
    """Answer a study's errors with 404, 409, 422 or 503 and their sentence.

    Args:
        wording: In which the sentence is said.
    """
    try:
        yield
    except UnknownStudyError as error:
        raise HTTPException(404, wording.say(NO_SUCH_STUDY)) from error
    except DraftStudyError as error:
        raise HTTPException(409, wording.say(NOT_BEGUN)) from error
    except (NotJoinedError, NoTerrainError) as error:
        raise HTTPException(404, wording.say(sentence_of(error))) from error
    except (StageError, RefusedError) as error:
        raise HTTPException(409, wording.say(sentence_of(error))) from error
    except StoreError as error:
        raise HTTPException(status_of(error), wording.say(sentence_of(error))) from error
    except ValueError as error:
        raise HTTPException(422, wording.say(sentence_of(error))) from error


def wording_for(request: Request, protocol: Protocol) -> Wording:
    """The words of a study in the language that a request asks for."""
    return wording_of(protocol, _language_for(request, protocol))


def _language_for(request: Request, protocol: Protocol) -> str:
    """The language of a study that a request asks for, as the page does."""
    return preferred(request.headers.get("accept-language", ""), protocol.languages)


# Coroutines, since FastAPI calls what is none on the one thread of the lists (`humanplay.web.server.READERS`).
async def _progress(request: Request) -> ParticipantProgress:
    return services_of(request).progress


async def _player(request: Request) -> str | None:
    return participant_of(request)


ProgressOf = Annotated[ParticipantProgress, Depends(_progress)]
Player = Annotated[str | None, Depends(_player)]


@dataclass(frozen=True)
class StudyCall:
    """A participant's request about a study; `player` is None before they join."""

    request: Request
    progress: ParticipantProgress
    player: str | None
    name: str

    def write(self, work: Callable[..., T], *arguments: object) -> Awaitable[T]:
        """The result of `work(name, player, *arguments)`, called on the writing thread."""
        return self.progress.lobby.store.write(partial(work, self.name, self.player, *arguments))

    def answering_errors(self) -> AbstractContextManager[None]:
        """Answer errors in the words of the study, or of the software if it is unreadable."""
        try:
            protocol = self.progress.study(self.name).protocol
        except (StudyError, StageError):
            return answering_study_errors(software_wording(SOURCE_LANGUAGE))
        return answering_study_errors(wording_for(self.request, protocol))

    async def state_after(self, change: Awaitable[object]) -> State:
        """The participant's state after a change."""
        with self.answering_errors():
            await change
        return await self.state()

    async def state(self) -> State:
        """The participant's state."""
        progress = self.progress
        with self.answering_errors():
            study = progress.study(self.name)
            await progress.note_if_closed(study)
            find = partial(progress.participant, self.name, self.player)
            participant = await progress.lobby.store.read(find)
            return await participant_state(self.request, study, participant)

    async def trials_at_debrief(self) -> tuple[Study, list[Trial]]:
        """The participant's study and trials; StageError before the debrief."""
        progress = self.progress

        def read() -> tuple[Study, list[Trial]]:
            study = progress.study(self.name)
            participant = progress.participant(self.name, self.player)
            if participant.stage not in ("debrief", "complete"):
                raise StageError(DEBRIEF_LATER)
            trials = progress.study_store.trials(participant.id)
            if progress.due_blocks(study, participant, trials):
                raise StageError(DEBRIEF_AFTER_QUESTIONS)
            return study, trials

        with self.answering_errors():
            return await progress.lobby.store.read(read)


async def _study_call(
    request: Request, progress: ProgressOf, player: Player, name: Name
) -> StudyCall:
    return StudyCall(request, progress, player, name)


StudyCallOf = Annotated[StudyCall, Depends(_study_call)]


async def participant_state(request: Request, study: Study, participant: Participant) -> State:
    """A participant's state: all that the page needs."""
    progress, wording = services_of(request).progress, wording_for(request, study.protocol)
    protocol = localized(study.protocol, wording.language)
    study = replace(study, protocol=protocol)

    def read() -> tuple[
        list[Trial], str | None, Ending | None, int | None, list[DueBlock], Arm | None
    ]:
        trials = progress.study_store.trials(participant.id)
        ending = progress.ending(study, participant, trials)
        return (
            trials,
            _note(progress, study, participant, ending),
            ending,
            progress.tries_left(study, participant),
            progress.due_blocks(study, participant, trials),
            progress.arm(study, participant),
        )

    trials, note, ending, tries_left, due, arm = await progress.lobby.store.read(read)
    ended = [trial.phase for trial in trials if trial.ended_ms is not None]
    session, debrief = await progress.session(participant), None
    if participant.stage in ("debrief", "complete") and not due:
        debrief = await services_of(request).debriefs.summary(study, participant, trials)
    placeholders, questions = placeholder_values(protocol, wording), questions_of(protocol, arm)
    defaults = {"modality": None, "palette": "standard", "keys": None, "language": None}
    return {
        "study": study.name,
        "title": protocol.title,
        "languages": protocol.languages,
        "task": {**_task(protocol, wording), "keys": keys_of(protocol, arm)},
        "participant": participant_label(participant.id),
        "stage": participant.stage,
        "consent": protocol.consent.model_dump(),
        "questions": [
            question.model_dump(include={"question", "choices"}) for question in questions
        ],
        "instructions": "" if arm is None else arm.instructions,
        "hint": "" if arm is None else arm.hint,
        "tries_left": tries_left,
        "device": protocol.device,
        "right": None,
        "why": None,
        "block": shown(due[0].block, participant.id, due[0].turn) if due else None,
        **_warm_up(protocol, participant, ended.count("warm_up"), wording),
        "ranked": {"done": ended.count("ranked"), "of": protocol.ranked},
        "tutorial": {"done": "tutorial" in ended},
        "break_due": break_due(protocol, participant, trials),
        "can_be_erased": not protocol.keep_episodes_when_forgotten,
        "pause_after_s": protocol.pause_after_s,
        "rules": {name: placeholders[name] for name in RULES if name in placeholders},
        "session": participant.session_id,
        "about": None if session is None else await session_summary(progress.lobby, session),
        "phase": trials[-1].phase if trials else None,
        "settings": {**defaults, **json.loads(participant.settings)},
        "debrief": debrief,
        "note": note and wording.say(note),
        "ending": ending
        and {**asdict(ending), "sentence": wording.say(ending.sentence or "") or None},
        "invited": participant.invitation is not None,
        "supervised_until_ms": supervised_until_ms(participant),
        "recovery_code": progress.recovery_code(study, participant),
    }


def _task(protocol: Protocol, wording: Wording) -> dict[str, object]:
    """The task as the page needs it, in the words of the study."""
    environment = protocol.environment
    about = environment.about
    metrics = [
        {**asdict(metric), "name": wording.text(f"metric.{metric.name}", metric.name)}
        for metric in environment.metrics
    ]
    title = wording.text("task.title", about.title)
    instructions = about.instructions and wording.text("task.instructions", about.instructions)
    return {
        **describe(environment),
        "title": title,
        "instructions": instructions,
        "metrics": metrics,
    }


def _warm_up(
    protocol: Protocol, participant: Participant, ended: int, wording: Wording
) -> dict[str, object]:
    """How far the warm-up is, and what the practice asks for."""
    practice, length = protocol.practice, protocol.warm_up
    is_running = participant.stage == "warm_up"
    # each try at the practice is a warm-up of its own
    shown = practice and {
        "text": wording.say(criterion(protocol, wording)),
        "number": ended // length + 1 if is_running else max(1, ended // length),
        "tries": practice.tries,
    }
    done = ended % length if is_running else min(ended, length)
    return {"warm_up": {"done": done, "of": length}, "practice": shown}


def _note(
    progress: ParticipantProgress, study: Study, participant: Participant, ending: Ending | None
) -> str | None:
    """What a participant reads who cannot go on; None if they can."""
    if ending is not None and ending.outcome is Outcome.UNFIT_DEVICE:
        has_text = (ending.code or ending.address or ending.sentence) is not None
        return UNFIT if has_text else UNFIT_COME_AGAIN
    if ending is not None and ending.outcome is Outcome.OVER_QUOTA:
        return OVER_QUOTA
    if participant.stage == "withdrawn":
        if participant.consent_ms is None:
            return NOT_AGREED
        text = WITHDRAWN
        if study.protocol.keep_episodes_when_forgotten:
            text = WITHDRAWN_AND_KEPT
        elif progress.study_store.asks_erasure(participant.id):
            text = WITHDRAWN_TO_ERASE
        contact = study.protocol.declarations.contact.rstrip(".")
        opening = None if ending is None else OPENINGS.get(ending.outcome)
        return text.format(
            opening=opening or WITHDRAWN_ANYHOW,
            # a rehearsal may name nobody
            contact=own_sentence("declarations.contact", contact) if contact else WHOEVER_INVITED,
            label=participant_label(participant.id),
        )
    if not study.is_running and participant.stage not in ("debrief", "complete"):
        return CLOSED
    return progress.recruitment.obstacle(study, participant)


@router.get("", response_model=list[ListedStudy], summary="The studies of this server")
async def list_studies(progress: ProgressOf) -> list[dict[str, str | int]]:
    """List the studies whose protocol is frozen.

    `status` is "open", "secret kept" or "closed"; `recruitment` is "invitation", "panel" or "open".
    """
    studies: list[dict[str, str | int]] = []
    for name in progress.folder.names():
        try:
            study = progress.study(name)
        except (StudyError, StageError):
            continue
        await progress.note_if_closed(study)
        protocol = study.protocol
        studies.append(
            {
                "name": name,
                "title": protocol.title,
                "status": study.status,
                "recruitment": protocol.recruitment,
                "warm_up": protocol.warm_up,
                "ranked": protocol.ranked,
            }
        )
    return studies


@router.get(
    "/{name}",
    response_model=StudyAnswer,
    response_model_exclude_unset=True,
    summary="What a study has published",
)
async def get_study(progress: ProgressOf, name: Name) -> dict[str, object]:
    """Return the hashes that fix protocol and terrains before anybody plays.

    `secret` is null until the study is closed.
    """
    with answering_study_errors(software_wording(SOURCE_LANGUAGE)):
        study = progress.study(name)
    await progress.note_if_closed(study)
    protocol, config = study.protocol, study.protocol.env_config
    config_fields = config.to_dict()
    return {
        "name": name,
        "title": protocol.title,
        "status": study.status,
        "protocol_hash": study.protocol_hash,
        "commitment": study.commitment,
        "secret": None if study.is_open else study.secret.hex(),
        "task": describe(protocol.environment),
        "level": config.level,
        **{side: config_fields[side] for side in ("rows", "cols") if side in config_fields},
        "config": config_fields,
        "warm_up": protocol.warm_up,
        "ranked": protocol.ranked,
        "players": protocol.players,
        "consent_version": protocol.consent.version,
    }


@router.post(
    "/{name}/join",
    status_code=201,
    response_model=Participation,
    responses={200: {"model": Participation, "description": "for who took part before"}},
    summary="Take part, or go on",
)
async def join(call: StudyCallOf, response: Response, wanted: Join | None = None) -> State:
    """Join, or come back: 201 for a new participant, 200 for one who returns.

    A person needs the link's invitation or participant ID if the study's recruitment asks for one; otherwise the
    answer is 409. Agreeing to the consent text uses it up; joining does not. A script needs none. The cookie that
    is set is for studies alone.
    """
    wanted, progress = wanted or Join(), call.progress
    player_id = call.player or progress.lobby.sources.player_id()
    with call.answering_errors():
        sent = wanted.outside_ids
        outside_ids = {name: ident for name, ident in sent.items() if isinstance(ident, str)}
        repeated = frozenset(sent.keys() - outside_ids.keys())
        language = _language_for(call.request, progress.study(call.name).protocol)
        arrival = Arrival(outside_ids, wanted.script, wanted.invitation, repeated, language)
        join_study = partial(progress.join, call.name, player_id, arrival)
        participant, is_new = await progress.lobby.store.write(join_study)
        answer = await participant_state(call.request, progress.study(call.name), participant)
    response.status_code = 201 if is_new else 200
    remember_player(response, call.request, player_id, PARTICIPANT)
    return answer


@router.get("/{name}/me", response_model=Participation, summary="Where I stand")
async def me(call: StudyCallOf) -> State:
    """Return the participant's state; 404 before joining. A reloaded page begins here."""
    return await call.state()


@router.post("/{name}/consent", response_model=Participation, summary="Agree to take part, or not")
async def consent(call: StudyCallOf, answer: ConsentAnswer) -> State:
    """Answer the consent text; `agree` false leaves the study."""
    answered = call.write(call.progress.consent, answer.version, answer.agree, answer.unfit)
    return await call.state_after(answered)


@router.post("/{name}/advance", response_model=Participation, summary="Go on to the next stage")
async def advance(call: StudyCallOf, left: Advance) -> State:
    """Leave the instructions, the tutorial once it was played, or the debrief."""
    return await call.state_after(call.write(call.progress.advance, left.from_))


@router.post("/{name}/answers", response_model=Participation, summary="Answer the questions")
async def answers(call: StudyCallOf, attempt: Answers) -> State:
    """Check the answers: `right` says which were right, `why` explains the others.

    If all are right, the warm-up is next. Every attempt is recorded.
    """
    with call.answering_errors():
        language = _language_for(call.request, call.progress.study(call.name).protocol)
        right, explanations = await call.write(call.progress.answer, attempt.answers, language)
    return {**await call.state(), "right": right, "why": explanations}


@router.post("/{name}/block", response_model=Participation, summary="Answer a block of questions")
async def answer_block(call: StudyCallOf, block: BlockAnswers) -> State:
    """Store the answers to the block that the state has under `block`.

    Nothing goes on before it is answered or skipped.
    """
    stored = call.write(call.progress.answer_block, block.block, block.turn, block.answers)
    return await call.state_after(stored)


@router.post("/{name}/skip", response_model=Participation, summary="Skip the last questions")
async def skip_blocks(call: StudyCallOf, block: AskedBlock) -> State:
    """Skip the blocks that come just before the debrief; others cannot be skipped."""
    skipped = call.write(call.progress.skip_blocks, block.block, block.turn)
    return await call.state_after(skipped)


@router.post("/{name}/next", response_model=Participation, summary="Begin the next episode")
async def begin_next(call: StudyCallOf) -> State:
    """Begin the next episode of the stage.

    While one runs nothing changes, so no terrain can be drawn again.
    """
    return await call.state_after(call.progress.begin_next(call.name, call.player))


@router.post("/{name}/give-up", response_model=Participation, summary="Give the running episode up")
async def abandon(call: StudyCallOf, frame: AbandonEpisode) -> State:
    """Abandon the running episode; its terrain does not come again."""
    abandoned = call.progress.abandon(call.name, call.player, frame.episode, frame.step)
    return await call.state_after(abandoned)


@router.post(
    "/{name}/settings", response_model=Participation, summary="Choose keys, palette, touch"
)
async def settings(call: StudyCallOf, chosen: ParticipantSettings) -> State:
    """Store a participant's keys, palette, modality and language, as part of the data."""
    with call.answering_errors():
        protocol = call.progress.study(call.name).protocol
        if chosen.language is not None and chosen.language not in protocol.languages:
            offered = ", ".join(protocol.languages)
            raise ValueError(f"language: expected one of {offered}, got {chosen.language!r}")
        actions = protocol.environment.actions
        if unknown := [action for action in chosen.keys or {} if action not in actions]:
            raise ValueError(f"keys: expected keys of {', '.join(actions)}, got {unknown[0]!r}")
    changed = chosen.model_dump(exclude_none=True, exclude={"stage"})
    written = call.write(call.progress.set_settings, changed, chosen.stage)
    return await call.state_after(written)


@router.post("/{name}/supervise", response_model=Participation, summary="The operator's code")
async def supervise(call: StudyCallOf, typed: OperatorCode) -> State:
    """Check the operator's code of the day; if it is right, the session is supervised.

    `humanplay study supervise` prints the code. A wrong code is refused with 409 and recorded; after ten, no code of
    this participant is checked.
    """
    return await call.state_after(call.write(call.progress.supervise, typed.code))


@router.post("/{name}/elsewhere", response_model=Ticket, summary="Continue on another device")
async def elsewhere(call: StudyCallOf, here: Page) -> State:
    """Return a link to the participant's place, and its QR code.

    It holds for 15 minutes, and for one device.
    """
    with call.answering_errors():
        ticket = await call.progress.lobby.store.read(
            partial(call.progress.ticket, call.name, call.player)
        )
    link = f"{here.page}#go={ticket.token}"
    rows = ["".join(map(str, row)) for row in segno.make(link, error="m", micro=False).matrix]
    return {"link": link, "until_ms": ticket.until_ms, "qr": rows}


@router.post("/{name}/go-on", response_model=Participation, summary="Go on here")
async def go_on_here(call: StudyCallOf, response: Response, brings: GoOn) -> State:
    """Go on here, by a link's token or a recovery code; the previous device stops.

    Instances, their order and the arm stay the same. After ten wrong codes for a place, none is checked.
    """
    progress = call.progress
    player_id = call.player or progress.lobby.sources.player_id()
    with call.answering_errors():
        participant = await progress.go_on_here(call.name, player_id, brings.token, brings.code)
        answer = await participant_state(call.request, progress.study(call.name), participant)
    remember_player(response, call.request, player_id, PARTICIPANT)
    return answer


@router.post("/{name}/withdraw", response_model=Participation, summary="Leave the study")
async def withdraw(call: StudyCallOf, chosen: Withdrawal | None = None) -> State:
    """Withdraw, and abandon the running episode; with `erase`, ask that all be erased.

    `note` says what becomes of the episodes.
    """
    erase = chosen is not None and chosen.erase
    return await call.state_after(call.progress.withdraw(call.name, call.player, erase))


@router.get(
    "/{name}/debrief/{index}",
    response_model=DebriefRuns,
    summary="A terrain again, with a policy",
)
async def debrief(call: StudyCallOf, index: Index, phase: Shown = "warm_up") -> dict[str, object]:
    """Return your own episode and the policy's on the same terrain, frame by frame.

    It is for participants at the debrief. Ranked terrains, in the order in which you played them, are shown once the
    study is closed.
    """
    study, trials = await call.trials_at_debrief()
    with call.answering_errors():
        return await services_of(call.request).debriefs.replays(study, trials, phase, index)


@router.get(
    "/{name}/debrief/{index}/costs",
    response_model=Costs,
    summary="What your moves on a terrain cost",
)
async def debrief_costs(
    call: StudyCallOf, index: Index, phase: Shown = "warm_up"
) -> dict[str, object]:
    """Return what the moves of your own episode cost.

    It is for participants at the debrief; of a ranked episode once the study is closed.
    """
    study, trials = await call.trials_at_debrief()
    with call.answering_errors():
        trial = own_trial(study, trials, phase, index)
    store = call.progress.lobby.store
    record = await store.read(lambda: store.load_record(trial.id))
    return await costs_of(call.request, record, study.policy_files)
