"""The writer of everything that is played: one row a step, committed when the call returns.

Every write is one IMMEDIATE transaction on one connection, called on the event loop's thread; a step costs about 70
microseconds. The loop never waits for another program's lock: a write that finds one fails at once and is tried again when the
lock is gone (`Store.writes`). `app.storage.database` opens the file, `app.storage.reader` reads what is finished, and
`app.storage.studies` writes the tables of studies in transactions of the same store.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import sqlite3
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from app.database_file.lock import take_lock
from app.database_file.place import FilePlace, LostDatabaseError
from app.database_file.write_queue import DatabaseLockedError, WriteQueue
from app.monitoring.metrics import Metrics
from app.storage import chain
from app.storage.database import StoreError, check_last_step, check_writable, holds_step, lost_steps, open_database, transaction
from app.storage.reader import Reader, config_of
from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.episode import Record
from marsexplorer.score import score

__all__ = ["Closing", "DailyDay", "EpisodeRow", "Resumable", "SessionRow", "StepRow", "Store", "StoreError"]

PaceMode = Literal["follow", "timed", "paused"]
Control = Literal["cookie", "bearer"]
"""What moves a session: the cookie of its player alone, or whoever knows its id."""

DAY_MS = 86_400_000


@dataclass(frozen=True)
class SessionRow:
    """A board and who drives it: `driver_name` is "human" or a policy's name."""

    id: str
    player_id: str | None
    driver_name: str
    rival_of: str | None
    pace_mode: PaceMode
    moves_per_second: float
    created_ms: int
    control: Control = "bearer"


@dataclass(frozen=True)
class DailyDay:
    """The daily terrain that an episode is an attempt at: its day and the commitment to its key."""

    day: str
    commitment: str


@dataclass(frozen=True)
class EpisodeRow:
    """What fixes an episode before its first move.

    driver  "human", "script" or "policy:NAME"
    daily   of a player's attempt at a daily terrain, else None
    """

    id: str
    session_id: str
    number: int
    config: EnvConfig
    seed: int | None
    seed_chosen: bool
    terrain: bytes
    start: tuple[int, int]
    policy_seed: int
    driver: str
    assisted: bool
    started_ms: int
    daily: DailyDay | None = None


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
    input: Literal["key", "touch"] | None
    driver: str


@dataclass(frozen=True)
class Resumable:
    """A session's latest episode as a restarted server finds it."""

    session: SessionRow
    episode: EpisodeRow
    actions: bytes
    ended: bool


class Closing(NamedTuple):
    """What closes an episode; `attestation` is its level, of a person's alone, and `reason` why it is not attested."""

    episode_id: str
    record: Record
    at_ms: int
    attestation: str | None = None
    reason: str | None = None


_ADD_SESSION = """INSERT INTO sessions VALUES
    (?1, ?2, coalesce(?2, (SELECT owner_id FROM sessions WHERE id = ?4)), ?3, ?4, ?5, ?6, ?7, ?8)"""
# The guard makes a lost or doubled step impossible: the next one, of an open episode, or nothing.
_ADD_STEP = """INSERT INTO steps SELECT ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11
    WHERE ?2 = (SELECT coalesce(max(step) + 1, 0) FROM steps WHERE episode_id = ?1)
    AND EXISTS (SELECT 1 FROM episodes WHERE id = ?1 AND ended_ms IS NULL)"""
_CLOSE = """UPDATE episodes SET ended_ms = ?2, outcome = ?3, steps = ?4, discovered = ?5, total = ?6, score = ?7,
    trajectory_hash = ?8, core_version = ?9, attestation = CASE WHEN driver = 'human' THEN ?10 END,
    attestation_reason = CASE WHEN driver = 'human' THEN ?11 END WHERE id = ?1 AND ended_ms IS NULL
    AND ?4 = (SELECT coalesce(max(step) + 1, 0) FROM steps WHERE episode_id = ?1)"""
_ADD_ATTEMPT = "INSERT INTO daily_attempts SELECT ?1, ?2, owner_id, ?3 FROM sessions WHERE id = ?4"
_MET = """SELECT EXISTS (SELECT 1 FROM episodes e JOIN sessions s ON s.id = e.session_id WHERE e.terrain_hash = ?
    AND s.owner_id = (SELECT owner_id FROM sessions WHERE id = ?))"""
_EPISODE = """e.*, (e.ended_ms IS NOT NULL) AS ended, d.day AS daily_day, d.commitment AS daily_commitment"""
_LATEST = f"""SELECT {_EPISODE} FROM sessions s
    JOIN episodes e ON e.session_id = s.id AND e.number = (SELECT max(number) FROM episodes WHERE session_id = s.id)
    LEFT JOIN daily_attempts d ON d.episode_id = e.id
    WHERE (e.ended_ms IS NULL OR max(s.created_ms, e.ended_ms) > :since OR s.id = :participants)"""


class Store(Reader):
    """The one writer of a database; `path` is its file, and `metrics` counts its commits and the moves of its sessions.

    accept_loss  open the database also when the log of a server that was killed is gone, with steps that were acknowledged
    notice       one sentence when the last step that was committed before a crash is not there, else None
    """

    def __init__(
        self, path: Path | str, durable: bool = False, metrics: Metrics | None = None, accept_loss: bool = False
    ) -> None:
        path, self.metrics = Path(path), metrics or Metrics()
        check_writable(path)
        self._lock = take_lock(path)
        try:
            expected = self._lock.expected_step()
            if not accept_loss:
                check_last_step(path, expected)
            super().__init__(open_database(path, durable), path)
        except BaseException:
            self._lock.close()
            raise
        try:
            self._lock.lock_database()  # of a file that was made just now
            self._place = FilePlace(path)
        except BaseException:
            self.close()
            raise
        self._lost: str | None = None
        self.writes = WriteQueue(self._is_locked)
        self._conn: sqlite3.Connection = self._db.conn
        self._step: tuple[str, int] | None = None
        self.notice = None if expected is None or holds_step(self._conn, expected) else lost_steps(path, expected)

    def close(self) -> None:
        """Write everything to disk and leave the file to another server."""
        ends_well = self.fault is None
        super().close()
        if ends_well:
            self._lock.clear_step()
        self._lock.close()

    @property
    def fault(self) -> str | None:
        """Return one sentence while nothing can be recorded, since the database is not where it was opened; else None."""
        return self._lost or self._place.fault()

    def check_place(self) -> None:
        """Raise LostDatabaseError while nothing can be recorded, since the database is not where it was opened."""
        if (fault := self.fault) is not None:
            raise LostDatabaseError(fault)

    def refuse_when_locked(self) -> None:
        """From now on raise DatabaseLockedError at once where another program holds the lock, instead of waiting for it."""
        self._conn.execute("PRAGMA busy_timeout = 0")

    def _is_locked(self) -> bool:
        """Return whether another program holds the lock for writing."""
        try:
            self._conn.execute("BEGIN IMMEDIATE")
        except sqlite3.OperationalError as error:
            return is_busy(error)  # the next write says what else is wrong
        self._conn.execute("ROLLBACK")
        return False

    @property
    def connection(self) -> sqlite3.Connection:
        """The one connection that writes, for the modules of this package; use it inside `transaction`."""
        return self._conn

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit what the block writes as a whole or not at all (StoreError); inside another transaction it is part of it.

        LostDatabaseError when the file is no longer where it was opened: what is not in reach is not acknowledged.
        DatabaseLockedError while another program holds the lock for writing.
        """
        if self._conn.in_transaction:
            yield
            return
        began, self._step = time.perf_counter(), None
        try:
            with transaction(self._conn):
                if self._lost is not None:
                    raise LostDatabaseError(self._lost)
                yield
                self._place.check()  # now the write can still be taken back
            self._lost = self._place.fault()  # it went in between: memory lacks what the lost file has, so no way leads on
            self.check_place()
            if self._step is not None:
                self._lock.note_step(*self._step)
            self.metrics.commit.observe(time.perf_counter() - began)
        except sqlite3.Error as error:
            if is_busy(error):
                raise DatabaseLockedError from error
            raise StoreError(f"the database {self.path} did not take the write, nothing changed: {error}") from error

    def secret(self) -> str:
        """Return the key that signs cookies: made once, kept in the database."""
        with self.transaction():
            self._conn.execute("INSERT OR IGNORE INTO meta VALUES ('secret', ?)", [secrets.token_urlsafe(32)])
        return str(self._conn.execute("SELECT value FROM meta WHERE name = 'secret'").fetchone()[0])

    def add_player(self, player_id: str, at_ms: int) -> None:
        """Add a player; a second time changes nothing."""
        with self.transaction():
            self._db.table("players").insert({"id": player_id, "created_ms": at_ms}, ignore=True)

    def add_session(self, row: SessionRow) -> None:
        """Add a session; a rival's session belongs to the player whose rival it is."""
        with self.transaction():
            self._conn.execute(
                _ADD_SESSION,
                (
                    row.id,
                    row.player_id,
                    row.driver_name,
                    row.rival_of,
                    row.pace_mode,
                    row.moves_per_second,
                    row.created_ms,
                    row.control,
                ),
            )

    def set_pace(self, session_id: str, mode: PaceMode, moves_per_second: float) -> None:
        """Store a session's pace for the next start of the server."""
        with self.transaction():
            self._conn.execute(
                "UPDATE sessions SET pace_mode = ?, moves_per_second = ? WHERE id = ?",
                (mode, moves_per_second, session_id),
            )

    def open_episode(self, row: EpisodeRow) -> None:
        """Open an episode, and note whether its player had met the terrain before."""
        self.next_episode((), (row,))

    def next_episode(self, closing: Sequence[Closing], rows: Sequence[EpisodeRow]) -> None:
        """Close the given episodes and open the next ones, all of it or nothing."""
        with self.transaction():
            for each in closing:
                self._close(Closing(*each))
            met = [self._has_met(row) for row in rows]
            for row, met_before in zip(rows, met, strict=True):
                self._open(row, met_before)

    def add_step(self, row: StepRow, closing: Record | None = None) -> None:
        """Commit a step, and close its episode when `closing` is its record.

        A step that did not come from a person's key or touch makes a human episode a script's for ever.
        """
        values = (
            row.episode_id, row.step, row.action, row.reward, row.discovered, row.server_ms,
            row.client_ms, row.key_down_ms, row.key_up_ms, row.input, row.driver,
        )  # fmt: skip
        with self.transaction():
            if self._conn.execute(_ADD_STEP, values).rowcount != 1:
                raise StoreError(f"step {row.step} is not the next of an open episode {row.episode_id!r}: nothing changed")
            self._step = row.episode_id, row.step
            if row.step == 0:
                chain.append_first_move(self._conn, row.episode_id)
            if row.driver != "human":
                self._conn.execute("UPDATE episodes SET driver = 'script' WHERE id = ? AND driver = 'human'", (row.episode_id,))
            if closing is not None:
                self._close(Closing(row.episode_id, closing, row.server_ms))

    def close_episode(
        self, episode_id: str, record: Record, at_ms: int, attestation: str | None = None, reason: str | None = None
    ) -> None:
        """Close an episode under its record's outcome, with the level of its attestation."""
        self.next_episode((Closing(episode_id, record, at_ms, attestation, reason),), ())

    def is_episode_of(self, session_id: str, episode_id: str) -> bool:
        """Return whether an episode is one of a session's."""
        sql = "SELECT 1 FROM episodes WHERE id = ? AND session_id = ?"
        return self._conn.execute(sql, (episode_id, session_id)).fetchone() is not None

    def sessions_to_resume(self, now_ms: int | None = None) -> list[Resumable]:
        """Return each session's latest episode when it is open, or when the session was alive within a day."""
        return [self._resumable(row) for row in self._latest("", {}, now_ms)]

    def resume_session(self, session_id: str, now_ms: int | None = None) -> Resumable | None:
        """Return what `sessions_to_resume` holds for one id, a participant's at any age; None when it holds nothing."""
        board = self._conn.execute("SELECT session_id FROM participants WHERE session_id = ?", [session_id]).fetchone()
        values = {"id": session_id, "participants": board and board[0]}
        found = self._latest(" AND s.id = :id", values, now_ms)
        return self._resumable(found[0]) if found else None

    def find_episode(self, episode_id: str) -> Resumable | None:
        """Return an episode as it stands now, open or ended, and its session; None when there is none."""
        sql = f"SELECT {_EPISODE} FROM episodes e LEFT JOIN daily_attempts d ON d.episode_id = e.id WHERE e.id = ?"
        return next((self._resumable(row) for row in list(self._db.query(sql, [episode_id]))), None)

    def _latest(self, extra: str, values: dict[str, Any], now_ms: int | None) -> list[dict[str, Any]]:
        now = int(time.time() * 1000) if now_ms is None else now_ms
        return list(self._db.query(_LATEST + extra, {"participants": None, **values, "since": now - DAY_MS}))

    def _resumable(self, row: dict[str, Any]) -> Resumable:
        session = dict(self._db.table("sessions").get(row["session_id"]))
        del session["owner_id"]
        kept = ("id", "session_id", "number", "seed", "terrain", "policy_seed", "driver", "started_ms")
        episode = EpisodeRow(
            config=config_of(row),
            start=(row["start_row"], row["start_col"]),
            seed_chosen=bool(row["seed_chosen"]),
            assisted=bool(row["assisted"]),
            daily=None if row["daily_day"] is None else DailyDay(row["daily_day"], row["daily_commitment"]),
            **{name: row[name] for name in kept},
        )
        actions = bytes(step["action"] for step in self.steps(row["id"]))
        return Resumable(SessionRow(**session), episode, actions, bool(row["ended"]))

    def _has_met(self, row: EpisodeRow) -> bool:
        return bool(self._conn.execute(_MET, (terrain_hash(row), row.session_id)).fetchone()[0])

    def _open(self, row: EpisodeRow, met_before: bool) -> None:
        config = json.dumps(row.config.to_dict(), sort_keys=True, separators=(",", ":"))
        self._db.table("episodes").insert(
            {
                **{name: getattr(row, name) for name in ("id", "session_id", "number", "seed", "terrain", "policy_seed")},
                **{name: getattr(row, name) for name in ("driver", "started_ms", "seed_chosen", "assisted")},
                "level": row.config.level,
                "config": config,
                "config_hash": row.config.hash,
                "terrain_hash": terrain_hash(row),
                "terrain_met_before": met_before,
                "start_row": row.start[0],
                "start_col": row.start[1],
                "core_version": CORE_VERSION,
            }
        )
        if row.daily is not None:
            self._conn.execute(_ADD_ATTEMPT, (row.id, row.daily.day, row.daily.commitment, row.session_id))

    def _close(self, closing: Closing) -> None:
        episode_id, record, at_ms, attestation, reason = closing
        totals = (
            record.outcome,
            record.steps,
            record.discovered,
            record.total,
            score(record.config, record.total, record.cells),
        )
        values = (episode_id, at_ms, *totals, record.trajectory_hash, record.core_version, attestation, reason)
        if self._conn.execute(_CLOSE, values).rowcount != 1:
            raise StoreError(f"episode {episode_id!r} is not open with {record.steps} steps: nothing changed")
        chain.append(self._conn, "episode", episode_id)


def is_busy(error: sqlite3.Error) -> bool:
    """Return whether an error of SQLite says that another connection holds the lock."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY


def terrain_hash(row: EpisodeRow) -> str:
    """Return SHA-256 (hex) of the shape and the packed bits: the same for two seeds that draw the same terrain."""
    return hashlib.sha256(f"{row.config.rows}x{row.config.cols}:".encode() + row.terrain).hexdigest()
