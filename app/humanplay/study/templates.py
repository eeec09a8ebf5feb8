"""A draft's texts are templates: `{ranked}` stands for a number of the protocol.

So a text cannot promise another study. Freezing fills the texts in and writes what participants read;
a frozen text is never filled in again. A number written by hand beside a word for episodes is refused,
because it would stay when the protocol is edited.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Sequence
from string import Formatter

from humanplay.study.practice import criterion
from humanplay.study.protocol import Protocol, StudyError, parse_protocol
from humanplay.study.questions import Block
from humanplay.study.screening import playing_minutes
from humanplay.study.wording import Wording
from humanplay.task.sentences import Sentence

PLACEHOLDERS = {
    "name": "the study's name",
    "warm_up": "episodes that do not count",
    "ranked": "episodes that count",
    "episodes": "warm_up and ranked together",
    "practice": "what the practice asks for, after a space; nothing without a practice",
    "break_every": "ranked episodes after which a break is offered",
    "pause_after": "seconds without a key after which the page pauses",
    "minutes": "how long it takes: 5 minutes, and three quarters of a minute an episode on 441 cells, in fives",
    "questions": "understanding questions",
    "players": "participants planned",
    "asked": "a sentence that names the blocks of questions about people, after a space; nothing without any",
    "licence": "licence of the published data",
    "contact": "who is responsible for the data, as declared",
    "retention": "how long the data are stored, as declared",
    "coverage": "share of the cells that completes a terrain, as in 99 %",
    "lidar_radius": "how far the lidar reaches, in cells",
    "rows": "cells of a terrain from north to south",
    "cols": "cells of a terrain from west to east",
    "max_steps": "moves after which an episode ends",
}
"""What a text may name in braces, and what it stands for. `{{` and `}}` are braces themselves."""

TEXT_PARTS = ("title", "consent", "questions", "arms", "blocks")
"""The fields of a protocol that hold texts."""
TEXT_FIELDS = (
    *("text", "instructions", "hint", "questions", "title", "about", "intro", "question"),
    *("choices", "why", "rows", "points", "low", "high", "unit"),
)
"""The fields of these parts that participants read."""
_SMALL = (
    "two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen seventeen eighteen "
    "nineteen"
)
_TENS = "twenty thirty forty fifty sixty seventy eighty ninety"
_WORDS = "|".join(
    (
        *_SMALL.split(),
        *(f"{tens}(?:[- ](?:one|{'|'.join(_SMALL.split()[:8])}))?" for tens in _TENS.split()),
    )
)
_KINDS = r"practice|practise|training|warm-?\s?up|ranked|scored|counted|counting|test|further|more|other|real"
_THINGS = r"rounds?|episodes?|terrains?|trials?"
_BY_HAND = re.compile(
    rf"(?<![\w.])(?<![a-z]-)(?P<number>\d+|(?<!of )(?:{_WORDS}|(?:a |one )?hundred))"
    rf"(?:[\s\u00a0-]+(?:{_KINDS}))*[\s\u00a0-]+(?:{_THINGS})\b",
    re.IGNORECASE,
)
"""A number of 2 or more directly before a word for episodes; "which of two rounds" compares and counts none."""
_ONE_OF_MANY = re.compile(
    rf"(?<![\w.,-])(1(?:[\s\u00a0-]+(?:{_KINDS}))*[\s\u00a0-]+(?:round|episode|terrain|trial|question|participant))s\b",
    re.IGNORECASE,
)
"""What a filled-in 1 leaves in the plural."""


def fill(protocol: Protocol, wording: Wording | None = None) -> Protocol:
    """The protocol with every text filled in.

    Args:
        wording: Of the language that the texts are in; None: English.

    Raises:
        StudyError: If a text has an unknown placeholder, or counts episodes by hand.
    """
    values = placeholder_values(protocol, wording)

    def filled_in(path: str, text: str) -> str:
        _check_numbers(path, text)
        return _text_filled(path, text, values)

    fields = protocol.model_dump(mode="json")
    texts = {part: changed_texts(part, fields[part], filled_in) for part in TEXT_PARTS}
    return parse_protocol({**fields, **texts})


def changed_texts(path: str, content: object, change: Callable[[str, str], str]) -> object:
    """A part of a protocol, as JSON, with each text in it changed.

    Args:
        path: Where the part stands, as in `questions[0].choices[1]`.
        change: Is called with where a text stands, and the text.
    """
    if isinstance(content, list):
        return [
            changed_texts(f"{path}[{place}]", part, change) for place, part in enumerate(content)
        ]
    if isinstance(content, dict):
        texts = {
            name: changed_texts(f"{path}.{name}", part, change)
            for name, part in content.items()
            if name in TEXT_FIELDS
        }
        return {**content, **texts}
    return change(path, content) if isinstance(content, str) else content


def filled(text: str, protocol: Protocol) -> str:
    """A text that goes with a study, filled in; `{title}` is the study's title."""
    values = placeholder_values(protocol)
    title = _text_filled("title", protocol.title, values)
    return _text_filled("the text", text, {**values, "title": title})


def placeholder_values(protocol: Protocol, wording: Wording | None = None) -> dict[str, str]:
    """Placeholder -> what it becomes in this protocol.

    Args:
        wording: Of the language that the texts are in; None: English.
    """
    config = protocol.env_config
    say = str if wording is None else wording.say
    practice = say(criterion(protocol, wording))
    values: dict[str, object] = {
        "name": protocol.dry_run_of or protocol.name,
        "warm_up": protocol.warm_up,
        "ranked": protocol.ranked,
        "episodes": protocol.warm_up + protocol.ranked,
        "practice": f" {practice}" if practice else "",
        "break_every": protocol.break_every,
        "pause_after": f"{protocol.pause_after_s:g}",
        "minutes": 5 + 5 * max(1, round(playing_minutes(protocol) / 5)),
        "questions": protocol.question_count,
        "players": protocol.players,
        "asked": say(_asked(protocol.blocks)),
        "licence": protocol.data_licence,
        "contact": protocol.declarations.contact or "TODO",
        "retention": protocol.declarations.retention or "TODO",
        **protocol.environment.texts(config).placeholders,
        "max_steps": config.limit,
    }
    return {name: str(value) for name, value in values.items()}


def _asked(blocks: Sequence[Block]) -> str:
    """What the consent text says of the blocks."""
    if not blocks:
        return ""
    listed = "; ".join(block.about for block in blocks)
    return Sentence(
        "consent.asked",
        " We also ask about {listed}. You may leave a question out, or prefer not to say. How many people gave which "
        "answer will be published.",
        listed=listed,
    )


def _text_filled(part_name: str, text: str, values: dict[str, str]) -> str:
    """A text with its placeholders filled in."""
    parts = []
    try:
        for literal, name, form, conversion in Formatter().parse(text):
            parts.append(literal)
            if name is not None:
                rest = (f"!{conversion}" if conversion else "") + (f":{form}" if form else "")
                parts.append(_value(part_name, name + rest, values))
    except ValueError as error:
        raise StudyError(
            f"{part_name} has a brace without its pair: write {{{{ and }}}} for braces that stand for themselves"
        ) from error
    return _ONE_OF_MANY.sub(r"\1", "".join(parts))


def _value(part_name: str, name: str, values: dict[str, str]) -> str:
    if name in values:
        return values[name]
    near = difflib.get_close_matches(name.lower(), values, n=1, cutoff=0.5)
    guess = f"did you mean {{{near[0]}}}? " if near else ""
    placeholders = ", ".join(f"{{{known_name}}}" for known_name in values)
    raise StudyError(
        f"{part_name} has the unknown placeholder {{{name}}}: {guess}there are {placeholders}; {{{{ and }}}} write braces"
    )


def _check_numbers(part_name: str, text: str) -> None:
    """StudyError if a number of episodes is written by hand."""
    for match in _BY_HAND.finditer(text):
        number = match["number"]
        if number.isdigit() and int(number) < 2:
            continue
        raise StudyError(
            f"{part_name} counts by hand: {' '.join(match[0].split())!r}. A text must name the protocol's own numbers, which "
            "stay right when the protocol changes: write {warm_up}, {ranked}, {episodes} or {break_every} in place of "
            f"{number!r}, or say it without a number"
        )
