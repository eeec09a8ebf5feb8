"""A player, an episode, a recorder: one board and the only way to move its rover.

`Session.act` is the journey of every move, whoever makes it: the move must answer the current frame, the rules step, the
store commits, and only then is the new frame told. A move that cannot be committed did not happen.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from app.play.channel import Channel
from app.play.messages import Events, Pace, encode_frame
from app.storage.store import Closing, EpisodeRow, Resumable, SessionRow, StepRow, Store
from marsexplorer.episode import Episode, Record, replay

HUMAN, SCRIPT = "human", "script"


class RefusedError(Exception):
    """The move does not answer the current frame, or is not this sender's to make; nothing has changed."""


class StudyUnavailableError(RefusedError):
    """The study cannot go on at the moment; whoever asks again later may be answered otherwise."""


@dataclass(frozen=True)
class Move:
    """A move as asked for: which frame it answers, where to, and who drives ("human", "script" or "policy:NAME")."""

    episode: str
    step: int
    action: int
    driver: str
    input: Literal["key", "touch"] | None = None
    key_down_ms: float | None = None
    key_up_ms: float | None = None
    client_ms: float | None = None


class Participation(Protocol):
    """What a study asks of a participant's board: a board without one is anybody's who knows its id."""

    @property
    def driver(self) -> str:
        """Who an episode is driven by at its start: "human" or "script"."""

    def hides_scores(self, episode_id: str) -> bool:
        """Return whether frames of the episode keep reward, return and score to themselves."""

    def check(self) -> None:
        """Return when moves may be made; RefusedError when the study is closed."""

    def note_script(self, episode_id: str) -> None:
        """Note that a person's episode has become a script's, in the transaction of the move that made it so."""

    def note_end(self) -> None:
        """Note that an episode has ended, in the transaction that ends it."""

    def take(self, events: Events) -> None:
        """Keep input events; RefusedError when they are of no episode of this participation."""


class Session:
    """One board: its row, its running episode with the row that fixes it, and the channel its frames go to.

    pace      how the policy at the controls moves, None for a person's board
    number    of the current episode, counting from 1; 0 before the first
    participation  a participant's, in a study; else None
    fault     one sentence when the policy at the controls has failed, else None
    thought   what the policy at the controls makes of the newest frame, encoded; "" when it says nothing
    beside    the board shown beside it on the same terrain (a rival's, its player's, a replay's), else None
    is_second  whether it is the second of the two: a rival's or a replay's
    touched   monotonic seconds of the last access
    """

    def __init__(
        self, row: SessionRow, store: Store, clock: Callable[[], int], participation: Participation | None = None
    ) -> None:
        self.id = row.id
        self.participation = participation
        self.row = row
        self.channel = Channel()
        self.pace = None if self.is_human else Pace(mode=row.pace_mode, moves_per_second=row.moves_per_second)
        self.number = 0
        self.fault: str | None = None
        self.thought = ""
        self.paired_with: Session | None = None
        self.is_second = row.rival_of is not None
        self.touched = time.monotonic()
        self.current: EpisodeRow
        self.episode: Episode
        self._store = store
        self._clock = clock

    @property
    def is_human(self) -> bool:
        """Whether no policy drives this board."""
        return self.row.driver_name == HUMAN

    @property
    def frame(self) -> str:
        """The newest frame, encoded."""
        return self.channel.frame

    @property
    def counts(self) -> bool:
        """Whether the episode, as far as can be said while it runs, counts for the human score."""
        row = self.current
        mine = self.is_human and self.participation is None
        return mine and row.driver == HUMAN and not row.assisted and not row.seed_chosen

    @property
    def driver(self) -> str:
        """Who an episode is driven by at its start: "human", "script" or "policy:NAME"."""
        if self.participation is not None:
            return self.participation.driver
        return HUMAN if self.is_human else f"policy:{self.row.driver_name}"

    def act(self, move: Move) -> None:
        """Return when the move is committed and told; RefusedError or StoreError otherwise, and then nothing has changed."""
        self._check_current(move.episode, move.step)
        if not self.is_human and move.driver in (HUMAN, SCRIPT):
            raise RefusedError(f"this rover is driven by the policy {self.row.driver_name!r}; only its pace can be changed")
        reward = self.episode.step(move.action)
        is_deviation = move.driver == SCRIPT and self.current.driver == HUMAN
        try:
            with self._store.transaction():
                if is_deviation and self.participation is not None:
                    self.participation.note_script(self.current.id)
                self._store.add_step(self._step_row(move, reward), self.episode.record() if self.episode.ended else None)
                if self.episode.ended and self.participation is not None:
                    self.participation.note_end()
        except BaseException:
            self.rewind(move.step)
            raise
        if is_deviation:
            self.current = dataclasses.replace(self.current, driver=SCRIPT)
        self.tell()

    def abandon(self, episode: str, step: int, note: Callable[[], None] | None = None) -> None:
        """Return with the running episode given up, for good, and told; `note()` runs in the same transaction."""
        self._check_current(episode, step)
        try:
            with self._store.transaction():
                self._store.close_episode(*self.give_up())
                if note is not None:
                    note()
                if self.participation is not None:
                    self.participation.note_end()
        except BaseException:
            self.rewind(step)
            raise
        self.tell()

    def begin(self, row: EpisodeRow, episode: Episode) -> None:
        """Return with the episode, which the store holds, on the board and its first frame told."""
        self.current, self.episode, self.number = row, episode, row.number
        self.fault = None
        self.tell()

    def give_up(self) -> Closing:
        """Return what closes the running episode as abandoned; `rewind` takes it back."""
        self.episode.abandon()
        return (self.current.id, self.episode.record(), self._clock())

    def rewind(self, steps: int) -> None:
        """Return with the episode running after its first `steps` moves again."""
        self.episode = revive(self.current, bytes(self.episode.actions[:steps]))

    def set_pace(self, pace: Pace) -> None:
        """Return with the pace kept and followers woken to hear of it."""
        self._store.set_pace(self.id, pace.mode, pace.moves_per_second)
        self.pace = pace
        self.channel.nudge()

    def fail(self, fault: str) -> None:
        """Return with the policy's failure told."""
        self.fault = fault
        self.channel.nudge()

    def tell_thought(self, thought: str) -> None:
        """Return with the policy's thought about the newest frame told; RuntimeError on a board that a person plays."""
        if self.is_human or self.participation is not None:
            raise RuntimeError("a policy's thoughts about a person's board are nobody's business")
        self.thought = thought
        self.channel.nudge()

    def tell(self) -> None:
        """Publish the frame as it stands, encoded once."""
        self.thought = ""
        hides_scores = self.participation is not None and self.participation.hides_scores(self.current.id)
        self.channel.publish(encode_frame(self.current.id, self.episode, hides_scores))

    def _check_current(self, episode: str, step: int) -> None:
        if self.participation is not None:
            self.participation.check()
        if episode != self.current.id:
            raise RefusedError(f"episode {episode!r} is not the current one, which is {self.current.id!r}")
        if self.episode.ended:
            raise RefusedError(f"the episode has ended ({self.episode.outcome}); begin the next one")
        if step != self.episode.steps:
            raise RefusedError(f"step {step} is not the current one, which is {self.episode.steps}")

    def _step_row(self, move: Move, reward: float) -> StepRow:
        return StepRow(
            episode_id=self.current.id,
            step=move.step,
            action=move.action,
            reward=reward,
            discovered=self.episode.discovered,
            server_ms=self._clock(),
            client_ms=move.client_ms,
            key_down_ms=move.key_down_ms,
            key_up_ms=move.key_up_ms,
            input=move.input,
            driver=move.driver,
        )


def revive(row: EpisodeRow, actions: bytes = b"", ended: bool = False) -> Episode:
    """Return the episode of a row after its actions; one that had ended without an ending move was abandoned."""
    record = Record(
        config=row.config,
        seed=row.seed,
        terrain=row.terrain,
        start=row.start,
        actions=actions,
        outcome="abandoned" if ended else "running",
        total=0.0,
        steps=0,
        discovered=0,
        trajectory_hash="",
    )
    return replay(record)


def resume(found: Resumable, store: Store, clock: Callable[[], int]) -> Session:
    """Return the session as it stood; ValueError when its actions do not fit the rules any more."""
    session = Session(found.session, store, clock)
    session.begin(found.episode, revive(found.episode, found.actions, found.ended))
    return session
