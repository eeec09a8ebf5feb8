"""The writer of everything that is played: a row a step, committed at once.

Every write is an IMMEDIATE transaction on one connection. In a server one thread owns it
(`Store.write`, `WriteQueue`). Reads are made on other threads over connections of
their own (`Store.read`), so that the event loop waits for neither a disk nor a lock. In a command or
a test the caller's thread does all of it, and a write is committed when the call returns.

`humanplay.db.database` opens the file, `humanplay.db.reader` reads what is finished, and
`humanplay.db.series` writes the tables of studies in transactions of the same store.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import sqlite3
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import astuple, dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

from humanplay.db import chain, volunteers
from humanplay.db.columns import TABLES
from humanplay.db.database import (
    BUSY_MS,
    COUNT_COMMIT,
    RUNS,
    SqlValue,
    StoreError,
    check_commits,
    check_writable,
    commits_in,
    open_database,
    open_read_only,
    transaction,
)
from humanplay.db.file import DatabaseLock, FilePlace, LostDatabaseError, WriteRefusedError
from humanplay.db.metrics import Metrics
from humanplay.db.read_threads import ReadThreads
from humanplay.db.reader import JOINED, TRIAL, Reader
from humanplay.db.rows import EpisodeRow, Input, MoveRow
from humanplay.db.trial import Trial
from humanplay.task import Record, counted
from humanplay.task.sentences import Sentence

if TYPE_CHECKING:
    from sqlite_utils import Database

__all__ = [
    "Closing",
    "SessionRow",
    "StepRow",
    "Store",
    "StoreError",
    "StoredEpisode",
    "Trial",
]

PaceMode = Literal["follow", "timed", "paused"]
Control = Literal["cookie", "bearer"]
"""What moves a session: the cookie of its player alone, or whoever knows its id."""

T = TypeVar("T")
Notice = Callable[[str], Awaitable[None]]

PATIENCE_S = 30.0
"""Seconds after which a write that has not begun is refused."""
NOTICE_S = 1.0
"""Seconds after which a waiting player is told why."""
MAX_WAITING = 1_000
"""Writes that wait at a time; further ones are refused at once."""
GATHER_S = 0.005
"""Seconds that a write may wait for another to share its commit, unless its commit is due."""
MOST_TOGETHER = 64
"""Writes that are committed together, at most."""
SHORTEST_PAUSE_S, LONGEST_PAUSE_S = 0.002, 0.05

WAITS = Sentence(
    "store.waits",
    "another program is writing the server's database: your move waits, and is made as soon as that program is done",
)
SLOW = Sentence(
    "store.slow",
    "the server's disk is slow to answer: your move waits, and is made as soon as it is recorded",
)
LOCKED = Sentence(
    "store.locked",
    "another program is writing the server's database and has not finished: nothing has changed; try again in a moment",
)
NOT_BEGUN = Sentence(
    "store.not_begun",
    "the server's disk has not answered for a while: nothing has changed; try again in a moment",
)
FULL = Sentence(
    "store.full",
    "more waits to be recorded than the server's disk takes: nothing has changed; try again in a moment",
)
ENDS = Sentence(
    "store.ends", "the server is about to stop: nothing has changed; try again in a moment"
)
BROKEN = Sentence(
    "store.broken",
    "the part of the server that records moves has failed: no move is made and nothing is recorded until the server is "
    "started anew; its log says what went wrong",
)
NOT_TAKEN = Sentence(
    "store.not_taken",
    "the database {database} did not take the write, nothing changed: {error}; try again in a moment",
)

_log = logging.getLogger(__name__)
DAY_MS = 86_400_000
READ_CACHE_KB = 256
"""Memory of each reading connection for pages of the database (SQLite's default: 2,000). A
connection drops them all after the next commit, and reads from the system's own cache what it had
no room for."""


@dataclass(frozen=True)
class SessionRow:
    """A board and who drives it.

    Attributes:
        driver_name: "human" or a policy's name.
        challenges: The finished episode that is played against here, if any.
    """

    id: str
    player_id: str | None
    driver_name: str
    rival_of: str | None
    pace_mode: PaceMode
    moves_per_second: float
    created_ms: int
    control: Control = "bearer"
    challenges: str | None = None


@dataclass(frozen=True)
class StepRow:
    """One move; `step` counts from 0, times are milliseconds."""

    episode_id: str
    step: int
    action: int
    reward: float
    discovered: int
    server_ms: int
    client_ms: float | None
    key_down_ms: float | None
    key_up_ms: float | None
    input: Input | None
    driver: str

    def row(self) -> MoveRow:
        """The row as a query gives it."""
        return {
            "episode_id": self.episode_id,
            "step": self.step,
            "action": self.action,
            "reward": self.reward,
            "discovered": self.discovered,
            "server_ms": self.server_ms,
            "client_ms": self.client_ms,
            "key_down_ms": self.key_down_ms,
            "key_up_ms": self.key_up_ms,
            "input": self.input,
            "driver": self.driver,
        }


@dataclass(frozen=True)
class StoredEpisode:
    """An episode with its session and its moves, as stored.

    A board can be resumed from it.

    Attributes:
        newest_ms: Time of its newest move or input event.
        batches: Ids of its batches of input events.
    """

    session: SessionRow
    episode: Trial
    actions: bytes
    newest_ms: int = 0
    batches: tuple[str, ...] = ()

    @property
    def ended(self) -> bool:
        """Whether the episode has ended."""
        return self.episode.ended_ms is not None


class Closing(NamedTuple):
    """What closes an episode.

    Attributes:
        attestation: Its level; None for a policy's.
        reason: Why it is not attested, if it is not.
        events: The hash of its input events as far as it was computed before, if it was.
    """

    episode_id: str
    record: Record
    at_ms: int
    attestation: str | None = None
    reason: str | None = None
    events: chain.BegunHash | None = None


_ADD_SESSION = """INSERT INTO sessions VALUES
    (?1, ?2, coalesce(?2, (SELECT owner_id FROM sessions WHERE id = ?4)), ?3, ?4, ?5, ?6, ?7, ?8, ?9)"""
_STEP = TABLES["steps"].names()
# No step is lost or doubled: only the next one of an open episode is added. A script's step is not added to an episode that
# is still a person's: it must become a script's first.
_ADD_STEP = f"""INSERT INTO steps ({", ".join(_STEP)}) SELECT ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11
    WHERE ?2 = (SELECT coalesce(max(step) + 1, 0) FROM steps WHERE episode_id = ?1)
    AND EXISTS (SELECT 1 FROM episodes WHERE id = ?1 AND ended_ms IS NULL AND (driver <> 'human' OR ?11 = 'human'))"""
_STEP_VALUES = attrgetter(*_STEP)
_BECOME_SCRIPT = "UPDATE episodes SET driver = 'script' WHERE id = ? AND driver = 'human'"
KEPT_BATCHES = 4
"""How many ids of batches of input events an ended episode keeps.

By them it recognises a batch that the page sends again.
"""
_FORGET_BATCHES = """DELETE FROM event_batches WHERE episode_id = ?1 AND first <
    (SELECT first FROM event_batches WHERE episode_id = ?1 ORDER BY first DESC LIMIT 1 OFFSET ?2)"""
_CLOSE = """UPDATE episodes SET ended_ms = ?2, outcome = ?3, steps = ?4, discovered = ?5, total = ?6, score = ?7,
    trajectory_hash = ?8, core_version = ?9, attestation = CASE WHEN driver = 'human' OR ?10 = 'spoilt' THEN ?10 END,
    attestation_reason = CASE WHEN driver = 'human' OR ?10 = 'spoilt' THEN ?11 END WHERE id = ?1 AND ended_ms IS NULL
    AND ?4 = (SELECT coalesce(max(step) + 1, 0) FROM steps WHERE episode_id = ?1)"""
_MET = """SELECT EXISTS (SELECT 1 FROM episodes e JOIN sessions s ON s.id = e.session_id WHERE e.terrain_hash = ?
    AND s.owner_id = (SELECT owner_id FROM sessions WHERE id = ?))"""
_LATEST = f"""SELECT {TRIAL} FROM sessions s
    JOIN episodes e ON e.session_id = s.id AND e.number = (SELECT max(number) FROM episodes WHERE session_id = s.id)
    LEFT JOIN series_episodes x ON x.episode_id = e.id
    WHERE s.id = ?1 AND (e.ended_ms IS NULL OR max(s.created_ms, e.ended_ms) > ?2
        OR EXISTS (SELECT 1 FROM participants p WHERE p.session_id = s.id))"""

_NEWEST_EVENT = (
    "SELECT server_ms FROM input_events WHERE episode_id = ? ORDER BY number DESC LIMIT 1"
)


class Store(Reader):
    """The one writer of a database.

    Attributes:
        path: The path of its file.
        metrics: Where its commits and the moves of its sessions are counted.
        missing: How many acknowledged commits the file lacks.

    Args:
        durable: Whether commits outlast a power cut, each at the cost of a wait for the disk.
        accept_loss: Open the database also if acknowledged commits are missing, or might be.
    """

    def __init__(
        self,
        path: Path | str,
        durable: bool = False,
        metrics: Metrics | None = None,
        accept_loss: bool = False,
    ) -> None:
        path, self.metrics = Path(path), metrics or Metrics()
        self._reads: ReadThreads[Database] | None = None
        check_writable(path)
        self._lock = DatabaseLock(path)
        try:
            self.missing = 0 if accept_loss else check_commits(path)
            # from here on new commits may be in the write-ahead log only, so the lock file's note
            # of their number is written first and cleared last
            self._lock.begin_note(commits_in(path)[0], durable)
            super().__init__(open_database(path, durable), path)
        except BaseException:
            self._lock.close()
            raise
        self._conn: sqlite3.Connection = self._db.conn
        self._lost: str | None = None
        self._takes_writes = True
        self._is_within, self._started_s = False, 0.0
        self._lost_error: StoreError | None = None
        self.writes = WriteQueue(self._commit, self._roll_back)
        try:
            self._lock.lock_database()  # of a file that was made just now
            self._place = FilePlace(path)
            self._note_running(True)
        except BaseException:
            self.close()
            raise

    def _note_running(self, is_running: bool) -> None:
        """Record in the file whether a server uses it."""
        sql = (
            "INSERT OR IGNORE INTO meta VALUES (?, '1')"
            if is_running
            else "DELETE FROM meta WHERE name = ?"
        )
        # on a full disk only the lock file's note says that a server uses the file
        with suppress(sqlite3.Error):
            with transaction(self._conn):
                self._conn.execute(sql, [RUNS])
                self._conn.execute(COUNT_COMMIT).fetchone()
            self._conn.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchall()

    def start_threads(self) -> None:
        """Write on one thread and read on others from now on; call it on the event loop."""
        self._conn.execute("PRAGMA busy_timeout = 0")  # the thread waits by itself, and says why
        self._reads = ReadThreads(self._open_for_reading)
        self.writes.start()

    def stop_threads(self) -> None:
        """Make the writes that wait, and end the threads.

        Call it in another thread than the event loop's, which still runs.
        """
        self.writes.stop()
        if self._reads is not None:
            self._reads.close()
            self._reads = None
            self._conn.execute(f"PRAGMA busy_timeout = {BUSY_MS}")

    def _open_for_reading(self) -> Database:
        db = open_read_only(self.path)
        db.conn.execute(f"PRAGMA cache_size = -{READ_CACHE_KB}")
        return db

    async def write(
        self,
        work: Callable[[], T],
        notice: Notice | None = None,
        then: Callable[[T], None] | None = None,
    ) -> T:
        """Call `work()` on the thread of the writes; its result comes after the commit.

        It may write, and sees everything written before it. It must not touch what belongs to the
        event loop.

        Args:
            notice, then: As for `WriteQueue.put`, whose errors are passed on.
        """
        return await self.writes.put(work, notice, then)

    async def change(self, work: Callable[..., T], *arguments: object) -> T:
        """Call `work(connection, *arguments)` in a transaction, as `write` does."""

        def write() -> T:
            with self.transaction():
                return work(self.connection, *arguments)

        return await self.write(write)

    def put_write(
        self, work: Callable[[], T], undone: Callable[[], None] | None = None
    ) -> asyncio.Future[T]:
        """Queue a write that may wait a moment for the next one, which follows it.

        Args:
            undone: As for `WriteQueue.put`.

        Returns:
            Its result to come.
        """
        return self.writes.put(work, undone=undone, commit_at_once=False)

    async def read(self, work: Callable[[], T]) -> T:
        """Call `work()`, which reads what is committed, without waiting for writes."""
        return work() if self._reads is None else await self._reads.run(work)

    def close(self) -> None:
        """Write everything to disk and leave the file to another server."""
        self.stop_threads()
        ends_well = self.fault is None
        if ends_well:
            self._note_running(False)
        super().close()
        if ends_well:
            self._lock.clear_note()
        self._lock.close()

    @property
    def _db(self) -> Database:
        """The connection for the caller's thread.

        While threads are started, only the thread of the writes has the one that writes.
        """
        if self._reads is None or self.writes.is_own_thread:
            return self._own_db
        return self._reads.connection()

    @_db.setter
    def _db(self, db: Database) -> None:
        self._own_db = db

    @property
    def fault(self) -> str | None:
        """One sentence while nothing can be recorded, else None.

        The database may not be where it was opened, for instance.
        """
        return self._lost or self._place.fault() or self.writes.fault

    def check_recording(self) -> None:
        """Raise StoreError while nothing can be recorded."""
        if (fault := self.fault) is not None:
            raise StoreError(fault)

    @property
    def connection(self) -> sqlite3.Connection:
        """The connection for this package; it writes inside `transaction` alone."""
        return self._db.conn

    @contextmanager
    def transaction(self, is_one_statement: bool = False) -> Iterator[None]:
        """Commit what the block writes as a whole or not at all.

        Inside another transaction it is part of it. On the thread of the writes it is committed
        together with those that wait; one that fails is taken back alone.

        Args:
            is_one_statement: The block executes one statement, which SQLite itself takes back if it
                fails.

        Raises:
            StoreError: If the database does not take it.
            LostDatabaseError: If the file is no longer where it was opened: what is out of reach is
                not acknowledged.
            WriteRefusedError: While another program holds the lock for writing.
        """
        if self.writes.is_started and not self.writes.is_own_thread:
            raise RuntimeError(
                "while a server runs, its store is written on one thread alone: await Store.write"
            )
        if self._is_within:
            yield
            return
        is_first = not self._conn.in_transaction
        has_savepoint = not is_first and not is_one_statement
        self._is_within = True
        try:
            self._begin(is_first, has_savepoint)
            try:
                yield
                if has_savepoint:
                    self._conn.execute("RELEASE part")
            except BaseException as error:
                self._take_back(is_first, has_savepoint, error)
                raise
        except sqlite3.Error as error:
            raise self._report_refused_write(error) from error
        finally:
            self._is_within = False
        if not self.writes.is_started:
            self._commit()

    def _begin(self, is_first: bool, has_savepoint: bool) -> None:
        """Begin a transaction, or a part of one.

        On the thread of the writes it waits for another program's lock.
        """
        if self._lost is not None:
            raise LostDatabaseError(self._lost)
        if not is_first:
            if has_savepoint:
                self._conn.execute("SAVEPOINT part")
            return
        while True:
            try:
                self._conn.execute("BEGIN IMMEDIATE")
                break
            except sqlite3.OperationalError as error:
                if not is_busy(error):
                    raise
                if not self.writes.is_started or not self.writes.wait_for_lock():
                    raise WriteRefusedError(LOCKED) from error
        self._started_s = time.perf_counter()

    def _take_back(self, is_first: bool, has_savepoint: bool, error: BaseException) -> None:
        """Take back what a transaction wrote, and nothing of those that wait for a commit."""
        if not self._conn.in_transaction:
            # SQLite has taken back the other transactions too, as it may on a full disk
            if not is_first:
                self._lost_error = self._report_refused_write(error)
        elif is_first:
            self._conn.execute("ROLLBACK")
        elif has_savepoint:
            self._conn.execute("ROLLBACK TO part")
            self._conn.execute("RELEASE part")

    def _commit(self) -> None:
        """Commit the transactions since the last call, or take them back.

        They are taken back if the file is no longer where it was opened.
        """
        lost_error, self._lost_error = self._lost_error, None
        if not self._conn.in_transaction and lost_error is None:
            return
        try:
            if lost_error is not None:
                raise lost_error
            # look before the commit, while the write can still be taken back
            self._place.check()
            (commits,) = self._conn.execute(COUNT_COMMIT).fetchone()
            self._conn.execute("COMMIT")
        except BaseException as error:
            self._roll_back()
            if isinstance(error, sqlite3.Error):
                raise self._report_refused_write(error) from error
            raise
        # the file went between look and commit: memory lacks what the lost file has, so nothing may follow
        self._lost = self._place.fault()
        if self._lost is not None:
            raise LostDatabaseError(self._lost)
        self._lock.note(commits)
        if not self._takes_writes:
            self._takes_writes = True
            _log.warning("the database %s takes writes again", self.path)
        self.metrics.commit.observe(time.perf_counter() - self._started_s)

    def _roll_back(self) -> None:
        if self._conn.in_transaction:
            self._conn.execute("ROLLBACK")

    def _report_refused_write(self, error: BaseException) -> StoreError:
        """Log that the database takes no writes, and return the error for the caller."""
        # one line when the trouble begins, and one in `_commit` when it ends
        if self._takes_writes:
            self._takes_writes = False
            _log.error(
                "the database %s takes no writes (%s): moves are refused until it does, and none is lost. Make room on its "
                "disk, or look for the disk's errors in the system's log (dmesg)",
                self.path,
                error,
            )
        return StoreError(NOT_TAKEN.format(database=self.path.name, error=str(error)))

    def secret(self) -> str:
        """The key that signs cookies; created once, stored in the database."""
        sql = "SELECT value FROM meta WHERE name = 'secret'"
        if self.connection.execute(sql).fetchone() is None:
            with self.transaction():
                insert = "INSERT OR IGNORE INTO meta VALUES ('secret', ?)"
                self._conn.execute(insert, [secrets.token_urlsafe(32)])
        return str(self.connection.execute(sql).fetchone()[0])

    def add_player(self, player_id: str, at_ms: int) -> None:
        """Add a player; a second time changes nothing."""
        with self.transaction():
            self._db.table("players").insert({"id": player_id, "created_ms": at_ms}, ignore=True)

    def add_session(self, row: SessionRow) -> None:
        """Add a session. A rival's belongs to the player whose rival it is."""
        with self.transaction():
            self._conn.execute(_ADD_SESSION, astuple(row))

    def set_pace(self, session_id: str, mode: PaceMode, moves_per_second: float) -> None:
        """Store a session's pace for the next start of the server."""
        with self.transaction():
            self._conn.execute(
                "UPDATE sessions SET pace_mode = ?, moves_per_second = ? WHERE id = ?",
                (mode, moves_per_second, session_id),
            )

    def note_failure(self, episode_id: str, report: str) -> None:
        """Store what the environment raised in an episode; call it in a transaction."""
        sql = "UPDATE episodes SET failure = ? WHERE id = ?"
        self._conn.execute(sql, [report, episode_id])

    def next_episode(self, closings: Sequence[Closing], rows: Sequence[Trial]) -> list[Trial]:
        """Close episodes and open the next ones, all of it or nothing.

        Returns:
            The opened ones as stored.
        """
        with self.transaction():
            for closing in closings:
                self._close(closing)
            opened = [replace(row, terrain_met_before=self._has_met(row)) for row in rows]
            for row in opened:
                self._db.table("episodes").insert(row.row())
        return opened

    def add_step(self, row: StepRow, record: Record | None = None) -> None:
        """Add a step, and close its episode if the step ends it.

        A person's episode becomes a script's for good with the first step that no key or touch of
        the person made.

        Args:
            record: The record of the episode that the step ends.
        """
        values = _STEP_VALUES(row)
        if row.step > 0 and record is None and self._add_step_alone(values):
            return
        # one statement was not enough: the step begins or ends its episode, is a script's first one
        # in a person's episode, or is not the next one
        with self.transaction():
            if row.driver != "human":
                self._conn.execute(_BECOME_SCRIPT, (row.episode_id,))
            if self._conn.execute(_ADD_STEP, values).rowcount != 1:
                raise StoreError(
                    f"step {row.step} is not the next of an open episode {row.episode_id!r}: nothing changed"
                )
            if row.step == 0:
                chain.append_first_move(self._conn, row.episode_id)
            if record is not None:
                self._close(Closing(row.episode_id, record, row.server_ms))

    def _add_step_alone(self, values: tuple[SqlValue, ...]) -> bool:
        """Add a step by one statement, as most can be; False if nothing was added."""
        with self.transaction(is_one_statement=True):
            if self._conn.execute(_ADD_STEP, values).rowcount != 1:
                return False
        return True

    def is_episode_of(self, session_id: str, episode_id: str) -> bool:
        """Whether an episode is one of a session's."""
        sql = "SELECT 1 FROM episodes WHERE id = ? AND session_id = ?"
        return self.connection.execute(sql, (episode_id, session_id)).fetchone() is not None

    def pauses(self, episode_id: str, least_ms: int, until_ms: int) -> tuple[int, float]:
        """The pauses of an episode: how many, and their sum in ms.

        A pause is a gap of at least `least_ms` between two moves, or from the last one to
        `until_ms`.
        """
        sql = """SELECT count(*) AS number, total(gap) AS ms FROM (SELECT coalesce(lead(server_ms)
            OVER (ORDER BY step), ?) - server_ms AS gap FROM steps WHERE episode_id = ?) WHERE gap >= ?"""
        (gaps,) = self.query(sql, [until_ms, episode_id, least_ms])
        return gaps["number"], gaps["ms"]

    def resume_session(self, session_id: str, now_ms: int | None = None) -> StoredEpisode | None:
        """A session's latest episode, or None if the session cannot be resumed.

        A session can be resumed while the episode is open and for a day after; a participant's at
        any age.
        """
        now = int(time.time() * 1000) if now_ms is None else now_ms
        rows = self.query(_LATEST, [session_id, now - DAY_MS])
        return self._stored_episode(rows[0]) if rows else None

    def player_session(self, session_id: str) -> str:
        """The session whose rival a session is; itself if it is no rival's."""
        sql = "SELECT rival_of FROM sessions WHERE id = ? AND rival_of IS NOT NULL"
        row = self.connection.execute(sql, [session_id]).fetchone()
        return session_id if row is None else str(row[0])

    def rival_of(self, session_id: str) -> str | None:
        """The session of a player's rival; None if there is none."""
        sql = "SELECT id FROM sessions WHERE rival_of = ?"
        row = self.connection.execute(sql, [session_id]).fetchone()
        return None if row is None else str(row[0])

    def find_episode(self, episode_id: str) -> StoredEpisode | None:
        """An episode as it stands now, open or ended, with its session; None if unknown."""
        sql = f"SELECT {TRIAL} FROM episodes e {JOINED} WHERE e.id = ?"
        rows = self.query(sql, [episode_id])
        return self._stored_episode(rows[0]) if rows else None

    def _stored_episode(self, row: EpisodeRow) -> StoredEpisode:
        (session,) = self.query("SELECT * FROM sessions WHERE id = ?", [row["session_id"]])
        del session["owner_id"]
        steps = self.steps(row["id"])
        newest = self.query(_NEWEST_EVENT, [row["id"]]) + steps[-1:]
        newest_ms = max((step["server_ms"] for step in newest), default=0)
        actions = bytes(step["action"] for step in steps)
        sql = "SELECT batch FROM event_batches WHERE episode_id = ?"
        batches = tuple(batch["batch"] for batch in self.query(sql, [row["id"]]))
        return StoredEpisode(SessionRow(**session), Trial.of(row), actions, newest_ms, batches)

    def _has_met(self, row: Trial) -> bool:
        return bool(self._conn.execute(_MET, (row.terrain_hash, row.session_id)).fetchone()[0])

    def _close(self, closing: Closing) -> None:
        episode_id, record, at_ms, attestation, reason, events = closing
        values = (
            episode_id, at_ms, record.outcome, record.steps, record.discovered, record.total, record.score,
            record.trajectory_hash, record.core_version, attestation, reason,
        )  # fmt: skip
        if self._conn.execute(_CLOSE, values).rowcount != 1:
            raise StoreError(
                f"episode {episode_id!r} is not open with {counted(record.steps, 'step')}: nothing changed"
            )
        forget_batches(self._conn, episode_id)
        volunteers.add_episode(self._conn, episode_id)
        chain.append(self._conn, "episode", episode_id, begun=events)


def forget_batches(conn: sqlite3.Connection, episode_id: str) -> None:
    """Delete the ids of an ended episode's event batches, but for the newest."""
    conn.execute(_FORGET_BATCHES, [episode_id, KEPT_BATCHES - 1])


def is_busy(error: sqlite3.Error) -> bool:
    """Whether an error of SQLite says that another connection holds the lock."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY


@dataclass(eq=False, slots=True)
class _Write:
    """A write that waits.

    Attributes:
        work: Makes it.
        then, undone: Follow its commit, or a commit that failed.
        done: Its result or error, for whoever waits.
        deadline: Monotonic seconds after which it is refused instead of made.
    """

    work: Callable[[], object]
    then: Callable[[Any], None] | None
    undone: Callable[[], None] | None
    done: asyncio.Future[Any]
    notice: Notice | None
    deadline: float
    claim: threading.Lock = field(default_factory=threading.Lock)
    """Decides once: the thread acquires it to make the write, or the event loop to refuse it."""
    result: object = None
    error: BaseException | None = None


class WriteQueue:
    """Makes writes on a thread that waits for locks and slow disks.

    Until the thread is started, the caller makes each write at once.

    Attributes:
        fault: One sentence when the thread has ended by an error, so that nothing can be recorded;
            else None.

    Args:
        commit: Commits what the writes since the last call wrote.
        roll_back: Takes it back.
    """

    def __init__(self, commit: Callable[[], None], roll_back: Callable[[], None]) -> None:
        self._commit, self._roll_back = commit, roll_back
        self._gathered: list[_Write] = []
        self._is_due = False
        self._unanswered: deque[_Write] = deque()
        self._timer: asyncio.TimerHandle | None = None
        self._queue: SimpleQueue[list[_Write] | None] = SimpleQueue()
        self._waiting = 0
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop
        self._is_ending = False
        self._deadline, self._pause_s, self._is_locked = 0.0, SHORTEST_PAUSE_S, False
        self._notices: set[asyncio.Task[None]] = set()
        self.fault: str | None = None

    def __len__(self) -> int:
        """How many writes wait."""
        return self._waiting

    @property
    def is_started(self) -> bool:
        """Whether the thread makes the writes, and nobody else may."""
        return self._thread is not None

    @property
    def is_own_thread(self) -> bool:
        """Whether the caller is the thread of the writes."""
        return self._thread is not None and threading.get_ident() == self._thread.ident

    def start(self) -> None:
        """Let a thread make the writes from now on; call it on the running event loop."""
        self._loop, self._is_ending, self._timer = asyncio.get_running_loop(), False, None
        self._thread = threading.Thread(target=self._run_thread, name="writes", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Make the writes that wait, then end the thread.

        Call it in another thread, while the event loop runs.
        """
        if self._thread is not None:
            try:
                self._loop.call_soon_threadsafe(self._end)
            except RuntimeError:  # the event loop has ended
                self._end()
            self._thread.join()
            self._thread = None

    def put(
        self,
        work: Callable[[], T],
        notice: Notice | None = None,
        then: Callable[[T], None] | None = None,
        commit_at_once: bool = True,
        undone: Callable[[], None] | None = None,
    ) -> asyncio.Future[T]:
        """Queue a write; the result of `work()` comes after its commit.

        Args:
            work: Called on the thread of the writes.
            notice: Called with one sentence when the wait has lasted NOTICE_S.
            then: Called with the result on the event loop, right after the commit, also if the
                waiting task was cancelled.
            commit_at_once: Whether the commit is due now; else it may wait for another write, for
                GATHER_S at most.
            undone: Called if its commit failed, on the thread of the writes, before any further
                write.

        Raises:
            WriteRefusedError: After PATIENCE_S if the write has not begun, or at once while
                MAX_WAITING writes wait.
            StoreError: If the commit failed.
            Exception: What `work` raised.
        """
        if self._thread is None:
            done = asyncio.get_running_loop().create_future()
            done.set_result(work())
            if then is not None:
                then(done.result())
            return done
        if self.fault is not None:
            raise StoreError(self.fault)
        if self._is_ending or self._waiting >= MAX_WAITING:
            raise WriteRefusedError(ENDS if self._is_ending else FULL)
        loop = self._loop
        write = _Write(work, then, undone, loop.create_future(), notice, loop.time() + PATIENCE_S)
        self._waiting += 1
        self._unanswered.append(write)
        if self._timer is None:
            self._set_timer()
        self._gathered.append(write)
        if commit_at_once and not self._is_due:
            self._is_due = True
            loop.call_soon(self._hand_over)
        elif len(self._gathered) == 1:
            loop.call_later(GATHER_S, self._hand_over)
        return write.done

    def wait_for_lock(self) -> bool:
        """Wait a moment for another program's lock.

        Only `work` calls it, on the thread of the writes.

        Returns:
            False if the write that is being made has waited long enough.
        """
        if self._is_ending or time.monotonic() >= self._deadline:
            return False
        self._is_locked = True
        time.sleep(self._pause_s)
        self._pause_s = min(2 * self._pause_s, LONGEST_PAUSE_S)
        return True

    def _hand_over(self) -> None:
        """Hand the writes of one turn of the event loop to the thread, together.

        Waking the thread costs more than a write.
        """
        self._is_due = False
        if self._gathered:
            self._queue.put(self._gathered)
            self._gathered = []

    def _end(self) -> None:
        """Take no further write, and let the thread end after those that were gathered.

        Between two turns of the event loop nobody else gathers.
        """
        self._is_ending = True
        self._hand_over()
        self._queue.put(None)

    def _run_thread(self) -> None:
        """Make writes and commit them together, on the thread of the writes, until `stop`."""
        waiting, batch, is_last = deque[_Write](), list[_Write](), False
        try:
            while waiting or not is_last:
                if not waiting:
                    is_last = self._receive(waiting)
                    continue
                while waiting and len(batch) < MOST_TOGETHER:
                    batch.append(waiting.popleft())
                    self._run_write(batch[-1])
                    if not waiting and not is_last and not self._queue.empty():
                        is_last = self._receive(
                            waiting
                        )  # they came meanwhile, and share the commit
                self._commit_all(batch)
                self._post_to_loop(self._answer, batch)
                batch = []
        except BaseException:
            _log.exception("the thread that makes the writes has failed")
            self.fault = BROKEN
            with suppress(Exception):
                self._roll_back()
            self._post_to_loop(self._fail, [*batch, *waiting])

    def _receive(self, waiting: deque[_Write]) -> bool:
        """Wait for the writes of one turn of the event loop.

        Returns:
            Whether nothing comes after them.
        """
        writes = self._queue.get()
        waiting.extend(writes or ())
        return writes is None

    def _run_write(self, write: _Write) -> None:
        """Make a write, unless the event loop has refused it; it is not committed yet."""
        if not write.claim.acquire(blocking=False):
            return
        self._deadline, self._pause_s = write.deadline, SHORTEST_PAUSE_S
        try:
            if time.monotonic() >= write.deadline:
                raise WriteRefusedError(LOCKED if self._is_locked else NOT_BEGUN)
            write.result = write.work()
        except Exception as error:
            write.error = error

    def _commit_all(self, batch: Sequence[_Write]) -> None:
        """Commit a batch; if that fails, every write of it has failed."""
        try:
            self._commit()
        except Exception as error:
            for write in batch:
                if write.error is None and write.undone is not None:
                    write.undone()
                write.error = write.error or error
        self._is_locked = False  # the next write looks for itself

    def _post_to_loop(
        self, on_loop: Callable[[Sequence[_Write]], None], batch: Sequence[_Write]
    ) -> None:
        """Call a function with a batch on the event loop."""
        with suppress(RuntimeError):  # the event loop has ended, and nobody waits any more
            self._loop.call_soon_threadsafe(on_loop, batch)

    def _answer(self, batch: Sequence[_Write]) -> None:
        """Hand each write's result or error to whoever waits for it."""
        for write in batch:
            self._waiting -= 1
            if write.error is None and write.then is not None and not _is_refused(write):
                try:
                    write.then(write.result)
                except Exception as error:
                    _log.exception("what follows a write has failed")
                    write.error = error
            if write.done.done():
                continue
            if write.error is None:
                write.done.set_result(write.result)
            else:
                write.done.set_exception(write.error)
        self._drop_answered()

    def _drop_answered(self) -> None:
        """Forget the oldest writes as far as they are answered.

        Answers come in order, so mostly none are left.
        """
        while self._unanswered and self._unanswered[0].done.done():
            self._unanswered.popleft()

    def _fail(self, batch: Sequence[_Write]) -> None:
        """Fail a batch and all writes that wait, since the thread has ended."""
        self._hand_over()
        waiting = list(batch)
        while not self._queue.empty():
            waiting += self._queue.get() or ()
        for write in waiting:
            write.error = StoreError(BROKEN)
        self._answer(waiting)

    def _set_timer(self) -> None:
        """Look at the oldest waiting write when it has waited for NOTICE_S.

        One timer serves all writes.
        """
        due = self._unanswered[0].deadline - PATIENCE_S + NOTICE_S
        self._timer = self._loop.call_at(due, self._look_at_waiting)

    def _look_at_waiting(self) -> None:
        self._timer = None
        self._drop_answered()
        late = self._loop.time() + PATIENCE_S - NOTICE_S
        while self._unanswered and self._unanswered[0].deadline <= late:
            self._notify_late(self._unanswered.popleft())
            self._drop_answered()
        if self._unanswered:
            self._set_timer()

    def _notify_late(self, write: _Write) -> None:
        """Say why a write waits, and refuse it if it does not begin in time."""
        self._loop.call_later(PATIENCE_S - NOTICE_S, self._refuse, write)
        if write.notice is not None:
            task = self._loop.create_task(_send(write.notice, WAITS if self._is_locked else SLOW))
            self._notices.add(task)
            task.add_done_callback(self._notices.discard)

    def _refuse(self, write: _Write) -> None:
        if not write.done.done() and write.claim.acquire(blocking=False):
            write.done.set_exception(WriteRefusedError(LOCKED if self._is_locked else NOT_BEGUN))


def _is_refused(write: _Write) -> bool:
    return write.done.done() and not write.done.cancelled() and write.done.exception() is not None


async def _send(notice: Notice, text: str) -> None:
    await notice(text)
