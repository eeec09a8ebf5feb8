"""The secrets of studies as their folder holds them: for checks, and for a study whose end the database has not noted yet."""

from __future__ import annotations

from pathlib import Path

from app.study.folder import Folder, StudyError


def known_secrets(studies: Path) -> dict[str, tuple[int | None, bytes]]:
    """Return what the folder of studies knows, by study: (closed_ms or None while open, secret); drafts are left out."""
    folder = Folder(studies)
    found: dict[str, tuple[int | None, bytes]] = {}
    for name in folder.names():
        try:
            study = folder.study(name)
        except StudyError:  # a draft, or damaged: `study show` tells
            continue
        found[name] = (study.closed_ms, study.secret)
    return found
