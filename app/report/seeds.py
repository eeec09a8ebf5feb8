"""The seeds of a study's ranked terrains, and whether it is closed: from its folder where that is given."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from app.storage.reader import Reader
from app.storage.study_reader import find_study, participants
from app.study.data import StudyData, load
from app.study.flow import with_invitations
from app.study.folder import Folder, Study
from app.study.invitations import Invitations
from app.study.policy_files import FOLDER
from app.study.protocol import StudyError


def load_with_folder(reader: Reader, studies: Path, name: str) -> tuple[StudyData, dict[int, int]]:
    """Return a study's data, and the seeds of its ranked terrains by index.

    Where the folder has the study, it gives every seed and says whether the study is closed; otherwise the seeds are those of
    terrains that somebody has begun. A study that nobody has joined is known from the folder alone. StudyError for a study that
    is in neither, and for two different ones of that name.
    """
    study, policies = _in_folder(studies, name), studies / name / FOLDER
    joined = find_study(reader, name) is not None
    if study is None:
        data = load(reader, name).with_policies_in(policies)
        return data, data.seeds()
    if joined:
        data = load(reader, name)
    else:
        data = StudyData(
            protocol=study.protocol,
            protocol_hash=study.protocol_hash,
            commitment=study.commitment,
            frozen_ms=study.frozen_ms,
            closed_ms=None,
            secret=None,
            people=(),
            trials=(),
            policy_files=study.policy_files,
        )
    if data.protocol_hash != study.protocol_hash:
        raise StudyError(
            f"the study {name!r} in {reader.path} has another protocol than the one in {studies}: give the right --studies"
        )
    opened = [
        person.invitation for person in participants(reader, name) if person.invitation is not None
    ]
    if study.protocol.recruitment == "invitation":
        data = replace(
            data,
            arrivals=with_invitations(data.arrivals, Invitations(Folder(studies)).of(name), opened),
        )
    if study.closed_ms is not None:
        data = replace(data, closed_ms=study.closed_ms, secret=study.secret.hex())
    data = data.with_policies_in(policies)
    return data, {i: study.seed("ranked", i) for i in range(study.protocol.ranked)}


def _in_folder(studies: Path, name: str) -> Study | None:
    """Return the frozen study of that name, None where the folder has none; StudyError for a draft or a thawed one."""
    folder = Folder(studies)
    return folder.study(name) if name in folder.names() else None
