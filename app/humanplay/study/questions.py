"""The questions of a study: their kinds, their blocks, and the check of answers.

An answer is a number for each part of its question, or None for "prefer not to say": the index of a choice, a step, a number,
1 or 0 for a choice that may be one of several and for a statement. Only what is typed as text is text.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import NoneType
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator

from humanplay.task import counted

Line = Annotated[str, Field(min_length=1, max_length=300)]
Name = Annotated[str, Field(pattern="^[a-z][a-z0-9_]{0,39}$")]
Position = Literal["before", "after_warm_up", "between_sets", "after"]
POSITIONS: dict[Position, str] = {
    "before": "before the first episode",
    "after_warm_up": "after the warm-up",
    "between_sets": "with every break",
    "after": "after the last episode, before the debrief",
}
"""Where a block can stand, in order."""
Item = Literal["demographics", "exposure", "tools", "explanations"]
"""What the checklist of a report asks about people."""
Sent = None | bool | int | float | str | Sequence[int | None]
"""What a page sends for a question; None: prefer not to say."""
Shown = dict[str, object]
"""What a page gets of a question, or of a block."""


NONE = "none"
"""What a draft says where a field is None."""


class Part(BaseModel):
    """A part of a protocol."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _none_is_a_word(cls, fields: object) -> object:
        """A draft writes NONE, since TOML has no null."""
        if not isinstance(fields, Mapping):
            return fields
        words = {name for name, content in fields.items() if content == NONE}
        return {**fields, **dict.fromkeys(words & cls.optional_fields())}

    @classmethod
    def optional_fields(cls) -> set[str]:
        """The fields that may be None."""
        return {
            name
            for name, field in cls.model_fields.items()
            if NoneType in get_args(field.annotation)
        }


class _Choices(Part):
    question: Line
    choices: tuple[Line, ...] = Field(min_length=2, max_length=20)

    def _index(self, sent: Sent) -> int:
        last = len(self.choices) - 1
        if isinstance(sent, int) and not isinstance(sent, bool) and 0 <= sent <= last:
            return sent
        raise ValueError(f"must be 0 to {last}, the index of a choice, got {sent!r}")


class Question(_Choices):
    """A question with a right answer, on the instructions or as an attention check.

    answer   the index of the right choice
    why      what a participant who chose another one reads before trying again
    """

    answer: int = Field(ge=0)
    why: str = Field(default="", max_length=500)

    @model_validator(mode="after")
    def _answer_is_a_choice(self) -> Question:
        if self.answer >= len(self.choices):
            indices = f"the index of a choice, 0 to {len(self.choices) - 1}"
            raise ValueError(f"answer must be {indices}, got {self.answer}")
        return self

    def is_right(self, sent: Sent) -> bool:
        """Whether a choice is the right one; ValueError where it is none."""
        return self._index(sent) == self.answer


class BlockQuestion(Part):
    """What every question of a block has.

    name    no other question of the protocol has it: tables call the answer so
    needed  it cannot be left out, though "prefer not to say" answers it
    tells   which item of the report's checklist the answers fill
    """

    name: Name
    question: Line
    needed: bool = False
    tells: Item | None = None
    can_be_taken_back: ClassVar[bool] = False

    @property
    def parts(self) -> tuple[str, ...]:
        """What each number of an answer is about; one without words for most questions."""
        return ("",)

    @property
    def offers_declining(self) -> bool:
        """Whether "prefer not to say" is offered.

        It is also offered if the page cannot take an answer back.
        """
        return self.needed or not self.can_be_taken_back

    @property
    def is_shuffled(self) -> bool:
        """Whether choices are shown in an order drawn for each person."""
        return False

    def numbers(self, sent: Sent) -> dict[int, float]:
        """The number for each part that was answered; ValueError with what was expected."""
        raise NotImplementedError

    def shown(self) -> Shown:
        """What a page gets besides name, question and choices."""
        return {}


class _OneChoice(BlockQuestion, _Choices):
    def numbers(self, sent: Sent) -> dict[int, float]:
        """The index of the choice."""
        return {0: self._index(sent)}


class Choice(_OneChoice):
    """One of several choices.

    ordered  they are shown as they are written; False: in an order drawn for each person
    """

    kind: Literal["choice"] = "choice"
    ordered: bool = True

    @property
    def is_shuffled(self) -> bool:
        """Whether choices are shown in an order drawn for each person."""
        return not self.ordered


class AttentionCheck(_OneChoice, Question):
    """A choice with a right answer; the page shows it as any other."""

    kind: Literal["attention"] = "attention"

    def shown(self) -> Shown:
        """What a page gets: nothing by which it could be told from a choice."""
        return {"kind": "choice"}


class MultipleChoice(BlockQuestion, _Choices):
    """Any number of choices, each 1 or 0."""

    kind: Literal["several"] = "several"
    can_be_taken_back: ClassVar[bool] = True
    ordered: bool = True

    @property
    def parts(self) -> tuple[str, ...]:
        """The choices."""
        return self.choices

    @property
    def is_shuffled(self) -> bool:
        """Whether choices are shown in an order drawn for each person."""
        return not self.ordered

    def numbers(self, sent: Sent) -> dict[int, float]:
        """1 for each choice that was made, 0 for the others."""
        if not isinstance(sent, list) or len(set(sent)) < len(sent):
            raise ValueError(f"must be a list of different indices of choices, got {sent!r}")
        chosen = {self._index(index) for index in sent}
        return {index: float(index in chosen) for index in range(len(self.choices))}


class Likert(BlockQuestion):
    """Statements that are rated on the same points.

    rows    the statements
    points  from one end to the other
    """

    kind: Literal["likert"] = "likert"
    rows: tuple[Line, ...] = Field(min_length=1, max_length=20)
    points: tuple[Line, ...] = Field(min_length=2, max_length=11)

    @property
    def parts(self) -> tuple[str, ...]:
        """The statements."""
        return self.rows

    def numbers(self, sent: Sent) -> dict[int, float]:
        """The index of the point for each statement that was rated."""
        last = len(self.points) - 1
        if (
            not isinstance(sent, list)
            or len(sent) != len(self.rows)
            or not all(
                point is None or (type(point) is int and 0 <= point <= last) for point in sent
            )
        ):
            expected = (
                f"a point from 0 to {last}, or null, for each of {counted(len(self.rows), 'row')}"
            )
            raise ValueError(f"must be {expected}, got {sent!r}")
        if self.needed and None in sent:
            raise ValueError("needs a point in every row, or prefer not to say")
        return {row: point for row, point in enumerate(sent) if point is not None}

    def shown(self) -> Shown:
        """What a page gets of it alone."""
        return {"rows": self.rows, "points": self.points}


class Scale(BlockQuestion):
    """Steps between two ends; none of them is chosen beforehand.

    steps  how many; an answer is 0 to steps - 1
    """

    kind: Literal["scale"] = "scale"
    steps: int = Field(ge=2, le=101)
    low: Line
    high: Line

    def numbers(self, sent: Sent) -> dict[int, float]:
        """The step."""
        if type(sent) is not int or not 0 <= sent < self.steps:
            raise ValueError(f"must be a step, 0 to {self.steps - 1}, got {sent!r}")
        return {0: sent}

    def shown(self) -> Shown:
        """What a page gets of it alone."""
        return {"steps": self.steps, "low": self.low, "high": self.high}


class Number(BlockQuestion):
    """A number that is typed."""

    kind: Literal["number"] = "number"
    can_be_taken_back: ClassVar[bool] = True
    minimum: float = Field(default=0, allow_inf_nan=False)
    maximum: float = Field(allow_inf_nan=False)
    whole: bool = True
    unit: str = Field(default="", max_length=40)

    @model_validator(mode="after")
    def _ends_in_order(self) -> Number:
        if self.minimum >= self.maximum:
            raise ValueError(
                f"minimum must be below maximum, got {self.minimum:g} and {self.maximum:g}"
            )
        return self

    def numbers(self, sent: Sent) -> dict[int, float]:
        """The number."""
        if (
            isinstance(sent, (int, float))
            and not isinstance(sent, bool)
            and self.minimum <= sent <= self.maximum
            and not (self.whole and sent % 1)
        ):
            return {0: float(sent)}
        kind = "a whole number" if self.whole else "a number"
        raise ValueError(
            f"must be {kind} from {self.minimum:.15g} to {self.maximum:.15g}, got {sent!r}"
        )

    def shown(self) -> Shown:
        """What a page gets of it alone."""
        return {
            "minimum": self.minimum,
            "maximum": self.maximum,
            "whole": self.whole,
            "unit": self.unit,
        }


class Text(BlockQuestion):
    """Words that are typed: a line, or several."""

    kind: Literal["text"] = "text"
    can_be_taken_back: ClassVar[bool] = True
    long: bool = False
    max_length: int = Field(default=300, ge=1, le=5000)

    @property
    def parts(self) -> tuple[str, ...]:
        """None of it is a number."""
        return ()

    def text(self, sent: Sent) -> str:
        """The text without spaces around it; ValueError if it is no text, or too long."""
        if not isinstance(sent, str) or not sent.strip() or len(sent) > self.max_length:
            raise ValueError(f"must be a text of at most {counted(self.max_length, 'character')}")
        return sent.strip()

    def shown(self) -> Shown:
        """What a page gets of it alone."""
        return {"long": self.long, "max_length": self.max_length}


class Statement(BlockQuestion):
    """A statement to agree to: 1 where somebody did."""

    kind: Literal["statement"] = "statement"
    can_be_taken_back: ClassVar[bool] = True

    def numbers(self, sent: Sent) -> dict[int, float]:
        """1 for agreeing."""
        if sent is True:
            return {0: 1.0}
        raise ValueError(f"must be true, for agreeing, got {sent!r}")


AnyQuestion = Annotated[
    Choice | MultipleChoice | Likert | Scale | Number | Text | Statement | AttentionCheck,
    Field(discriminator="kind"),
]


class Condition(Part):
    """The one earlier answer that lets a block be asked.

    question  a choice of a block that comes before
    answers   indices of its choices, of which one was made
    """

    question: Name
    answers: tuple[Annotated[int, Field(ge=0)], ...] = Field(min_length=1)


class Block(Part):
    """Questions on one screen.

    at        where it stands
    about     what the consent text says that it asks about, as in "your age and gender"
    intro     what stands above the questions
    shown_if  None: everybody is asked
    arms      of the protocol whose people are asked; none: all
    """

    name: Name
    at: Position
    title: Line
    about: Line
    intro: str = Field(default="", max_length=1000)
    shown_if: Condition | None = None
    arms: tuple[Name, ...] = Field(default=(), max_length=10)
    questions: tuple[AnyQuestion, ...] = Field(min_length=1, max_length=40)

    @property
    def attention_checks(self) -> tuple[AttentionCheck, ...]:
        """Its questions that are attention checks."""
        return tuple(check for check in self.questions if isinstance(check, AttentionCheck))


EARLY_POSITIONS: tuple[Position, ...] = ("before", "after_warm_up")
"""Those before the first ranked episode, at which somebody may still be screened out."""


def attention_checks(blocks: Sequence[Block], *positions: Position) -> int:
    """How many attention checks stand in the blocks at some positions."""
    return sum(len(block.attention_checks) for block in blocks if block.at in positions)


def in_order(blocks: Sequence[Block]) -> list[Block]:
    """The blocks in the order in which they are asked."""
    return sorted(blocks, key=lambda block: list(POSITIONS).index(block.at))


def check_blocks(blocks: Sequence[Block]) -> None:
    """Raise ValueError for a repeated name, or a condition on a later question."""
    for kind, names in (
        ("blocks", [block.name for block in blocks]),
        ("questions", [question.name for block in blocks for question in block.questions]),
    ):
        if repeated := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"no two {kind} can be called {min(repeated)!r}")
    earlier: dict[str, Choice] = {}
    for block in in_order(blocks):
        if condition := block.shown_if:
            choice = earlier.get(condition.question)
            if choice is None:
                raise ValueError(
                    f"the block {block.name!r} is shown by {condition.question!r}, which is no choice of a block before it: "
                    f"there are {', '.join(earlier) or 'none'}"
                )
            if max(condition.answers) >= len(choice.choices):
                raise ValueError(
                    f"the block {block.name!r} is shown by answers 0 to {len(choice.choices) - 1} of "
                    f"{condition.question!r}, got {max(condition.answers)}"
                )
        choices = [question for question in block.questions if isinstance(question, Choice)]
        earlier |= {question.name: question for question in choices}


def drawn_order(question: BlockQuestion, participant_id: str, turn: int) -> list[int]:
    """The indices of a question's choices in the order in which one person sees them."""
    count = len(question.choices) if isinstance(question, _Choices) else 0
    if not question.is_shuffled:
        return list(range(count))
    drawn = f"{participant_id}|{question.name}|{turn}"
    return sorted(
        range(count), key=lambda index: hashlib.sha256(f"{drawn}|{index}".encode()).digest()
    )


def shown(block: Block, participant_id: str, turn: int) -> Shown:
    """What a page gets of a block: no right answers, no conditions of other blocks."""
    return {
        "name": block.name,
        "turn": turn,
        "title": block.title,
        "intro": block.intro,
        "can_be_skipped": block.at == "after",
        "questions": [_shown(question, participant_id, turn) for question in block.questions],
    }


def _shown(question: AnyQuestion, participant_id: str, turn: int) -> Shown:
    fields: Shown = {
        "kind": question.kind,
        "name": question.name,
        "question": question.question,
        "needed": question.needed,
        "declinable": question.offers_declining,
        **question.shown(),
    }
    if isinstance(question, _Choices):
        order = drawn_order(question, participant_id, turn)
        fields["choices"] = [{"value": index, "text": question.choices[index]} for index in order]
    return fields


@dataclass(frozen=True)
class NumberAnswer:
    """A number that answers a part of a question.

    answer  None: prefer not to say
    place   of a choice: at which place it was shown, from 0
    """

    question: str
    part: int
    answer: float | None
    place: int | None = None


@dataclass(frozen=True)
class Answers:
    """What somebody answered in a block; a text of None: prefer not to say.

    missed  attention checks that were left out, declined or answered wrongly
    """

    numbers: tuple[NumberAnswer, ...]
    texts: dict[str, str | None]
    missed: int = 0


def missed_in(block: Block, answers: Mapping[str, float | None]) -> int:
    """How many attention checks of a block were not answered rightly.

    Args:
        answers: By question; a skipped block has none.
    """
    return sum(answers.get(check.name) != check.answer for check in block.attention_checks)


def check_answers(
    block: Block, sent: Mapping[str, Sent], participant_id: str, turn: int
) -> Answers:
    """Check the answers to a block; ValueError for a wrong or a missing one."""
    names = {question.name for question in block.questions}
    if unknown := sorted(sent.keys() - names):
        raise ValueError(f"the block {block.name!r} has no question {unknown[0]!r}")
    numbers: list[NumberAnswer] = []
    texts: dict[str, str | None] = {}
    for question in block.questions:
        if question.name not in sent:
            if question.needed:
                raise ValueError(f"{question.name} needs an answer, or prefer not to say")
            continue
        answer = sent[question.name]
        if answer is None and not question.offers_declining:
            raise ValueError(f"{question.name} can be left out, and not be declined")
        try:
            if isinstance(question, Text):
                texts[question.name] = None if answer is None else question.text(answer)
            else:
                numbers += _numbers(question, answer, drawn_order(question, participant_id, turn))
        except ValueError as error:
            raise ValueError(f"{question.name} {error}") from error
    missed = missed_in(block, {number.question: number.answer for number in numbers})
    return Answers(tuple(numbers), texts, missed)


def _numbers(question: BlockQuestion, sent: Sent, order: Sequence[int]) -> Iterator[NumberAnswer]:
    if sent is None:
        yield from (NumberAnswer(question.name, part, None) for part in range(len(question.parts)))
        return
    for part, answer in question.numbers(sent).items():
        chosen = part if len(question.parts) > 1 else int(answer)
        place = order.index(chosen) if order else None
        yield NumberAnswer(question.name, part, answer, place)
