"""What every answer shares."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class Answer(BaseModel):
    """An answer of the API, or a part of one: a field that is not declared is an error."""

    model_config = ConfigDict(extra="forbid")


Frame = dict[str, Any]
"""A frame of the task that is played, as `GET /api/sessions/{session_id}` answers it."""


def described(meaning: str, **bounds: Any) -> Any:
    """A required field with its description."""
    return Field(description=meaning, **bounds)
