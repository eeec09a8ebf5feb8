"""Which block of questions a participant is asked next, and storing their answers.

A block is due between two steps of a study, so no stage of its own is kept: whoever has ended the last ranked episode has
finished, whatever becomes of the questions after it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from humanplay.db.series import StudyStore
from humanplay.db.study_rows import AnswerRow, FreeTextRow, Participant
from humanplay.db.trial import Trial
from humanplay.study.arms import arm_name
from humanplay.study.folder import Study
from humanplay.study.protocol import Protocol
from humanplay.study.questions import (
    Block,
    Position,
    Sent,
    check_answers,
    in_order,
    missed_in,
)


class DueBlock(NamedTuple):
    """A block that must be answered next.

    A block between sets is asked again and again: its `turn` is the ranked episodes done so far.
    """

    block: Block
    turn: int


def break_due(protocol: Protocol, participant: Participant, trials: Sequence[Trial]) -> bool:
    """Whether a break is offered now: every `break_every` ranked episodes."""
    ranked = [trial for trial in trials if trial.phase == "ranked"]
    has_ended = bool(ranked) and ranked[-1].ended_ms is not None
    is_due = has_ended and len(ranked) % protocol.break_every == 0
    return is_due and participant.stage == "ranked"


def due_blocks(
    study_store: StudyStore, study: Study, participant: Participant, trials: Sequence[Trial]
) -> list[DueBlock]:
    """The blocks that are due now, in order; none in a study that is not running.

    Args:
        trials: Of the participant.
    """
    blocks = in_order(study.protocol.blocks)
    place = _place(study.protocol, participant, trials) if blocks and study.is_running else None
    if place is None:
        return []
    position, turn = place
    done, arm = study_store.blocks_done(participant.id), arm_name(study_store, study, participant)
    return [
        DueBlock(block, turn)
        for block in blocks
        if block.at == position
        and (block.name, turn) not in done
        and (not block.arms or arm in block.arms)
        and (
            block.shown_if is None
            or study_store.has_answered(
                participant.id, block.shown_if.question, block.shown_if.answers
            )
        )
    ]


def store_answers(
    study_store: StudyStore,
    participant_id: str,
    due: DueBlock,
    sent: Mapping[str, Sent],
    at_ms: int,
) -> None:
    """Check the answers to a block and store them; ValueError for a wrong one."""
    block, turn = due
    answers = check_answers(block, sent, participant_id, turn)
    numbers = [
        AnswerRow(
            participant_id,
            block.name,
            turn,
            number.question,
            number.part,
            number.answer,
            number.place,
            at_ms,
        )
        for number in answers.numbers
    ]
    texts = [
        FreeTextRow(participant_id, block.name, turn, question, words)
        for question, words in answers.texts.items()
    ]
    detail = _detail(due, is_skipped=False)
    if block.attention_checks:
        detail["missed"] = answers.missed
    study_store.note_block(participant_id, at_ms, detail, numbers, texts)


def skip(
    study_store: StudyStore, participant_id: str, blocks: Sequence[DueBlock], at_ms: int
) -> None:
    """Note that blocks were skipped, with the attention checks in them as missed."""
    for due in blocks:
        detail = _detail(due, is_skipped=True)
        if due.block.attention_checks:
            detail["missed"] = missed_in(due.block, {})
        study_store.note_block(participant_id, at_ms, detail)


def _detail(due: DueBlock, is_skipped: bool) -> dict[str, object]:
    return {"block": due.block.name, "turn": due.turn, "skipped": is_skipped}


def _place(
    protocol: Protocol, participant: Participant, trials: Sequence[Trial]
) -> tuple[Position, int] | None:
    """Where a participant stands, if a block can stand there."""
    if participant.stage == "instructions":
        return "before", 0
    if participant.stage == "debrief":
        return "after", 0
    ranked = sum(trial.phase == "ranked" for trial in trials)
    if participant.stage == "ranked" and not ranked:
        return "after_warm_up", 0
    if break_due(protocol, participant, trials):
        return "between_sets", ranked
    return None
