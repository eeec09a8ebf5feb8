"""The boards that are being played, for the operator: every frame, with its scores but a person's in an open study."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator
from typing import Any

from app.board.lobby import Lobby
from app.board.session import Session
from app.db.series import StudyStore
from app.db.study_rows import Participant, participant_label
from app.db.trial import Trial

MAX_BOARDS = 60
"""Boards in a list."""


async def list_boards(lobby: Lobby, study_store: StudyStore) -> list[dict[str, Any]]:
    """Return the boards that a person or a script plays now, those of participants first; no player's id."""
    live = (each for each in lobby.sessions() if each.is_human and each.channel.subscribers)
    listed = sorted(live, key=lambda session: session.participation is None)[:MAX_BOARDS]

    def newest(present: Participant | None) -> Trial | None:
        trials = [] if present is None else study_store.trials(present.id)
        return trials[-1] if trials else None

    def read() -> list[tuple[Participant | None, Trial | None]]:
        present = (study_store.participant_of_session(session.id) for session in listed)
        return [(each, newest(each)) for each in present]

    found = []
    for session, (participant, trial) in zip(listed, await lobby.store.read(read), strict=True):
        found.append(
            {
                "session": session.id,
                "study": participant and participant.study,
                "label": participant and participant_label(participant.id),
                "kind": participant.kind if participant else session.current.driver,
                "phase": trial and trial.phase,
                "trial": trial and trial.trial,
                "ended": session.shown.ended,
                "level": session.current.config.level,
            }
        )
    return sorted(
        found, key=lambda each: (each["study"] is None, str(each["label"] or each["session"]))
    )


async def board_messages(session: Session) -> AsyncGenerator[str, None]:
    """Yield the newest frame of a board whenever it changes, and its history wherever frames were missed, until closed.

    Scores of a person in a study are left out while it is open.
    The operator is no subscriber: a board that its player has left is not kept alive by being watched.
    """
    frame, episode, steps = "", "", 0
    hides = session.participation is not None and session.participation.hides_figures()
    woken = asyncio.Event()
    woken.set()
    leave = session.channel.add_listener(woken.set)
    try:
        while await woken.wait():
            woken.clear()
            newest = session.shown.frame(session.current.id, hides)
            if newest == frame:
                continue
            frame = newest
            yield frame
            if session.current.id != episode or session.shown.steps > steps + 1:
                yield session.history()
            episode, steps = session.current.id, session.shown.steps
    finally:
        leave()
