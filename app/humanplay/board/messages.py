"""Every message that a board takes or sends, over HTTP and over the socket.

Messages that arrive are pydantic models and are checked strictly; an error is one plain sentence.
Frames and paths are the task's (`humanplay.task.View`). `static/common/messages.js` is the page's
copy.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import asdict
from string import ascii_uppercase
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import ErrorDetails

from humanplay.task import MAX_SEED
from humanplay.task.sentences import SentenceName

MAX_MESSAGE_BYTES = 64 * 1024
"""Longest message or body that is accepted."""
MAX_EVENTS_PER_MESSAGE = 200
"""Most input events in one message."""
KEY_CODES = frozenset(
    """
    Backquote Backslash BracketLeft BracketRight Comma Equal IntlBackslash IntlRo IntlYen Minus Period Quote Semicolon Slash
    AltLeft AltRight Backspace CapsLock ContextMenu ControlLeft ControlRight Enter MetaLeft MetaRight ShiftLeft ShiftRight
    Space Tab Convert KanaMode Lang1 Lang2 Lang3 Lang4 Lang5 NonConvert Delete End Help Home Insert PageDown PageUp
    ArrowDown ArrowLeft ArrowRight ArrowUp NumLock NumpadAdd NumpadBackspace NumpadClear NumpadClearEntry NumpadComma
    NumpadDecimal NumpadDivide NumpadEnter NumpadEqual NumpadHash NumpadMemoryAdd NumpadMemoryClear NumpadMemoryRecall
    NumpadMemoryStore NumpadMemorySubtract NumpadMultiply NumpadParenLeft NumpadParenRight NumpadStar NumpadSubtract Escape
    Fn FnLock PrintScreen ScrollLock Pause BrowserBack BrowserFavorites BrowserForward BrowserHome BrowserRefresh
    BrowserSearch BrowserStop Eject LaunchApp1 LaunchApp2 LaunchMail MediaPlayPause MediaSelect MediaStop MediaTrackNext
    MediaTrackPrevious Power Sleep AudioVolumeDown AudioVolumeMute AudioVolumeUp WakeUp Hyper Super Turbo Abort Resume
    Suspend Again Copy Cut Find Open Paste Props Select Undo Hiragana Katakana
    """.split()  # noqa: SIM905
).union(
    (f"Key{letter}" for letter in ascii_uppercase),
    (f"{name}{digit}" for name in ("Digit", "Numpad") for digit in range(10)),
    (f"F{number}" for number in range(1, 25)),
)
"""The keys of the standard (UI Events KeyboardEvent code Values, section 3)."""
_DRIVING = re.compile(
    r"Key[A-Z]|Digit\d|Numpad\w+|Arrow\w+|Intl\w+|Bracket\w+|Comma|Period|Slash|Semicolon|Quote"
    r"|Backslash|Minus|Equal|Backquote|Home|End|PageUp|PageDown|Insert|Delete"
)
DRIVING_KEYS = frozenset(filter(_DRIVING.fullmatch, KEY_CODES)) - {"NumpadEnter"}
"""The keys that may drive: those that a person may choose (static/common/keymap.js)."""
UNIDENTIFIED = "Unidentified"
"""The standard's code of a key that is none of these."""
PaceMode = Literal["follow", "timed", "paused"]
Milliseconds = Annotated[float, Field(allow_inf_nan=False)]


def _check_printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError(f"an id must be without control characters, got {_shown(text)}")
    return text


PRINTABLE = AfterValidator(_check_printable)
"""Checks an id that is made elsewhere and stored: no control or invisible characters."""


DrawnId = Annotated[str, Field(min_length=8, max_length=64), PRINTABLE]
"""A random id that a page makes."""


class BadMessageError(ValueError):
    """A message that this server rejects; the text is one sentence for its sender."""


class Message(BaseModel):
    """Any message that arrives: an unknown field is an error that names it."""

    model_config = ConfigDict(strict=True, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _check_field_names(cls, payload: object) -> object:
        if isinstance(payload, dict):
            names = [info.alias or name for name, info in cls.model_fields.items()]
            unknown = [str(name) for name in payload if name not in names]
            if unknown:
                fields = ", ".join(names)
                raise ValueError(f"unknown field {unknown[0]!r}; the fields are: {fields}")
        return payload


class Act(Message):
    """One move.

    It is made only on the current `episode` and `step`, so a repeat is harmless.
    """

    kind: Literal["act"] = "act"
    episode: str = Field(max_length=64, description="`episode` of the frame the move answers")
    step: int = Field(ge=0, description="`step` of that frame: the number of moves made so far")
    action: str = Field(max_length=64, description="the name of an action")
    input: Literal["key", "touch"] | None = Field(
        default=None, description="the page's trusted event, if any"
    )
    key_down_ms: Milliseconds | None = Field(
        default=None, description="when the key went down, client clock"
    )
    key_up_ms: Milliseconds | None = Field(
        default=None, description="when the last key came up, client clock"
    )
    client_ms: Milliseconds | None = Field(
        default=None, description="when the move was sent, client clock"
    )


class NewEpisode(Message):
    """The next episode; without a seed the server draws a fresh one.

    A task may ask for more (`humanplay.tasks`).
    """

    seed: int | None = Field(
        default=None,
        ge=0,
        le=MAX_SEED,
        description="of the instance; a chosen one never counts",
        examples=[7],
    )

    @property
    def leaves_terrain(self) -> bool:
        """Whether the message says nothing of what is played."""
        return self.seed is None


class NewBoard(NewEpisode):
    """A board of one's own: all fields optional, for a human alone by default."""

    player: str = Field(
        default="human", max_length=200, description='"human" or a name from `GET /api/policies`'
    )
    rival: str | None = Field(
        default=None,
        max_length=200,
        description="a policy to play the same terrain beside",
        examples=["random"],
    )
    replays: str | None = Field(
        default=None,
        max_length=128,
        description="the session whose ended episode a policy replays beside it",
    )
    challenges: str | None = Field(
        default=None,
        max_length=128,
        description="a finished episode: its terrain is played once more, against what was done there",
    )

    @model_validator(mode="after")
    def _challenger_is_alone(self) -> NewBoard:
        if self.challenges is None:
            return self
        if self.player != "human" or self.rival is not None or self.replays is not None:
            raise ValueError(
                "a person alone takes up a challenge: leave out player, rival and replays"
            )
        if not self.leaves_terrain:
            raise ValueError("a challenge has the terrain of its episode: name no other")
        return self


class HistoryRequest(Message):
    """Asks for the path so far: a subscriber that has skipped a step sends it."""

    kind: Literal["history"]


class InputEvent(Message):
    """One key press, touch, or change of focus, as the page saw it."""

    kind: Literal[
        "keydown", "keyup", "touchdown", "touchup", "focus", "blur", "visible", "hidden", "pause", "resume"
    ]  # fmt: skip
    code: str | None = Field(default=None, max_length=64, description="`event.code` of a key")
    repeat: bool | None = None
    trusted: bool | None = Field(default=None, description="`event.isTrusted`")
    client_ms: Milliseconds = Field(description="monotonic client clock")
    step: int | None = Field(default=None, ge=0, description="`step` of the frame on screen")
    round_trip_ms: Milliseconds | None = Field(
        default=None, description="from the last move to its frame"
    )


class Events(Message):
    """Input events of a person's episode, sent before the move that they cause.

    The answer is `EventsAnswer`. A batch that comes twice, by its id, is stored once.
    """

    kind: Literal["events"]
    episode: str = Field(max_length=64)
    batch: DrawnId = Field(description="drawn by the page, another for each batch")
    page_load: DrawnId = Field(description="drawn by the page when it is loaded")
    tab: DrawnId = Field(description="drawn by the page once in a tab of the browser")
    events: list[InputEvent] = Field(max_length=MAX_EVENTS_PER_MESSAGE)


class ChangePace(Message):
    """Exactly one of the four."""

    moves_per_second: float | None = Field(
        default=None, gt=0, le=60, allow_inf_nan=False, examples=[8]
    )
    pause: Literal[True] | None = None
    step: Literal[True] | None = Field(default=None, description="pause and make one move")
    follow: Literal[True] | None = Field(
        default=None, description="a move after each of a player's"
    )

    @model_validator(mode="after")
    def _exactly_one(self) -> ChangePace:
        chosen = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(chosen) != 1:
            names = ", ".join(type(self).model_fields)
            raise ValueError(f"a pace is exactly one of {names}; got {', '.join(chosen) or 'none'}")
        return self


class ServerMessage(BaseModel):
    """Any message that is sent: a field that is not declared is an error."""

    # what has a default is sent all the same
    model_config = ConfigDict(
        frozen=True, extra="forbid", json_schema_serialization_defaults_required=True
    )


class Pace(ServerMessage):
    """How a policy's session moves."""

    kind: Literal["pace"] = "pace"
    mode: PaceMode
    moves_per_second: float


class EventsAnswer(ServerMessage):
    """The answer to `Events`: all are stored, or none.

    None with a reason is final; none without a reason means send them again.
    """

    kind: Literal["kept"] = "kept"
    episode: str
    count: int
    reason: str | None = None


class ClockState(ServerMessage):
    """Whether time runs on a board with a clock.

    It stands until the page sends a `resume`, counts down `ms`, or runs.
    """

    kind: Literal["clock"] = "clock"
    episode: str
    state: Literal["standing", "countdown", "running"]
    ms: int = Field(default=0, description="of the countdown")
    reason: str | None = Field(
        default=None, description="why it stands, where that is not the page's doing"
    )
    ident: str | None = Field(default=None, description="of `reason` in the page's texts")
    values: dict[str, str] | None = Field(default=None, description="of its placeholders")


class RepeatProgress(ServerMessage):
    """How many of a running episode's moves a lost environment has repeated.

    The next frame ends it.
    """

    kind: Literal["remade"] = "remade"
    episode: str
    done: int
    of: int


FromPage = Act | HistoryRequest | Events
ClientMessage = Annotated[FromPage, Field(discriminator="kind")]
_CLIENT: TypeAdapter[FromPage] = TypeAdapter(ClientMessage)


def parse_message(text: str) -> FromPage:
    """The message in a socket's text.

    Raises:
        BadMessageError: With one sentence if there is none.
    """
    size = len(text.encode())
    if size > MAX_MESSAGE_BYTES:
        raise BadMessageError(f"a message must be at most {MAX_MESSAGE_BYTES} bytes, got {size}")
    try:
        return _CLIENT.validate_json(text)
    except ValidationError as error:
        raise BadMessageError(describe_errors(error.errors(include_url=False))) from None


def no_action(actions: Sequence[str], action: str) -> BadMessageError:
    """The error of an act whose action is none of a task's."""
    *names, last = map(repr, actions)
    return BadMessageError(f"action must be {', '.join(names)} or {last}, got {_shown(action)}")


def encode_error(detail: str) -> str:
    """The answer to a bad message, as JSON text."""
    return json.dumps({"kind": "error", "detail": detail, **asdict(SentenceName.of(detail))})


def encode_refused(reason: str, frame: str) -> str:
    """The answer to a stale or forbidden act, as JSON text with the current frame."""
    return f'{{"kind":"refused","reason":{json.dumps(reason)},"frame":{frame}}}'


NO_BODY = "expected a JSON object, sent with Content-Type: application/json"
CLIENT_KINDS = '"act", "history" or "events"'
"""The kinds of message that a socket takes."""

_TYPES = {
    "int": "a whole number", "float": "a number", "string": "text", "bool": "true or false",
    "list": "a list", "dict": "a JSON object", "model": "a JSON object", "model_attributes": "a JSON object",
}  # fmt: skip
_TAGS = ("body", "query", "path", "act", "history", "events")


def describe_errors(errors: Sequence[ErrorDetails]) -> str:
    """Pydantic's errors as one sentence, the first three at most."""
    return "; ".join(dict.fromkeys(_clause(error) for error in errors[:3]))


def _clause(error: ErrorDetails) -> str:
    kind, context = str(error["type"]), error.get("ctx", {})
    loc = error["loc"][1:] if error["loc"] and error["loc"][0] in _TAGS else error["loc"]
    names = [str(part) for part in loc]
    name, received = (names[-1] if names else "the message"), _shown(error.get("input"))
    bounds = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}
    bounds |= {"min_length": "at least", "max_length": "at most"}
    limits = [f"{words} {_plain(context[key])}" for key, words in bounds.items() if key in context]
    bound = next(iter(limits), None)
    is_length = {"min_length", "max_length"} & context.keys()
    if kind == "value_error":
        return str(context["error"])
    if kind == "json_invalid":
        return f"a message must be JSON, and this is not: {context['error']}"
    if kind == "too_long":
        return f"{name} must hold at most {context['max_length']}, got {context['actual_length']}"
    if kind == "missing":
        return f"{name} is missing" if names else NO_BODY
    if kind == "model_attributes_type" and not names:
        return f"{NO_BODY}, got {received}"
    if kind == "union_tag_not_found":
        return f"kind is missing: expected {CLIENT_KINDS}"
    if kind == "union_tag_invalid":
        return f"kind must be {CLIENT_KINDS}, got {context['tag']!r}"
    if kind == "literal_error":
        return f"{name} must be {'true' if context['expected'] == 'True' else context['expected']}, got {received}"
    if bound is not None:
        return f"{name} must be {bound}{' characters long' if is_length else ''}, got {received}"
    plain = kind.removesuffix("_type").removesuffix("_parsing").removesuffix("_from_float")
    expected = _TYPES.get(plain)
    wrong = f"{name} must be {expected}" if expected else f"{name}: {error['msg']}"
    return f"{wrong}, got {received}"


def _plain(bound: float) -> str:
    return str(int(bound)) if bound == int(bound) else str(bound)


def _shown(received: object) -> str:
    text = repr(received) if isinstance(received, bytes) else json.dumps(received, default=repr)
    return text if len(text) <= 60 else f"{text[:57]}..."
