"""What a board needs to know of a participant's study, and how it refuses a move."""

from __future__ import annotations

from typing import Protocol

from humanplay.board.controls import ClockLimits
from humanplay.db.rows import PlayerSettings

HUMAN, SCRIPT = "human", "script"
"""Who drives an episode, if no policy does."""


class RefusedError(Exception):
    """The move answers an old frame, or is not this sender's to make.

    Nothing has changed.
    """


class StudyUnavailableError(RefusedError):
    """The study cannot go on at the moment; the same request may succeed later."""


class Participation(Protocol):
    """A participant's part in a study, as far as their board must ask for it.

    `humanplay.study` implements it. A board without a participation belongs to anybody who knows
    its id. All but `driver`, `study`, `check_open` and `clock_limits` read the database: call the
    others in `Store.write` or `Store.read`.
    """

    @property
    def driver(self) -> str:
        """Who drives an episode at its start: "human" or "script"."""

    @property
    def study(self) -> str:
        """The name of the study."""

    def is_erased(self) -> bool:
        """Whether the participant was erased meanwhile."""

    def hides_scores(self, episode_id: str) -> bool:
        """Whether frames of the episode leave out reward, return and score."""

    def is_secret(self, episode_id: str) -> bool:
        """Whether only the participant sees the episode: not even the operator."""

    def check_open(self) -> None:
        """Raise RefusedError if the study is closed and no move may be made."""

    @property
    def clock_limits(self) -> ClockLimits:
        """How often and how long a board with a clock may stand still.

        Raises:
            RefusedError: If the study cannot be looked up.
        """

    def note_script(self, episode_id: str) -> None:
        """Record that a person's episode has become a script's.

        Call it in the transaction of the move that made it so.
        """

    def note_stopped(self, episode_id: str) -> None:
        """Record that a rule of the protocol ended an episode.

        Call it in the transaction that ends it.
        """

    def note_end(self) -> None:
        """Record that an episode has ended, in the transaction that ends it."""

    def check_events(self, episode_id: str) -> None:
        """Check that this participation may add input events to an episode.

        Raises:
            RefusedError: If the episode is not of this participation.
        """

    def settings(self) -> list[PlayerSettings]:
        """Every version of the participant's settings, `keys` among them."""

    def supervised_ms(self) -> tuple[int, ...]:
        """When the operator's code was typed for the participant."""
