"""The arms of a protocol, and the checks that compare them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from pydantic import Field

from humanplay.board.messages import DRIVING_KEYS
from humanplay.study.questions import Block, Line, Name, Part, Question, in_order
from humanplay.task import Environment

Key = Annotated[str, Field(max_length=32)]
"""The `event.code` of a key."""


class Arm(Part):
    """A condition, and what only the people assigned to it read.

    A block of questions names the arms that are asked it.
    """

    name: Name
    """Its name in tables; no participant reads it."""

    instructions: str = Field(default="", max_length=5_000)
    """Paragraphs below the instructions, split by blank lines; may be empty."""

    hint: str = Field(default="", max_length=500)
    """A text beside the board in each episode; may be empty."""

    keys: dict[Line, tuple[Key, ...]] = Field(default_factory=dict)
    """Action -> its keys, as many as the task has for it; empty: the task's keys.

    Participants may choose other keys, as in every study.
    """

    questions: tuple[Question, ...] = Field(default=(), max_length=10)
    """Questions on the instructions, asked after the protocol's own."""


def check_arms_differ(arms: Sequence[Arm], blocks: Sequence[Block]) -> None:
    """Check that arms differ, and that blocks name existing arms.

    Raises:
        ValueError: If they do not.
    """
    names = [arm.name for arm in arms]
    if len(names) == 1 or len(set(names)) < len(names):
        raise ValueError(
            f"arms must be none, or two or more with different names; got {', '.join(names)}"
        )
    for block in blocks:
        if unknown := [name for name in block.arms if name not in names]:
            raise ValueError(
                f"the block {block.name!r} names the arm {unknown[0]!r}, but the protocol has no such arm "
                f"(it has: {', '.join(names) or 'none'})"
            )
    counts = [len(arm.questions) for arm in arms]
    if len(set(counts)) > 1:
        raise ValueError(
            "all arms must ask the same number of questions, since more questions screen out more people; "
            f"got {' and '.join(map(str, counts))}"
        )
    _check_contents_differ(arms, blocks)


def _check_contents_differ(arms: Sequence[Arm], blocks: Sequence[Block]) -> None:
    arm_by_content: dict[object, str] = {}
    for arm in arms:
        block_names = frozenset(block.name for block in blocks if arm.name in block.arms)
        keys = tuple(sorted(arm.keys.items()))
        content = (arm.instructions, arm.hint, keys, arm.questions, block_names)
        if other := arm_by_content.get(content):
            raise ValueError(
                f"the arms {other!r} and {arm.name!r} do not differ: give one of them instructions, a hint, keys or "
                "questions, or name one of them in the arms of a block"
            )
        arm_by_content[content] = arm.name


def check_keys_of_arms(arms: Sequence[Arm], environment: Environment) -> None:
    """Check that each arm's keys may drive, differ, and are as many as the task's.

    Raises:
        ValueError: If they do not.
    """
    counts = {action: len(codes) for action, codes in environment.keys.items()}
    # keys of the task itself, such as Space in a game that fires with it, may drive in every arm
    may_drive = DRIVING_KEYS.union(*environment.keys.values())
    for arm in arms:
        codes = [code for action_codes in arm.keys.values() for code in action_codes]
        if strange := [code for code in codes if code not in may_drive]:
            raise ValueError(
                f"the keys of the arm {arm.name!r} must be codes of keys that may drive, like KeyI or ArrowUp, or the "
                f"task's own, got {strange[0]!r}; Space, Enter, Tab and Escape stay with the page, whose buttons they press"
            )
        counts_of_arm = {action: len(action_codes) for action, action_codes in arm.keys.items()}
        if arm.keys and (counts_of_arm != counts or len(set(codes)) < len(codes)):
            expected = ", ".join(f"{count} of {action}" for action, count in counts.items())
            raise ValueError(f"the keys of the arm {arm.name!r} must be different keys: {expected}")


def check_attention_of_arms(blocks: Sequence[Block]) -> None:
    """Check that no attention check is asked of some arms only.

    Raises:
        ValueError: If one is.
    """
    questions_of_some: set[str] = set()
    for block in in_order(blocks):
        condition = block.shown_if
        # a block that follows from an answer of some arms is theirs too
        follows = condition is not None and condition.question in questions_of_some
        if not block.arms and not follows:
            continue
        questions_of_some |= {question.name for question in block.questions}
        if block.attention_checks:
            raise ValueError(
                f"the block {block.name!r} has an attention check for some arms alone, so that more people of one arm "
                "would be left out: ask everybody"
            )
