"""Every message in both directions, over HTTP and over the socket; `static/common/messages.js` is the page's copy.

Messages that arrive are pydantic models and are checked strictly. What is sent is built once, as text, by the functions at
the end.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from math import isfinite
from typing import Annotated, Any, Literal, Self

import msgspec
import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    model_validator,
)

from app.play.validation import Size, describe_errors
from app.tasks.mars.view import View
from marsexplorer.config import ACTIONS, ALL_LEVELS, MAP, MAX_SEED
from marsexplorer.episode import Episode

MAX_MESSAGE_BYTES = 64 * 1024
"""Longest message or body that is accepted."""
MAX_EVENTS_PER_MESSAGE = 200
"""Most input events in one message."""
CELL_CHARACTERS = bytes.maketrans(bytes(range(4)), b"?.@#")
"""Code of a cell -> its character in a frame's grid."""

DRAWN_LEVELS = tuple(name for name in ALL_LEVELS if name != MAP)
"""The levels whose terrains are drawn from seeds."""

ActionName = Literal["north", "east", "south", "west"]
PaceMode = Literal["follow", "timed", "paused"]
Milliseconds = Annotated[float, Field(allow_inf_nan=False)]


class BadMessageError(ValueError):
    """A message that this server does not accept; the text is one sentence for its sender."""


def _check_level(value: str) -> str:
    if value not in DRAWN_LEVELS:
        raise ValueError(f"no level {value!r}; choose one of: {', '.join(DRAWN_LEVELS)}")
    return value


LevelName = Annotated[str, AfterValidator(_check_level)]
Seed = Annotated[int, Field(ge=0, le=MAX_SEED)]


class Message(BaseModel):
    """Any message that arrives: types are strict, and an unknown field is an error that names it."""

    model_config = ConfigDict(strict=True, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _know_every_field(cls, data: Any) -> Any:
        if isinstance(data, dict):
            known = [info.alias or name for name, info in cls.model_fields.items()]
            unknown = [str(name) for name in data if name not in known]
            if unknown:
                raise ValueError(
                    f"unknown field {unknown[0]!r}; the fields are: {', '.join(known)}"
                )
        return data


class Act(Message):
    """One move. Only the current `episode` and `step` move the rover, so a repeat is harmless."""

    kind: Literal["act"] = "act"
    episode: str = Field(max_length=64, description="`episode` of the frame the move answers")
    step: int = Field(ge=0, description="`step` of that frame: the number of moves made so far")
    action: ActionName = Field(description="where to go: row-1, col+1, row+1, col-1")
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

    @property
    def code(self) -> int:
        """Return the action as the core numbers it, 0..3."""
        return ACTIONS.index(self.action)


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
    step: int | None = Field(
        default=None, ge=0, description="`step` of the frame that was on screen"
    )
    round_trip_ms: Milliseconds | None = Field(
        default=None, description="from the last move to its frame"
    )


class Events(Message):
    """Input events of a person's episode, sent before the move that they cause.

    The answer is `Kept`, and a batch that was kept already is not kept again: it is known by its id.
    """

    kind: Literal["events"]
    episode: str = Field(max_length=64)
    batch: str = Field(
        min_length=8, max_length=64, description="drawn by the page, another for each batch"
    )
    events: list[InputEvent] = Field(max_length=MAX_EVENTS_PER_MESSAGE)


class ExpectedRequest(Message):
    """Asks what a look from each cell of a policy's board is expected to show; the answer is `Expected`."""

    kind: Literal["expected"]


class NewEpisode(Message):
    """The next episode; what is left out stays as it was, and without a seed the server draws a fresh one."""

    level: LevelName | None = Field(
        default=None, description="a name from `GET /api/levels`", examples=["random"]
    )
    size: Size | None = Field(default=None, examples=[21])
    seed: Seed | None = Field(
        default=None, description="of the terrain; a chosen terrain never counts", examples=[7]
    )
    map: str | None = Field(
        default=None,
        max_length=200,
        description="a name from `GET /api/maps`, instead of the three above",
    )

    @property
    def leaves_terrain(self) -> bool:
        """Return whether nothing is said of the terrain."""
        return (self.level, self.size, self.seed, self.map) == (None, None, None, None)

    @model_validator(mode="after")
    def _map_stands_alone(self) -> Self:
        if self.map is not None and (self.level, self.size, self.seed) != (None, None, None):
            raise ValueError(
                "a map has a size and a terrain of its own: leave out level, size and seed where map is given"
            )
        return self


class NewSession(NewEpisode):
    """A board of one's own: all fields optional, `random` at 21x21 for a human without a rival by default."""

    player: str = Field(
        default="human", max_length=200, description='"human" or a name from `GET /api/policies`'
    )
    rival: str | None = Field(
        default=None,
        max_length=200,
        description="a policy to play the same terrain beside",
        examples=["frontier-cost"],
    )
    replays: str | None = Field(
        default=None,
        max_length=128,
        description="the session whose ended episode a policy replays beside it",
    )


class ChangePace(Message):
    """Exactly one of the four."""

    moves_per_second: float | None = Field(
        default=None, gt=0, le=60, allow_inf_nan=False, examples=[8]
    )
    pause: Literal[True] | None = None
    step: Literal[True] | None = Field(default=None, description="pause and make one move")
    follow: Literal[True] | None = Field(
        default=None, description="one move after each of the player's"
    )

    @model_validator(mode="after")
    def _exactly_one(self) -> ChangePace:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(given) != 1:
            names = ", ".join(type(self).model_fields)
            raise ValueError(f"a pace is exactly one of {names}; got {', '.join(given) or 'none'}")
        return self


class Frame(BaseModel):
    """Everything a board needs, and nothing that the rover has not discovered."""

    kind: Literal["frame"]
    episode: str
    step: int
    rows: int
    cols: int
    grid: list[str] = Field(
        description="a string a row: `?` unknown, `.` free, `#` obstacle, `@` rover",
        examples=[["@..#?", "...??"]],
    )
    position: tuple[int, int] = Field(description="[row, col], row 0 at the north edge")
    discovered: int = Field(description="cells")
    cells: int = Field(
        description="that count: all, or on maps and levels with walls those that can be discovered"
    )
    coverage: float = Field(description="discovered / cells")
    heading: ActionName
    reward: float | None = Field(
        description="of the last move (eq. 8); this and the next two null where a study hides them"
    )
    return_: float | None = Field(alias="return", description="sum of the rewards")
    score: float | None = Field(description="normalized (section 3.2)")
    outcome: Literal["explored", "collided", "out_of_bounds", "timed_out", "abandoned"] | None


class History(BaseModel):
    """The path so far; index 0 is the start."""

    kind: Literal["history"]
    episode: str
    positions: list[tuple[int, int]]
    discovered: list[int]


class Thought(BaseModel):
    """What a policy computed for the frame of `step`: from its observation alone, on its own board only.

    Networks have probabilities and a value; rules have a goal.
    """

    kind: Literal["thought"]
    episode: str
    step: int
    probabilities: tuple[float, float, float, float] | None = Field(
        description="of north, east, south, west; null when it has none"
    )
    value: float | None = Field(
        description="what it expects to earn from here on, in its own units; null when it has none"
    )
    goal: tuple[int, int] | None = Field(
        description="the known free cell that its next move leads towards; null when it has none"
    )


class Expected(BaseModel):
    """How many unknown cells a look from each cell should show, by the map of `step` alone, on a policy's own board."""

    kind: Literal["expected"]
    episode: str
    step: int
    cells: list[tuple[int, int, int]] = Field(
        description="[row, col, unknown cells], of the cells with any"
    )


class Pace(BaseModel):
    """How a policy's session moves."""

    model_config = ConfigDict(frozen=True)

    kind: Literal["pace"] = "pace"
    mode: PaceMode
    moves_per_second: float


class Kept(BaseModel):
    """The answer to `Events`: all are kept, or none for a lasting reason; none without a reason means send them again."""

    model_config = ConfigDict(frozen=True)

    kind: Literal["kept"] = "kept"
    episode: str
    count: int
    reason: str | None = None


FromPage = Act | HistoryRequest | Events | ExpectedRequest
ClientMessage = Annotated[FromPage, Field(discriminator="kind")]
_CLIENT: TypeAdapter[FromPage] = TypeAdapter(ClientMessage)
_ENCODER = msgspec.json.Encoder()


def parse_message(text: str) -> FromPage:
    """Return the message in a socket's text; BadMessageError with one sentence when there is none."""
    size = len(text.encode())
    if size > MAX_MESSAGE_BYTES:
        raise BadMessageError(f"a message must be at most {MAX_MESSAGE_BYTES} bytes, got {size}")
    try:
        return _CLIENT.validate_json(text)
    except ValidationError as error:
        raise BadMessageError(describe_errors(error.errors(include_url=False))) from None


def encode_frame(episode_id: str, episode: Episode | View, hides_scores: bool = False) -> str:
    """Return the frame of an episode as it stands, as JSON text; reward, return and score null where they are hidden."""
    rows, cols = episode.codes.shape
    row, col = episode.position
    frame = {
        "kind": "frame",
        "episode": episode_id,
        "step": episode.steps,
        "rows": rows,
        "cols": cols,
        "grid": encode_grid(episode.codes),
        "position": [int(row), int(col)],
        "discovered": int(episode.discovered),
        "cells": int(episode.cells),
        "coverage": float(episode.coverage),
        "heading": episode.heading,
        "reward": None if hides_scores else float(episode.reward),
        "return": None if hides_scores else float(episode.total),
        "score": None if hides_scores else float(episode.score),
        "outcome": episode.outcome if episode.ended else None,
    }
    return _ENCODER.encode(frame).decode()


def encode_grid(codes: NDArray[np.uint8]) -> list[str]:
    """Return what is known of a terrain, codes uint8[rows, cols], as the `grid` of a frame."""
    rows, cols = codes.shape
    cells = codes.tobytes().translate(CELL_CHARACTERS).decode()
    return [cells[start : start + cols] for start in range(0, rows * cols, cols)]


def encode_history(episode_id: str, episode: Episode | View) -> str:
    """Return the path so far as JSON text."""
    positions = [[int(row), int(col)] for row, col in episode.path]
    discovered = [int(count) for count in episode.discoveries]
    history = {
        "kind": "history",
        "episode": episode_id,
        "positions": positions,
        "discovered": discovered,
    }
    return _ENCODER.encode(history).decode()


def encode_thought(
    episode_id: str,
    step: int,
    probabilities: Sequence[float] | None,
    value: float,
    goal: tuple[int, int] | None = None,
) -> str:
    """Return a policy's thought about the frame of `step` as JSON text; a value that is no finite number becomes null.

    "" where there are neither probabilities nor a goal, or a probability is no finite number: NaN is no JSON, and such a
    thought says nothing.
    """
    if (probabilities is None and goal is None) or not all(map(isfinite, probabilities or ())):
        return ""
    thought = {
        "kind": "thought",
        "episode": episode_id,
        "step": step,
        "probabilities": None
        if probabilities is None
        else [round(float(share), 4) for share in probabilities],
        "value": round(float(value), 3) if isfinite(value) else None,
        "goal": None if goal is None else [int(goal[0]), int(goal[1])],
    }
    return _ENCODER.encode(thought).decode()


def encode_error(detail: str) -> str:
    """Return the answer to a bad message as JSON text."""
    return json.dumps({"kind": "error", "detail": detail})


def encode_refused(reason: str, frame: str) -> str:
    """Return the answer to a stale act as JSON text, the current frame in it."""
    return f'{{"kind":"refused","reason":{json.dumps(reason)},"frame":{frame}}}'
