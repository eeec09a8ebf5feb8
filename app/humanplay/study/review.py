"""What a reviewer will ask of a study that its protocol does not answer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from humanplay.study.draft import shipped_name
from humanplay.study.protocol import Protocol
from humanplay.study.questions import Item

_ABOUT_PEOPLE: dict[Item, tuple[str, str]] = {
    "demographics": ("who took part", "demographics"),
    "exposure": ("whether they had met the task before", "exposure"),
    "tools": ("whether they used a tool or an AI", "tools"),
    "explanations": ("how they decided", "tools"),
}
"""Item of the report's checklist -> what a reviewer asks, and the shipped block that asks people."""


@dataclass(frozen=True)
class OpenQuestion:
    """A question of reviewers that no field answers.

    line  of a draft that would answer it
    """

    question: str
    line: str


def open_questions(protocol: Protocol) -> Iterator[OpenQuestion]:
    """Yield what a reviewer will ask, with a line to write into the draft."""
    yield from _about_people(protocol)
    if protocol.recruitment == "open":
        yield OpenQuestion("Could somebody take part twice?", 'recruitment = "invitation"')
    if protocol.question_tries is None and protocol.question_count:
        yield OpenQuestion(
            "What becomes of people who do not understand the instructions?", "question_tries = 3"
        )
    if protocol.practice is None and protocol.warm_up:
        yield OpenQuestion(
            "Could everybody do the task before it counted?",
            'practice = {episodes_to_pass = 1, tries = 2, if_failed = "screen_out"}',
        )
    if protocol.payment is None:
        yield OpenQuestion(
            "What did people earn by the hour?",
            'payment = {currency = "GBP", base = 4.5, hourly_rate = 9}',
        )
    if _assumes_synthetic_players(protocol):
        yield OpenQuestion(
            "What does the power rest on? On synthetic players.",
            f"assumed_mean = ...  # and the others, by `humanplay study power {protocol.name} --pilot EARLIER`",
        )


def _about_people(protocol: Protocol) -> Iterator[OpenQuestion]:
    """Yield what no block asks people."""
    questions = [question for block in protocol.blocks for question in block.questions]
    items = {question.tells for question in questions}
    missing = [asked for item, asked in _ABOUT_PEOPLE.items() if item not in items]
    if not missing:
        return
    present = [shipped_name(block) for block in protocol.blocks]
    wanted = [*present, *(name for _, name in missing)]
    names = ["..." if name is None else f'"{name}"' for name in dict.fromkeys(wanted)]
    yield OpenQuestion(
        f"Of people: {'; '.join(words for words, _ in missing)}?", f"blocks = [{', '.join(names)}]"
    )


def _assumes_synthetic_players(protocol: Protocol) -> bool:
    """Whether the assumptions on people are those that no measurement is behind."""
    assumed = dict(protocol.environment.assumed(protocol.env_config, protocol.primary_metric))
    of_people = {name: number for name, number in assumed.items() if name != "assumed_terrain_sd"}
    return bool(of_people) and all(
        getattr(protocol, name) in (None, number) for name, number in of_people.items()
    )
