"""How many people gave which answer, for reports and releases.

A cell of one or two people is joined with a neighbour, so that nobody stands alone in it.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean, stdev

from humanplay.db.study_rows import AnswerRow, FreeTextRow
from humanplay.study.questions import (
    AnyQuestion,
    AttentionCheck,
    Block,
    Choice,
    Likert,
    MultipleChoice,
    Number,
    Scale,
    Statement,
    Text,
)

FEWEST = 3
"""People in a cell, at least; nobody may be in it."""
FEWEST_FOR_MEAN = 10
"""People whose numbers have a mean and SD, at least; of fewer, these give away each number.

Answers of which cells are joined have none: with them one could solve for what a cell hides.
"""
CLASSES = 10
"""Classes of a number, at most, before cells are joined."""
DECLINED = "prefer not to say"
Key = tuple[str, int, str, int]
"""Block, turn, question and part."""


@dataclass(frozen=True)
class Cell:
    """People who gave one answer, or one of several that are joined."""

    answers: str
    people: int


@dataclass(frozen=True)
class AnswerCounts:
    """How many people gave which answer to a part of a question.

    turn    ranked episodes done, of a block between sets; else 0
    asked   the question, with its part
    people  who answered, "prefer not to say" included; None: fewer than three, and no cell is told
    mean    of the answers of a Likert row (its points count from 1), a scale (its steps from 0) or a number, to a tenth;
            None: fewer than ten people answered with one, cells are joined, and of other questions
    sd      their standard deviation, of a sample, to a tenth
    """

    block: str
    turn: int
    question: str
    part: int
    asked: str
    people: int | None
    cells: tuple[Cell, ...]
    mean: float | None = None
    sd: float | None = None

    @property
    def key(self) -> Key:
        """What it counts."""
        return self.block, self.turn, self.question, self.part

    def sentence(self) -> str:
        """The counts in words."""
        if self.people is None:
            return f"fewer than {FEWEST} people answered"
        cells = "; ".join(f"{cell.answers}: {cell.people}" for cell in self.cells)
        return f"{cells} ({words})" if (words := self.mean_and_sd()) else cells

    def mean_and_sd(self) -> str:
        """Mean and standard deviation in words; empty if there are none."""
        if self.mean is None or self.sd is None:
            return ""
        return f"mean {self.mean:.1f}, SD {self.sd:.1f}"


def count_answers(
    blocks: Sequence[Block], numbers: Iterable[AnswerRow], texts: Iterable[FreeTextRow]
) -> tuple[AnswerCounts, ...]:
    """Count the answers of some people, in the order of the questions."""
    answers = defaultdict[Key, list[float | None]](list)
    for row in numbers:
        answers[row.block, row.turn, row.question, row.part].append(row.answer)
    for text in texts:
        wrote = None if text.words is None else 1.0
        answers[text.block, text.turn, text.question, 0].append(wrote)
    questions = {question.name: question for question in _questions(blocks)}
    places = {name: place for place, name in enumerate(questions)}
    keys = sorted(answers, key=lambda key: (places[key[2]], key[1], key[3]))
    return tuple(_counts(questions[key[2]], key, answers[key]) for key in keys)


def _counts(question: AnyQuestion, key: Key, answers: Sequence[float | None]) -> AnswerCounts:
    part = question.parts[key[3]] if question.parts else ""
    asked = f"{question.question} {part}".strip()
    if len(answers) < FEWEST:
        return AnswerCounts(*key, asked, None, ())
    ends = [*_ends(question), (DECLINED, DECLINED)]
    people = [0] * len(ends)
    for answer in answers:
        people[-1 if answer is None else _place(question, answer)] += 1
    in_range = isinstance(question, (Number, Scale))
    joined = _joined(people)
    cells = [
        Cell(_label(ends[first : last + 1], in_range), sum(people[first : last + 1]))
        for first, last in joined
    ]
    # a choice that nobody made is told, a step that nobody took is not
    shown = [cell for cell in cells if cell.people or not (in_range or cell.answers == DECLINED)]
    mean, sd = _mean_and_sd(question, answers) if len(joined) == len(people) else (None, None)
    return AnswerCounts(*key, asked, len(answers), tuple(shown), mean, sd)


def _mean_and_sd(
    question: AnyQuestion, answers: Sequence[float | None]
) -> tuple[float | None, float | None]:
    """Mean and standard deviation of answers that are numbers."""
    first = 1 if isinstance(question, Likert) else 0
    numbers = [answer + first for answer in answers if answer is not None]
    if not isinstance(question, (Likert, Number, Scale)) or len(numbers) < FEWEST_FOR_MEAN:
        return None, None
    return round(fmean(numbers), 1), round(stdev(numbers), 1)


def _ends(question: AnyQuestion) -> list[tuple[str, str]]:
    """The first and the last answer of each cell, before any are joined."""
    if isinstance(question, Number):
        width = _width(question)
        starts = range(
            math.floor(question.minimum / width), math.floor(question.maximum / width) + 1
        )
        gap = 1 if question.whole else 0
        return [
            (
                f"{max(question.minimum, start * width):.15g}",
                f"{min(question.maximum, (start + 1) * width - gap):.15g}",
            )
            for start in starts
        ]
    if isinstance(question, Scale):
        return [(str(step), str(step)) for step in range(question.steps)]
    if isinstance(question, MultipleChoice):
        labels: Sequence[str] = ("chosen", "not chosen")
    elif isinstance(question, Likert):
        labels = question.points
    elif isinstance(question, (Choice, AttentionCheck)):
        labels = question.choices
    else:
        labels = ("wrote something",) if isinstance(question, Text) else ("agreed",)
    return [(label, label) for label in labels]


def _place(question: AnyQuestion, answer: float) -> int:
    """The place of an answer's cell."""
    if isinstance(question, Number):
        width = _width(question)
        return math.floor(answer / width) - math.floor(question.minimum / width)
    if isinstance(question, MultipleChoice):
        return 0 if answer else 1
    return 0 if isinstance(question, (Text, Statement)) else int(answer)


def _width(question: Number) -> float:
    """How wide the classes of a number are: 1, 2 or 5 times a power of ten."""
    least = (question.maximum - question.minimum) / CLASSES
    power = 10.0 ** math.floor(math.log10(least))
    width = next(power * times for times in (1, 2, 5, 10) if power * times >= least * (1 - 1e-9))
    return max(width, 1.0) if question.whole else width


def _joined(people: Sequence[int]) -> list[tuple[int, int]]:
    """First and last place of each cell.

    Cells of one or two people are joined with the smaller neighbour.
    """
    cells = [(place, place, count) for place, count in enumerate(people)]
    while small := [cell for cell in cells if 0 < cell[2] < FEWEST]:
        at = cells.index(min(small, key=lambda cell: cell[2]))
        left = next((place for place in range(at - 1, -1, -1) if cells[place][2]), None)
        right = next((place for place in range(at + 1, len(cells)) if cells[place][2]), None)
        sides = [side for side in (left, right) if side is not None]
        other = min(sides, key=lambda side: cells[side][2])
        low, high = min(at, other), max(at, other)
        count = cells[at][2] + cells[other][2]
        cells[low : high + 1] = [(cells[low][0], cells[high][1], count)]
    return [(first, last) for first, last, _ in cells]


def _label(ends: Sequence[tuple[str, str]], in_range: bool) -> str:
    if not in_range:
        return " or ".join(first for first, _ in ends)
    answered = [pair for pair in ends if pair[0] != DECLINED]
    declined = [DECLINED] if len(answered) < len(ends) else []
    if not answered:
        return DECLINED
    first, last = answered[0][0], answered[-1][1]
    return " or ".join([first if first == last else f"{first} to {last}", *declined])


def known_counts(
    blocks: Sequence[Block],
    numbers: Iterable[AnswerRow],
    texts: Iterable[FreeTextRow],
    noted: str | None,
) -> tuple[AnswerCounts, ...]:
    """Counts of a study's answers: from the rows, or else as a release noted them.

    Args:
        noted: JSON of `to_json`; None for a database that no release was imported into.
    """
    counted = count_answers(blocks, numbers, texts)
    keys = {counts.key for counts in counted}
    left = [counts for counts in _from_json(noted or "[]") if counts.key not in keys]
    places = {question.name: place for place, question in enumerate(_questions(blocks))}
    merged = [*counted, *left]
    return tuple(sorted(merged, key=lambda one: (places[one.question], one.turn, one.part)))


def to_json(counts: Sequence[AnswerCounts]) -> str:
    """Counts as a release notes them."""
    return json.dumps([asdict(question_counts) for question_counts in counts], ensure_ascii=False)


def _from_json(text: str) -> list[AnswerCounts]:
    return [
        AnswerCounts(**{**counts, "cells": tuple(Cell(**cell) for cell in counts["cells"])})
        for counts in json.loads(text)
    ]


def _questions(blocks: Sequence[Block]) -> list[AnyQuestion]:
    return [question for block in blocks for question in block.questions]
