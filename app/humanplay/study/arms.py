"""The arms of a study: when people are assigned to one, and what only they read."""

from __future__ import annotations

import json
from functools import partial

from humanplay.db.series import StudyStore
from humanplay.db.study_rows import Participant, Stage
from humanplay.study.folder import Study
from humanplay.study.invitations import Invitations
from humanplay.study.protocol import Protocol
from humanplay.study.protocol_arms import Arm
from humanplay.study.questions import Question


def stage_of_assignment(protocol: Protocol) -> Stage | None:
    """The stage of the first page that differs, `ranked` at last; None without arms.

    The order of the ranked terrains is balanced within each arm, so all are assigned before it is drawn.
    """
    if not protocol.arms:
        return None
    differs_before = any(block.arms and block.at == "before" for block in protocol.blocks)
    # the keys stand below the instructions
    if differs_before or any(arm.instructions or arm.keys for arm in protocol.arms):
        return "instructions"
    if any(arm.hint for arm in protocol.arms):
        return "tutorial"
    return "questions" if any(arm.questions for arm in protocol.arms) else "ranked"


def reach_stage(
    study_store: StudyStore,
    study: Study,
    participant: Participant,
    at_ms: int,
    stage: Stage,
    invitations: Invitations,
    **columns: str | int,
) -> None:
    """Move a participant to a stage, and assign them to an arm if that is due there.

    Both are one write: nobody comes to a page that differs without an arm, and nobody is assigned twice. The operator's
    assignments are noted when chance's are, so that attrition by arm begins at the same page for everybody.

    Raises:
        StudyError: If the invitations, which may name an arm, cannot be read.
    """
    with study_store.transaction():
        study_store.set_stage(participant.id, at_ms, stage, **columns)
        if stage != stage_of_assignment(study.protocol):
            return
        if arm := _operators_arm(invitations, study, participant):
            study_store.note_operators_arm(participant.id, at_ms, arm)
        else:
            draw = partial(study.arm, participant.kind)
            study_store.assign_arm(participant, at_ms, draw)
        _take_keys(study_store, study, participant, at_ms)


def _operators_arm(invitations: Invitations, study: Study, participant: Participant) -> str | None:
    """The arm that a participant's invitation names; None if chance assigns them."""
    if study.protocol.recruitment != "invitation" or participant.kind != "human":
        return None
    invitation = invitations.of(study.name).get(participant.invitation or "")
    return None if invitation is None else invitation.arm


def _take_keys(study_store: StudyStore, study: Study, participant: Participant, at_ms: int) -> None:
    """Where arms differ in keys, give somebody those of their arm for what they had."""
    if any(arm.keys for arm in study.protocol.arms):
        keys = keys_of(study.protocol, arm_of(study_store, study, participant))
        settings = {**json.loads(participant.settings), "keys": keys}
        study_store.set_settings(participant.id, at_ms, settings)


def keys_of(protocol: Protocol, arm: Arm | None) -> dict[str, list[str]]:
    """The keys that somebody begins with, in the order of the actions."""
    keys = protocol.environment.keys if arm is None or not arm.keys else arm.keys
    return {action: list(keys[action]) for action in protocol.environment.keys}


def arm_of(study_store: StudyStore, study: Study, participant: Participant) -> Arm | None:
    """The arm of a participant; None before they are assigned, and without arms."""
    name = arm_name(study_store, study, participant)
    return next((arm for arm in study.protocol.arms if arm.name == name), None)


def questions_of(protocol: Protocol, arm: Arm | None) -> tuple[Question, ...]:
    """The questions on the instructions of somebody, those of their arm last."""
    return (*protocol.questions, *(() if arm is None else arm.questions))


def arm_name(study_store: StudyStore, study: Study, participant: Participant) -> str | None:
    """The name of a participant's arm; without arms the database is not asked."""
    return study_store.arm(participant.id) if study.protocol.arms else None
