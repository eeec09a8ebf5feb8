"""MarsExplorer's messages as pydantic models, for the API's documentation."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    WithJsonSchema,
    model_validator,
)

from humanplay.board import messages
from humanplay.task import counted
from marsexplorer.config import ALL_LEVELS, MAP, MIN_SIDE

DRAWN_LEVELS = tuple(name for name in ALL_LEVELS if name != MAP)
"""The levels whose terrains are drawn from seeds."""
ActionName = Literal["north", "east", "south", "west"]
EpisodeOutcome = Literal["explored", "collided", "out_of_bounds", "timed_out", "abandoned"]

MAX_DRAWN_SIDE = 128
"""Longest side of a board that is drawn from a seed (cells)."""


def _check_side(name: str, value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"{name} must be a whole number, got {value!r}")
    if value < MIN_SIDE:
        raise ValueError(f"{name} must be at least {MIN_SIDE}, got {value}")
    if value > MAX_DRAWN_SIDE:
        raise ValueError(f"{name} must be at most {MAX_DRAWN_SIDE} over the API, got {value}")
    return value


def parse_size(value: object) -> tuple[int, int]:
    """Return (rows, cols) of a whole number or a pair; ValueError otherwise."""
    if isinstance(value, (list, tuple)):
        if len(value) != 2:
            raise ValueError(
                f"size must be a whole number or [rows, cols], got {counted(len(value), 'value')}"
            )
        return _check_side("rows", value[0]), _check_side("cols", value[1])
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"size must be a whole number or [rows, cols], got {value!r}")
    side = _check_side("rows", value)
    return side, side


_SIDE_SCHEMA = {"type": "integer", "minimum": MIN_SIDE, "maximum": MAX_DRAWN_SIDE}
_SIZE_SCHEMA = {
    "title": "Size",
    "description": "One side for a square board, or [rows, cols]; cells.",
    "anyOf": [_SIDE_SCHEMA, {"type": "array", "items": _SIDE_SCHEMA, "minItems": 2, "maxItems": 2}],
}
Size = Annotated[tuple[int, int], BeforeValidator(parse_size), WithJsonSchema(_SIZE_SCHEMA)]


def _check_level(value: str) -> str:
    if value not in DRAWN_LEVELS:
        raise ValueError(f"no level {value!r}; choose one of: {', '.join(DRAWN_LEVELS)}")
    return value


LevelName = Annotated[str, AfterValidator(_check_level)]


class NewEpisode(messages.NewEpisode):
    """The next episode. Omitted fields stay; without a seed a new one is drawn."""

    level: LevelName | None = Field(
        default=None, description="a name from `GET /api/levels`", examples=["random"]
    )
    size: Size | None = Field(default=None, examples=[21])
    map: str | None = Field(
        default=None,
        max_length=200,
        description="a name from `GET /api/maps`, instead of level, size and seed",
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


class NewSession(NewEpisode, messages.NewBoard):
    """A new board; by default `random` at 21x21, for a human without a rival."""


class Frame(messages.ServerMessage):
    """Everything a board needs, and nothing that the rover has not discovered."""

    # unlike the defaults of other messages, `packed` is not sent: most frames are without it
    model_config = ConfigDict(json_schema_serialization_defaults_required=False)

    kind: Literal["frame"]
    episode: str
    step: int
    rows: int
    cols: int
    grid: list[str] = Field(
        description="a string a row: `?` unknown, `.` free, `#` obstacle, `@` rover",
        examples=[["@..#?", "...??"]],
    )
    packed: Literal[True] | None = Field(
        default=None,
        description=f"on a map above {MAX_DRAWN_SIDE} cells a side a character of grid stands for four cells; else absent",
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
    outcome: EpisodeOutcome | None


class History(messages.ServerMessage):
    """The path so far; index 0 is the start."""

    kind: Literal["history"]
    episode: str
    positions: list[tuple[int, int]]
    discovered: list[int]


class Course(messages.ServerMessage):
    """The course of an episode.

    Index k of `positions` and `discovered` is the board after k moves.
    """

    name: str = Field(description="who drove")
    actions: list[ActionName]
    positions: list[tuple[int, int]] = Field(description="[row, col], row 0 at the north edge")
    discovered: list[int] = Field(description="cells")
    cells: int = Field(description="that coverage refers to, as in a frame")
    grid: list[str] = Field(
        description="what was known at the end, as in a frame, without the rover"
    )
    known_since: list[list[int]] = Field(
        description="moves after which each cell was known, by rows; -1: never"
    )
    outcome: EpisodeOutcome
    score: float = Field(description="normalized (section 3.2)")
    sentence: str = Field(description="what it came to, in words that follow the name")


class Mistake(messages.ServerMessage):
    """Moves that together cost something, and the board before the costliest."""

    first: int = Field(description="its first move, from 0")
    last: int = Field(description="its last move")
    step: int = Field(description="its costliest move")
    cost: int = Field(description="moves")
    action: ActionName = Field(description="made there")
    expert_action: ActionName
    kind: Literal["hidden pocket", "early detour", "last cells", "ended early"]
    previous: ActionName | None = Field(description="the action before it; null at the start")
    position: tuple[int, int] = Field(description="[row, col], row 0 at the north edge")
    grid: list[str] = Field(description="as in a frame")
    discovered: int = Field(description="cells")
    missed: list[tuple[int, int]] = Field(
        description="cells that Expert's move would soon have shown"
    )
    seen_at: int | None = Field(
        description="moves after which the last of them was seen; null: never"
    )
