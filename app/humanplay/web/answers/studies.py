"""Answers about studies and those who take part in them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from humanplay.db.rows import Phase
from humanplay.db.study_rows import Stage
from humanplay.study.outcome import Outcome
from humanplay.web.answers.base import Answer, Configuration
from humanplay.web.answers.boards import Board
from humanplay.web.answers.server import Task

Status = Literal["open", "secret kept", "closed"]


class ListedStudy(Answer):
    """A study of this server."""

    name: str
    title: str
    status: Status
    recruitment: str = Field(description="invitation, panel or open")
    warm_up: int = Field(description="practice episodes")
    ranked: int = Field(description="ranked episodes")


class Study(Answer):
    """What a study has published."""

    name: str
    title: str
    status: Status
    protocol_hash: str
    commitment: str = Field(description="SHA-256 of the secret")
    secret: str | None = Field(description="null until the study is closed")
    task: Task
    level: str
    rows: int | None = Field(default=None, description="cells; absent without a grid of given size")
    cols: int | None = Field(default=None, description="cells; absent without a grid of given size")
    config: Configuration = Field(description="the environment's own configuration")
    warm_up: int
    ranked: int
    players: int
    consent_version: str


class Consent(Answer):
    """What a participant agrees to."""

    version: str
    text: str = Field(description="paragraphs, split by blank lines")


class Question(Answer):
    """A question that shows whether the instructions were understood."""

    question: str
    choices: list[str]


class ShownChoice(Answer):
    """A choice, at the place where it is shown."""

    value: int = Field(description="what is sent for it")
    text: str


class ShownQuestion(Answer):
    """A question of a block; a field that its kind lacks is absent."""

    kind: Literal["choice", "several", "likert", "scale", "number", "text", "statement"]
    name: str
    question: str
    needed: bool = Field(description="it cannot be left out")
    declinable: bool = Field(description="prefer not to say is offered: null is sent for it")
    choices: list[ShownChoice] | None = Field(default=None, description="of choice and several")
    rows: list[str] | None = Field(default=None, description="of likert: the statements")
    points: list[str] | None = Field(
        default=None, description="of likert: from one end to the other"
    )
    steps: int | None = Field(default=None, description="of scale: 0 to one less is sent")
    low: str | None = Field(default=None, description="of scale: its low end")
    high: str | None = Field(default=None, description="of scale: its high end")
    minimum: float | None = Field(default=None, description="of number")
    maximum: float | None = Field(default=None, description="of number")
    max_length: int | None = Field(default=None, description="of text: its characters at most")
    whole: bool | None = Field(default=None, description="of number")
    unit: str | None = Field(default=None, description="of number")
    long: bool | None = Field(default=None, description="of text: several lines")


class ShownBlock(Answer):
    """Questions on one screen."""

    name: str
    turn: int = Field(description="ranked episodes done, between sets; else 0")
    title: str
    intro: str
    can_be_skipped: bool
    questions: list[ShownQuestion]


class Count(Answer):
    """How many episodes of a stage are over."""

    done: int
    of: int


class Practice(Answer):
    """What the warm-up must come to before the first ranked episode."""

    text: str = Field(description="for the participant")
    number: int = Field(description="of the try, from 1")
    tries: int


class Tutorial(Answer):
    """Whether the tutorial is over."""

    done: bool


class RankedResult(Answer):
    """A ranked episode of the participant's."""

    trial: int = Field(description="from 0")
    outcome: str
    steps: int
    score: float


class DebriefPolicy(Answer):
    """What the debrief's policy came to on the practice terrains."""

    name: str
    mean_steps_warm_up: float
    own_mean_steps_warm_up: float = Field(description="the participant's")


class Debrief(Answer):
    """The participant's own figures, at the end."""

    mean_score: float | None
    mean_steps: float | None
    episodes: list[RankedResult]
    policy: DebriefPolicy | None
    warm_up_terrains: int = Field(description="that can be shown again")
    ranked_terrains: int = Field(description="that can be shown again")


class Ending(Answer):
    """What somebody reads who has come to an end."""

    outcome: str = Field(description=", ".join(Outcome))
    code: str | None = Field(description="for the place that sent them")
    address: str | None = Field(description="that leads back there")
    sentence: str | None


class Settings(Answer):
    """What the participant chose."""

    modality: Literal["keyboard", "touch"] | None
    palette: Literal["standard", "colour-blind", "high-contrast"]
    keys: dict[str, list[str]] | None
    language: str | None = Field(description="null if the study is offered in one alone")


class Participation(Answer):
    """Where a participant stands."""

    study: str
    title: str
    languages: list[str] = Field(description="in which the study is offered")
    task: Task
    participant: str = Field(description="what the participant can quote")
    stage: Stage
    consent: Consent
    questions: list[Question]
    instructions: str = Field(
        description="the study's own, below the task's; paragraphs split by blank lines"
    )
    hint: str = Field(description="what stands beside the board; empty without one")
    tries_left: int | None = Field(description="at the questions; null: as many as are wanted")
    device: str = Field(description="any or computer: with which people may take part")
    right: list[bool] | None = Field(description="which of the answers just given were right")
    why: list[str] | None = Field(description="what explains the wrong ones")
    block: ShownBlock | None = Field(description="questions that come before anything else")
    warm_up: Count = Field(description="of this try at the practice")
    practice: Practice | None = Field(description="null if the warm-up need not come to anything")
    ranked: Count
    tutorial: Tutorial
    break_due: bool
    can_be_erased: bool = Field(description="whether leaving may ask for erasure")
    pause_after_s: float
    rules: dict[str, str] = Field(description="figures that the texts name")
    session: str | None
    about: Board | None
    phase: Phase | None = Field(description="of the newest episode")
    settings: Settings
    debrief: Debrief | None
    note: str | None = Field(
        description="why the participant cannot go on, or what becomes of what was played"
    )
    ending: Ending | None = Field(description="null while the participant can go on")
    invited: bool
    supervised_until_ms: int | None
    recovery_code: str | None = Field(
        description="with which they can go on on another device; null before the consent and after leaving"
    )


class Ticket(Answer):
    """What leads to a participant's place from another device."""

    link: str = Field(description="the page's address, and the place's token after #go=")
    until_ms: int
    qr: list[str] = Field(description="rows of the link's QR code, a character a module: 1 is dark")
