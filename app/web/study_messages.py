"""What participants send over HTTP: the bodies of the calls of `app.web.study`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from app.play.messages import Message


class Join(Message):
    """Who joins: what the link that brought them holds, and the name of the script if it is no person."""

    outside_ids: dict[str, Annotated[str, Field(max_length=200)]] = Field(
        default_factory=dict, max_length=50
    )
    script: Annotated[str, Field(min_length=1, max_length=80)] | None = Field(
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


class Advance(Message):
    """Which stage is left."""

    from_: Literal["instructions", "tutorial", "debrief"] = Field(alias="from")


class Answers(Message):
    """The index of the choice for each question."""

    answers: list[Annotated[int, Field(ge=0)]] = Field(max_length=20, examples=[[0, 1, 1]])


class OperatorCode(Message):
    """What the operator typed."""

    code: str = Field(max_length=100, examples=["7K3M-XWT5"])


class AbandonEpisode(Message):
    """The frame on which the episode is abandoned."""

    episode: str = Field(max_length=64)
    step: int = Field(ge=0)


class ParticipantSettings(Message):
    """What a participant chose; what is left out stays as it was."""

    modality: Literal["keyboard", "touch"] | None = None
    palette: Literal["mars", "colour-blind", "high-contrast"] | None = None
    keys: (
        dict[Literal["north", "east", "south", "west"], list[Annotated[str, Field(max_length=64)]]]
        | None
    ) = None

    @field_validator("keys")
    @classmethod
    def _no_key_twice(cls, keys: dict[str, list[str]] | None) -> dict[str, list[str]] | None:
        codes = [code for each in (keys or {}).values() for code in each]
        if len(set(codes)) < len(codes):
            raise ValueError("keys: one key cannot mean two directions")
        if len(codes) > 40:
            raise ValueError(f"keys: at most 40 in all, got {len(codes)}")
        return keys
