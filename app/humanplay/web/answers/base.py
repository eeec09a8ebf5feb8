"""What every answer shares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler
from pydantic_core import CoreSchema

OWN = "x-environment"
"""Where a schema says which of the environment's own models stands in its place."""


class Answer(BaseModel):
    """An answer of the API, or a part of one.

    A field that is not declared is an error. Each is built when it is first used: building all of
    them would be a fifth of what a server takes to start.
    """

    model_config = ConfigDict(extra="forbid", defer_build=True)


@dataclass(frozen=True)
class EnvironmentModel:
    """A part of an answer whose model is the environment's own.

    Attributes:
        name: Of the model in `humanplay.task.Messages`.
    """

    name: Literal["frame", "history", "course", "mistake"]

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, object]:
        """A mark, for which `openapi.PlaygroundApp` sets the environment's model."""
        return {OWN: self.name}


Frame = Annotated[dict[str, object], EnvironmentModel("frame")]
"""What a board shows after a move."""
History = Annotated[dict[str, object], EnvironmentModel("history")]
"""The path so far."""
Course = Annotated[dict[str, object], EnvironmentModel("course")]
"""What a replay draws of an episode."""
Mistake = Annotated[dict[str, object], EnvironmentModel("mistake")]
"""Moves that together cost something."""
Configuration = dict[str, object]
"""The configuration of an environment, whose settings are its own."""


class Problem(Answer):
    """Why a request was refused or failed."""

    detail: str = Field(description="what was expected and what came")


class Interval(Answer):
    """A mean with its 95 % interval."""

    mean: float
    low: float | None = Field(description="null without an interval, as for a single player")
    high: float | None


FILE = {"schema": {"type": "string", "format": "binary"}}


def file_of(*media_types: str, meaning: str = "the file") -> dict[int | str, dict[str, object]]:
    """Declare an answer that is a file of one of some media types."""
    kinds = [media_type.partition(";")[0] for media_type in media_types]
    return {200: {"content": dict.fromkeys(kinds, FILE), "description": meaning}}
