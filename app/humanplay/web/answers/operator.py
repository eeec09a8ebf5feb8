"""Answers to the operator: console, studies, invitations, payments, exports."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from humanplay.db.rows import Phase
from humanplay.db.study_rows import Stage
from humanplay.db.trial import ParticipantKind
from humanplay.study.outcome import Outcome
from humanplay.web.answers.base import Answer
from humanplay.web.answers.leaderboard import StudyFigure
from humanplay.web.answers.server import Task
from humanplay.web.answers.studies import Status


class LoggedIn(Answer):
    """Whether the operator is logged in."""

    logged_in: bool


class FolderStudy(Answer):
    """A study in the server's folder, drafts and broken ones too."""

    name: str
    title: str
    status: Literal["draft", "open", "secret kept", "closed", "broken"]
    error: str | None = Field(description="what is wrong with a broken one")


class LiveBoard(Answer):
    """A board that somebody plays now."""

    session: str
    study: str | None = Field(description="null outside of studies")
    label: str | None = Field(description="what its participant can quote")
    kind: str = Field(description="human or script")
    phase: Phase | None = Field(description="of the study")
    trial: int | None = Field(description="of the phase, from 0")


class Disk(Answer):
    """The disk that the database is on."""

    free: int = Field(description="bytes")
    total: int = Field(description="bytes")
    is_low: bool


class DatabaseFile(Answer):
    """The database."""

    name: str = Field(description="of its file")
    size: int = Field(description="bytes, without its log")
    wal_size: int = Field(description="bytes in its write-ahead log")


class Check(Answer):
    """What SQLite's own check found."""

    result: str = Field(description='"ok", or what is damaged')
    is_whole: bool
    at_ms: int = Field(description="ms since 1970")


class ChainHead(Answer):
    """The newest entry of the chain of hashes."""

    entries: int = Field(description="in all")
    head: str = Field(description="SHA-256 (hex) of the newest; empty without any")


class DatabaseHealth(Answer):
    """How disk and database are."""

    disk: Disk
    database: DatabaseFile
    last_write_ms: int = Field(description="ms since 1970")
    check: Check | None = Field(description="null while the first check is under way")
    chain: ChainHead | None = Field(description="null if it cannot be read")


class Gauges(Answer):
    """What shows first that a server is overloaded."""

    move_p99_seconds: float = Field(
        description="seconds that 99 of 100 moves took at most; 0 before the first"
    )
    waiting_jobs: float = Field(
        description="ghosts, costs, exports and policies' episodes that wait"
    )
    waiting_writes: float = Field(description="of the database")
    backup_age_seconds: float = Field(
        description="seconds since the newest verified backup; -1 without"
    )
    backup_failures: float = Field(description="since the server's start")


class StorageOwner(Answer):
    """One of those for whom most is stored today."""

    kind: Literal["address", "player", "study"]
    name: str = Field(description="of a study; empty otherwise")
    bytes: int = Field(description="stored today (UTC), or charged to open boards")
    budget: int = Field(description="bytes a day")


class ServerHealth(DatabaseHealth):
    """How the server is."""

    watched: Gauges
    owners: list[StorageOwner] = Field(description="the largest first")
    sessions: int = Field(description="boards in memory")
    up_s: int = Field(description="seconds since the start")


class ChosenName(Answer):
    """A name that a player chose."""

    name: str
    hidden: bool = Field(description="an operator has hidden it")
    chosen_ms: int = Field(description="ms since 1970")


class Failure(Answer):
    """What an environment raised at the move that ended an episode."""

    episode: str
    ended_ms: int | None = Field(description="ms since 1970; null while its study's secret is kept")
    seed: int | None = Field(description="of the instance; null while its study's secret is kept")
    report: str = Field(
        description="step (not while its study's secret is kept), action, error and traceback"
    )


class Overview(Answer):
    """Studies, boards that are played now, and the server's health."""

    studies: list[FolderStudy]
    boards: list[LiveBoard] = Field(description="those of participants first")
    health: ServerHealth
    names: list[ChosenName] = Field(description="the newest first")
    failures: list[Failure] = Field(description="of environments, the newest first")
    now_ms: int = Field(description="the server's time, ms since 1970")


class StageCount(Answer):
    """Who is at a stage of a study."""

    stage: Stage
    human: int = Field(description="people")
    script: int = Field(description="bots")


class Participant(Answer):
    """Somebody in a study, without anything that identifies them."""

    id: str
    label: str = Field(description="what the participant can quote")
    kind: ParticipantKind
    script: str | None = Field(description="name of a bot")
    stage: Stage
    joined_ms: int = Field(description="ms since 1970")
    minutes: int = Field(description="from joining to the newest sign")
    connections: int = Field(
        description="loads of the page that have sent a key or what happened to the page"
    )
    is_quiet: bool = Field(description="has not finished, and sent nothing for half an hour")
    left_at: str | None = Field(description="stage at which they withdrew")
    asks_erasure: bool
    deviations: int | None = Field(description="null while they are hidden")
    repeated: list[str] = Field(description="signs of taking part twice")
    not_attested: list[str] = Field(description="episodes that are not attested, and why")
    arm: str | None = Field(description="to which they are assigned")
    invitation: str | None = Field(description="id of the invitation that brought them")
    supervised_ms: int | None = Field(
        description="when the operator's code was typed last, ms since 1970"
    )
    warm_up: int = Field(description="practice episodes that ended")
    ranked: int | None = Field(description="ranked episodes that ended; null while they are hidden")
    mean_score: float | None = Field(
        description="over ranked episodes; null before the first, and hidden"
    )
    mean_steps: float | None = Field(
        description="moves, over ranked episodes; null before the first, and hidden"
    )
    outcomes: dict[str, int] = Field(description="how many ranked episodes ended with each outcome")


class LabelCount(Answer):
    """A data-quality flag, and how often it was set."""

    label: str
    episodes: int = Field(description="0 if it is of people, for the whole of their taking part")
    participants: list[str] = Field(description="their labels")


class LiveFigure(StudyFigure):
    """The people's estimate as it may be seen: nobody is in that of an open study."""

    claim: str = Field(description="what it may be called")
    set: str = Field(description="whom it is of")
    everybody: StudyFigure
    sentence: str


class LiveFigures(Answer):
    """The people's estimate and their data-quality flags."""

    figure: LiveFigure | None = Field(description="null before anybody has joined")
    labels: list[LabelCount] = Field(description="the commonest first")


class Invitation(Answer):
    """An invitation to a study."""

    id: str
    state: Literal["issued", "opened", "used", "revoked"]
    label: str | None = Field(description="of the participant who came by it")
    token: str | None = Field(description="of the link; null once it lets nobody in")
    issued_ms: int = Field(description="ms since 1970")
    revoked_ms: int | None = Field(description="ms since 1970")
    at_ms: int | None = Field(description="when it was opened or used, ms since 1970")


class Recruiting(Answer):
    """How people come into a study."""

    recruitment: Literal["open", "invitation", "panel"]
    code: str | None = Field(
        description="of the day, for supervised play; null unless the study runs"
    )
    code_until_ms: int | None = Field(description="ms since 1970")
    invitations: list[Invitation] = Field(description="the oldest first")


class OutcomeText(Answer):
    """How taking part can end, and what people read then."""

    outcome: str = Field(description=", ".join(Outcome))
    words: str = Field(description="who comes to it")
    text: str = Field(description="what they read; empty without one")


class OutcomeTexts(Answer):
    """What people read when they finish or leave."""

    outcomes: list[OutcomeText]
    outcomes_problem: str = Field(
        description="what is wrong with the file of the texts; empty if nothing is"
    )


class ExportFile(Answer):
    """A file that was made."""

    name: str
    size: int = Field(description="bytes")


class Export(Answer):
    """A report or a release that was asked for."""

    state: Literal["making", "ready", "failed"]
    began_ms: int = Field(description="ms since 1970")
    error: str | None = Field(description="why it failed")
    files: list[ExportFile] = Field(description="empty until they are ready")


class Exports(Answer):
    """The newest report and the newest release; null before one is asked for."""

    report: Export | None
    release: Export | None


class ConsoleStudy(Recruiting, LiveFigures, OutcomeTexts):
    """A study as its operator sees it."""

    name: str
    title: str
    status: Status
    frozen_ms: int = Field(description="ms since 1970")
    closed_ms: int | None = Field(description="ms since 1970; null while it is open")
    task: Task
    where: str = Field(description="what is played, in words")
    max_steps: int = Field(description="moves after which an episode times out")
    planned: int = Field(description="people that the protocol wants")
    cap: int | None = Field(description="people who may agree at most; null: no limit")
    places_taken: int = Field(
        description="of the cap; whoever agreed goes on, even if their place is free again"
    )
    warm_up: int = Field(description="practice episodes of each")
    ranked: int = Field(description="ranked episodes of each")
    stages: list[StageCount]
    participants: list[Participant] = Field(description="in the order of joining")
    exports: Exports
    now_ms: int = Field(description="the server's time, ms since 1970")


class ClosedStudy(Answer):
    """A study that was closed."""

    closed_ms: int | None = Field(description="ms since 1970")


class IssuedInvitations(Answer):
    """New invitations."""

    tokens: list[str] = Field(description="each goes into a link: /study/NAME?invitation=TOKEN")


class RevokedInvitations(Answer):
    """Invitations that were taken back."""

    revoked: list[str] = Field(description="their ids")


class ChangedTexts(Answer):
    """Whether the texts of the outcomes differ from before."""

    changed: bool


class HiddenName(Answer):
    """A player's name, and whether it is shown."""

    name: str
    hidden: bool


class Payments(Answer):
    """Whom to pay."""

    columns: list[str]
    rows: list[list[str]] = Field(description="a row for everybody who agreed, by `columns`")
    csv: str = Field(description="the same as a file")
    bulk: str | None = Field(description="Prolific's lines of bonuses; null if they do not apply")
    effective_pay: str = Field(description="what an hour was worth, a sentence; empty if unknown")
    without_consent: int = Field(description="people who have not agreed")
