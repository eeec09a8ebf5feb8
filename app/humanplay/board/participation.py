"""What a board asks of a participant's part in a study, and how it refuses a move."""

from __future__ import annotations

from typing import Protocol

from humanplay.board.controls import ClockLimits
from humanplay.db.rows import PlayerSettings

HUMAN, SCRIPT = "human", "script"
"""Who drives an episode, if no policy does."""


class RefusedError(Exception):
    """The move does not answer the current frame, or is not this sender's to make; nothing has changed."""


class StudyUnavailableError(RefusedError):
    """The study cannot go on at the moment; the same request may succeed later."""


class Participation(Protocol):
    """A participant's part in a study, as far as their board must ask for it; `humanplay.study` implements it.

    A board without a participation belongs to anybody who knows its id. Everything but `driver`, `study` and `check_open`
    asks the database: call it in `Store.write` or `Store.read`.
    """

    @property
    def driver(self) -> str:
        """Return who drives an episode at its start: "human" or "script"."""

    @property
    def study(self) -> str:
        """Return the name of the study."""

    def is_erased(self) -> bool:
        """Whether the participant was erased meanwhile."""

    def hides_scores(self, episode_id: str) -> bool:
        """Return whether frames of the episode leave out reward, return and score."""

    def is_secret(self, episode_id: str) -> bool:
        """Whether nobody but the participant sees anything of the episode, the operator included."""

    def check_open(self) -> None:
        """Raise RefusedError when the study is closed and no move may be made."""

    @property
    def clock_limits(self) -> ClockLimits:
        """Return what an episode may have in time, where a clock runs; RefusedError where the study cannot be looked up."""

    def note_script(self, episode_id: str) -> None:
        """Record that a person's episode has become a script's, in the transaction of the move that made it so."""

    def note_stopped(self, episode_id: str) -> None:
        """Record that a rule of the protocol ended an episode, in the transaction that ends it."""

    def note_end(self) -> None:
        """Record that an episode has ended, in the transaction that ends it."""

    def check_events(self, episode_id: str) -> None:
        """Check that input events of an episode are to be kept; RefusedError when it is none of this participation."""

    def settings(self) -> list[PlayerSettings]:
        """Return what the participant has chosen (`keys` among it), every version so far."""

    def supervised_ms(self) -> tuple[int, ...]:
        """Return when the operator's code was typed for the participant."""
