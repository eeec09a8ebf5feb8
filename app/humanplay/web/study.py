"""Taking part in a study over HTTP: the study's page uses it, and so does a script that takes part."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated, Literal, TypeVar

import segno
from fastapi import APIRouter, Depends, HTTPException, Path, Request, Response
from pydantic import Field, field_validator, model_validator

from humanplay.board.messages import PRINTABLE, Message
from humanplay.board.participation import RefusedError
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
from humanplay.study.protocol import Arm, DraftStudyError, Protocol, StudyError, UnknownStudyError
from humanplay.study.questions import shown
from humanplay.study.recruitment import LONGEST_ID, Arrival, supervised_until_ms
from humanplay.study.templates import placeholder_values
from humanplay.task import describe
from humanplay.web.access import PARTICIPANT, participant_of, remember_player, services_of
from humanplay.web.answers.replays import Costs, DebriefRuns
from humanplay.web.answers.studies import ListedStudy, Participation, Ticket
from humanplay.web.answers.studies import Study as StudyAnswer
from humanplay.web.api import session_summary
from humanplay.web.results import costs_of

router = APIRouter(prefix="/api/studies", tags=["studies"])
Name = Annotated[str, Path(max_length=100, description="of the study")]
State = dict[str, object]
T = TypeVar("T")
Index = Annotated[int, Path(ge=0, le=10_000)]

RULES = ("coverage", "lidar_radius", "max_steps")
"""What the page's own sentences say of the configuration, by the names of `humanplay.study.templates.PLACEHOLDERS`."""

WITHDRAWN_ANYHOW = "You have withdrawn."
OPENINGS = {
    Outcome.FAILED_QUESTIONS: "The questions were not all answered rightly in the tries that this study allows: it ends here. "
    "Thank you.",
    Outcome.FAILED_PRACTICE: "The practice was not passed in the tries that this study allows: it ends here. Thank you.",
    Outcome.FAILED_ATTENTION: "Some questions were there to see whether they are read, and too many were not answered as they "
    "asked: the study ends here. Thank you.",
}
"""What somebody reads first for whom it ends without their wish."""
WITHDRAWN = (
    "{opening} What you had played until then is kept without your name. To have it erased, write to {contact} and "
    "give them your label {label}."
)
WITHDRAWN_AND_KEPT = "{opening} What you had played until then is kept without your name."
WITHDRAWN_TO_ERASE = (
    "{opening} You asked that what you had played be erased. The people who run the study do that before "
    "anything is published; that one person was erased stays counted. To hear when it is done, write to {contact} and give "
    "them your label {label}."
)


Id = Annotated[str, Field(max_length=LONGEST_ID + 1), PRINTABLE]
"""A parameter of a link; one that is an ID of the protocol may have one character less."""


UNFIT = (
    "This study is for a computer with a keyboard and a mouse or the like, and this browser has none. Nothing was recorded but "
    "that this page was opened."
)
OVER_QUOTA = "Every place of this study is taken, so you cannot take part. Nothing was recorded but that this page was opened."
AGAIN_ON_A_COMPUTER = " You can open the link that you were sent again on a computer."


class Join(Message):
    """Who joins: what the link that brought them holds, and the name of the script if it is no person."""

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
    """Answers by the name of their question: what is left out is not answered, null is "prefer not to say"."""

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

    @field_validator("keys")
    @classmethod
    def _no_key_twice(cls, keys: dict[str, list[str]] | None) -> dict[str, list[str]] | None:
        codes = [code for each in (keys or {}).values() for code in each]
        if len(set(codes)) < len(codes):
            raise ValueError("keys: one key cannot mean two directions")
        if len(codes) > 40:
            raise ValueError(f"keys: at most 40 in all, got {len(codes)}")
        return keys


@contextmanager
def answering_study_errors() -> Iterator[None]:
    """Answer a study's errors with 404, 409 or 422 and their sentence."""
    try:
        yield
    except UnknownStudyError as error:
        raise HTTPException(404, "there is no such study here: check the link") from error
    except DraftStudyError as error:
        raise HTTPException(409, "this study has not begun yet: come back later") from error
    except (NotJoinedError, NoTerrainError) as error:
        raise HTTPException(404, str(error.args[0])) from error
    except (StageError, RefusedError) as error:
        raise HTTPException(409, str(error)) from error
    except ValueError as error:
        raise HTTPException(422, str(error)) from error


# Coroutines, since FastAPI calls what is none on the one thread of the lists (`humanplay.web.server.READERS`).
async def _progress(request: Request) -> ParticipantProgress:
    return services_of(request).progress


async def _player(request: Request) -> str | None:
    return participant_of(request)


ProgressOf = Annotated[ParticipantProgress, Depends(_progress)]
Player = Annotated[str | None, Depends(_player)]


@dataclass(frozen=True)
class Asking:
    """Who asks for what of which study; `player` is None before joining."""

    request: Request
    progress: ParticipantProgress
    player: str | None
    name: str

    def write(self, work: Callable[..., T], *arguments: object) -> Awaitable[T]:
        """Return what comes of `work(name, player, *arguments)` on the thread of the writes."""
        return self.progress.lobby.store.write(partial(work, self.name, self.player, *arguments))

    async def after(self, doing: Awaitable[object]) -> State:
        """Return where the participant stands once something is done."""
        with answering_study_errors():
            await doing
        return await self.state()

    async def state(self) -> State:
        """Return where the participant stands."""
        progress = self.progress
        with answering_study_errors():
            study = progress.study(self.name)
            await progress.note_if_closed(study)
            find = partial(progress.participant, self.name, self.player)
            participant = await progress.lobby.store.read(find)
            return await participant_state(self.request, study, participant)

    async def trials_at_debrief(self) -> tuple[Study, list[Trial]]:
        """Return the participant's study and trials, once they are at the debrief."""
        progress = self.progress

        def read() -> tuple[Study, list[Trial]]:
            study = progress.study(self.name)
            participant = progress.participant(self.name, self.player)
            if participant.stage not in ("debrief", "complete"):
                raise StageError("the debrief comes after the last ranked round")
            trials = progress.study_store.trials(participant.id)
            if progress.due_blocks(study, participant, trials):
                raise StageError("the debrief comes after the questions")
            return study, trials

        with answering_study_errors():
            return await progress.lobby.store.read(read)


async def _asking(request: Request, progress: ProgressOf, player: Player, name: Name) -> Asking:
    return Asking(request, progress, player, name)


AskingOf = Annotated[Asking, Depends(_asking)]


async def participant_state(request: Request, study: Study, participant: Participant) -> State:
    """Return where a participant stands: all that the page needs."""
    progress, protocol = services_of(request).progress, study.protocol

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
    values, questions = placeholder_values(protocol), questions_of(protocol, arm)
    chosen = {"modality": None, "palette": "standard", "keys": None}
    return {
        "study": study.name,
        "title": protocol.title,
        "task": {**describe(protocol.environment), "keys": keys_of(protocol, arm)},
        "participant": participant_label(participant.id),
        "stage": participant.stage,
        "consent": protocol.consent.model_dump(),
        "questions": [each.model_dump(include={"question", "choices"}) for each in questions],
        "instructions": "" if arm is None else arm.instructions,
        "hint": "" if arm is None else arm.hint,
        "tries_left": tries_left,
        "device": protocol.device,
        "right": None,
        "why": None,
        "block": shown(due[0].block, participant.id, due[0].turn) if due else None,
        **_warm_up(protocol, participant, ended.count("warm_up")),
        "ranked": {"done": ended.count("ranked"), "of": protocol.ranked},
        "tutorial": {"done": "tutorial" in ended},
        "break_due": break_due(protocol, participant, trials),
        "can_be_erased": not protocol.keep_episodes_when_forgotten,
        "pause_after_s": protocol.pause_after_s,
        "rules": {name: values[name] for name in RULES if name in values},
        "session": participant.session_id,
        "about": None if session is None else await session_summary(progress.lobby, session),
        "phase": trials[-1].phase if trials else None,
        "settings": {**chosen, **json.loads(participant.settings)},
        "debrief": debrief,
        "note": note,
        "ending": ending and asdict(ending),
        "invited": participant.invitation is not None,
        "supervised_until_ms": supervised_until_ms(participant),
        "recovery_code": progress.recovery_code(study, participant),
    }


def _warm_up(protocol: Protocol, participant: Participant, ended: int) -> dict[str, object]:
    """How far the warm-up is, and what the practice asks for."""
    practice, of = protocol.practice, protocol.warm_up
    is_there = participant.stage == "warm_up"
    shown = practice and {
        "text": criterion(protocol),
        "number": ended // of + 1 if is_there else max(1, ended // of),
        "tries": practice.tries,
    }
    return {
        "warm_up": {"done": ended % of if is_there else min(ended, of), "of": of},
        "practice": shown,
    }


def _note(
    progress: ParticipantProgress, study: Study, participant: Participant, ending: Ending | None
) -> str | None:
    if ending is not None and ending.outcome is Outcome.UNFIT_DEVICE:
        has_text = (ending.code or ending.address or ending.sentence) is not None
        return UNFIT if has_text else UNFIT + AGAIN_ON_A_COMPUTER
    if ending is not None and ending.outcome is Outcome.OVER_QUOTA:
        return OVER_QUOTA
    if participant.stage == "withdrawn":
        if participant.consent_ms is None:
            return "You did not agree to take part. Nothing was recorded but that this page was opened."
        text = WITHDRAWN
        if study.protocol.keep_episodes_when_forgotten:
            text = WITHDRAWN_AND_KEPT
        elif progress.study_store.asks_erasure(participant.id):
            text = WITHDRAWN_TO_ERASE
        # a rehearsal may name nobody
        contact = study.protocol.declarations.contact or "whoever invited you"
        opening = None if ending is None else OPENINGS.get(ending.outcome)
        return text.format(
            opening=opening or WITHDRAWN_ANYHOW,
            contact=contact.rstrip("."),
            label=participant_label(participant.id),
        )
    if not study.is_running and participant.stage not in ("debrief", "complete"):
        return "This study has been closed: you cannot go on. Thank you for what you have played."
    return progress.recruitment.obstacle(study, participant)


@router.get("", response_model=list[ListedStudy], summary="The studies of this server")
async def list_studies(progress: ProgressOf) -> list[dict[str, str | int]]:
    """List the studies whose protocol is frozen.

    `status` is "open", "secret kept" or "closed"; `recruitment` is "invitation", "panel" or "open".
    """
    found: list[dict[str, str | int]] = []
    for name in progress.folder.names():
        try:
            study = progress.study(name)
        except (StudyError, StageError):
            continue
        await progress.note_if_closed(study)
        protocol, status = study.protocol, study.status
        found.append(
            {"name": name, "title": protocol.title, "status": status, "recruitment": protocol.recruitment,
             "warm_up": protocol.warm_up, "ranked": protocol.ranked}
        )  # fmt: skip
    return found


@router.get(
    "/{name}",
    response_model=StudyAnswer,
    response_model_exclude_unset=True,
    summary="What a study has published",
)
async def get_study(progress: ProgressOf, name: Name) -> dict[str, object]:
    """Return what fixes protocol and terrains before anybody has played; `secret` is null until the study is closed."""
    with answering_study_errors():
        study = progress.study(name)
    await progress.note_if_closed(study)
    protocol, config = study.protocol, study.protocol.env_config
    values = config.to_dict()
    return {
        "name": name,
        "title": protocol.title,
        "status": study.status,
        "protocol_hash": study.protocol_hash,
        "commitment": study.commitment,
        "secret": None if study.is_open else study.secret.hex(),
        "task": describe(protocol.environment),
        "level": config.level,
        **{side: values[side] for side in ("rows", "cols") if side in values},
        "config": values,
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
async def join(asks: AskingOf, response: Response, wanted: Join | None = None) -> State:
    """Join, or resume: 201 for a new participant, 200 for one who returns. The cookie that is set is of studies alone.

    A person needs the link's invitation or outside id where the study's recruitment asks for one, and 409 says so. Agreeing
    to the consent text uses it up; joining does not. A script needs none.
    """
    wanted, progress = wanted or Join(), asks.progress
    player_id = asks.player or progress.lobby.sources.player_id()
    with answering_study_errors():
        single = {name: each for name, each in wanted.outside_ids.items() if isinstance(each, str)}
        repeated = frozenset(wanted.outside_ids.keys() - single.keys())
        comes = Arrival(single, wanted.script, wanted.invitation, repeated)
        enter = partial(progress.join, asks.name, player_id, comes)
        participant, is_new = await progress.lobby.store.write(enter)
        answer = await participant_state(asks.request, progress.study(asks.name), participant)
    response.status_code = 201 if is_new else 200
    remember_player(response, asks.request, player_id, PARTICIPANT)
    return answer


@router.get("/{name}/me", response_model=Participation, summary="Where I stand")
async def me(asks: AskingOf) -> State:
    """Return where the participant stands, 404 before joining; a page that was reloaded begins here."""
    return await asks.state()


@router.post("/{name}/consent", response_model=Participation, summary="Agree to take part, or not")
async def consent(asks: AskingOf, given: ConsentAnswer) -> State:
    """Answer the consent text; `agree` false leaves the study."""
    answer = given.version, given.agree, given.unfit
    return await asks.after(asks.write(asks.progress.consent, *answer))


@router.post("/{name}/advance", response_model=Participation, summary="Go on to the next stage")
async def advance(asks: AskingOf, left: Advance) -> State:
    """Leave the instructions, the tutorial once it was played, or the debrief."""
    return await asks.after(asks.write(asks.progress.advance, left.from_))


@router.post("/{name}/answers", response_model=Participation, summary="Answer the questions")
async def answers(asks: AskingOf, given: Answers) -> State:
    """Check the answers: `right` says which were right, `why` explains the others; with all right the warm-up is next.

    Every attempt is recorded.
    """
    with answering_study_errors():
        right, why = await asks.write(asks.progress.answer, given.answers)
    return {**await asks.state(), "right": right, "why": why}


@router.post("/{name}/block", response_model=Participation, summary="Answer a block of questions")
async def answer_block(asks: AskingOf, given: BlockAnswers) -> State:
    """Store the answers to the block that stands under `block`: nothing goes on before it is answered, or skipped."""
    answered = given.block, given.turn, given.answers
    return await asks.after(asks.write(asks.progress.answer_block, *answered))


@router.post("/{name}/skip", response_model=Participation, summary="Skip the last questions")
async def skip_blocks(asks: AskingOf, asked: AskedBlock) -> State:
    """Skip all blocks that are left before the debrief; one that stands elsewhere cannot be skipped."""
    return await asks.after(asks.write(asks.progress.skip_blocks, asked.block, asked.turn))


@router.post("/{name}/next", response_model=Participation, summary="Begin the next episode")
async def begin_next(asks: AskingOf) -> State:
    """Begin the next episode of the stage.

    While one runs nothing changes, so no terrain can be drawn again.
    """
    return await asks.after(asks.progress.begin_next(asks.name, asks.player))


@router.post("/{name}/give-up", response_model=Participation, summary="Give the running episode up")
async def abandon(asks: AskingOf, given: AbandonEpisode) -> State:
    """Abandon the running episode: it counts as one that was left, and its terrain does not come again."""
    frame = given.episode, given.step
    return await asks.after(asks.progress.abandon(asks.name, asks.player, *frame))


@router.post(
    "/{name}/settings", response_model=Participation, summary="Choose keys, palette, touch"
)
async def settings(asks: AskingOf, chosen: ParticipantSettings) -> State:
    """Store keys, palette and modality with the participant: how somebody played is part of the data."""
    with answering_study_errors():
        actions = asks.progress.study(asks.name).protocol.environment.actions
        if strange := [each for each in chosen.keys or {} if each not in actions]:
            raise ValueError(f"keys: expected keys of {', '.join(actions)}, got {strange[0]!r}")
    changed = chosen.model_dump(exclude_none=True)
    return await asks.after(asks.write(asks.progress.set_settings, changed))


@router.post("/{name}/supervise", response_model=Participation, summary="The operator's code")
async def supervise(asks: AskingOf, typed: OperatorCode) -> State:
    """Check the operator's code of the day, which `humanplay study supervise` prints: the session is supervised from now.

    A wrong code is refused with 409 and recorded; after ten no code of this participant is looked at.
    """
    return await asks.after(asks.write(asks.progress.supervise, typed.code))


@router.post("/{name}/elsewhere", response_model=Ticket, summary="Go on on another device")
async def elsewhere(asks: AskingOf, here: Page) -> State:
    """Return a link to the participant's place, and its QR code.

    It holds for 15 minutes, and for one device.
    """
    with answering_study_errors():
        ticket = await asks.progress.lobby.store.read(
            partial(asks.progress.ticket, asks.name, asks.player)
        )
    link = f"{here.page}#go={ticket.token}"
    rows = ["".join(map(str, row)) for row in segno.make(link, error="m", micro=False).matrix]
    return {"link": link, "until_ms": ticket.until_ms, "qr": rows}


@router.post("/{name}/go-on", response_model=Participation, summary="Go on here")
async def go_on_here(asks: AskingOf, response: Response, brings: GoOn) -> State:
    """Go on here, by a link's token or a recovery code; the device before stops.

    What is played, in which order, and the arm stay the same. After ten wrong codes for a place none is
    looked at.
    """
    progress = asks.progress
    player_id = asks.player or progress.lobby.sources.player_id()
    with answering_study_errors():
        participant = await progress.go_on_here(asks.name, player_id, brings.token, brings.code)
        answer = await participant_state(asks.request, progress.study(asks.name), participant)
    remember_player(response, asks.request, player_id, PARTICIPANT)
    return answer


@router.post("/{name}/withdraw", response_model=Participation, summary="Leave the study")
async def withdraw(asks: AskingOf, chosen: Withdrawal | None = None) -> State:
    """Withdraw and abandon the running episode, and ask that all be erased if `erase`; `note` says what becomes of it."""
    erase = chosen is not None and chosen.erase
    return await asks.after(asks.progress.withdraw(asks.name, asks.player, erase))


@router.get(
    "/{name}/debrief/{index}",
    response_model=DebriefRuns,
    summary="A terrain again, with a policy",
)
async def debrief(asks: AskingOf, index: Index, phase: Shown = "warm_up") -> dict[str, object]:
    """Return your own episode and the policy's on the same terrain, frame by frame, once you are at the debrief.

    Ranked terrains, in the order in which you played them, are shown once the study is closed.
    """
    study, trials = await asks.trials_at_debrief()
    with answering_study_errors():
        return await services_of(asks.request).debriefs.replays(study, trials, phase, index)


@router.get(
    "/{name}/debrief/{index}/costs",
    response_model=Costs,
    summary="What your moves on a terrain cost",
)
async def debrief_costs(
    asks: AskingOf, index: Index, phase: Shown = "warm_up"
) -> dict[str, object]:
    """Return what the moves of your own episode cost, once you are at the debrief; of a ranked one once the study is closed."""
    study, trials = await asks.trials_at_debrief()
    with answering_study_errors():
        own = own_trial(study, trials, phase, index)
    store = asks.progress.lobby.store
    record = await store.read(lambda: store.load_record(own.id))
    return await costs_of(asks.request, record, study.policy_files)
