"""Every finished episode of a database simulated again, every digest made again: whatever differs, by name.

That proves the file consistent: what it says happened is what its causes give. It cannot prove who made it; the signature
of a release does that for whoever knows the key.
"""

from __future__ import annotations

import itertools
import multiprocessing
import signal
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from app.release.study_checks import check_studies
from app.storage import digests
from app.storage.connection import reading, rows
from app.storage.resimulation import Finding, differences
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.play import cores, one_thread

PARALLEL_FROM = 4_000
"""Episodes from which further processes are worth their start."""

CHUNK = 200
Advance = Callable[[int, int], None]


@dataclass(frozen=True)
class Verified:
    """What a verification came to.

    episodes, moves   simulated
    still_open        unfinished episodes, not simulated
    findings          what differs; empty when all is well
    """

    episodes: int
    moves: int
    still_open: int
    findings: tuple[Finding, ...]
    seconds: float

    @property
    def failed(self) -> int:
        """How many episodes, participants, studies or files have a finding."""
        return len({finding.where for finding in self.findings})


def verify_database(
    path: Path,
    advance: Advance = lambda done, total: None,
    secrets: Mapping[str, bytes] | None = None,
    study: str | None = None,
) -> Verified:
    """Return what a database's verification came to; StoreError when it is not one of ours.

    advance   called with (episodes simulated, of how many)
    secrets   of studies that are still open, where they are known; closed ones hold theirs
    study     only this study's episodes and participants
    """
    with reading(path) as conn:
        return verify_moment(conn, path, advance, secrets, study)


def verify_moment(
    conn: sqlite3.Connection,
    path: Path,
    advance: Advance = lambda done, total: None,
    secrets: Mapping[str, bytes] | None = None,
    study: str | None = None,
) -> Verified:
    """Return what the verification of a database came to, as the connection sees it; see `verify_database`."""
    Episode.begin(EnvConfig.of("random", 5), seed=0).step(0)  # compiles the rules, which is no part of the rate
    began = time.monotonic()
    findings: list[Finding] = []
    moves = done = 0
    named = _idents(conn, study)
    for checked, made, found in _check_all(path, conn, named):
        moves += made
        done += checked
        findings += found
        advance(done, len(named))
    findings += _check_events(conn, study)
    findings += check_studies(conn, secrets or {}, study)
    findings += _check_participants(conn, study)
    if study is None:
        findings += _orphans(conn)
    (still_open,) = conn.execute(f"SELECT count(*) FROM episodes WHERE ended_ms IS NULL{_within(study)}").fetchone()
    return Verified(len(named), moves, still_open, tuple(findings), time.monotonic() - began)


def _check_all(path: Path, conn: sqlite3.Connection, named: Sequence[str]) -> Iterator[tuple[int, int, list[Finding]]]:
    """Yield (episodes, moves, findings) bit by bit, from several processes where there is enough to do.

    Each process reads for itself: a finished episode does not change, and one that was changed is what is looked for.
    """
    if len(named) < PARALLEL_FROM or cores() == 1:
        for ident in named:
            yield (1, *check_episode(conn, ident))
        return
    chunks = [tuple(named[at : at + CHUNK]) for at in range(0, len(named), CHUNK)]
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(cores(), len(chunks)), spawn, _as_helper) as pool:
        try:
            yield from pool.map(_check_chunk, itertools.repeat(path), chunks)
        finally:
            pool.shutdown(cancel_futures=True)


def _as_helper() -> None:
    """Leave Ctrl-C to the process that asked, which ends this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    one_thread()


def _check_chunk(path: Path, named: Sequence[str]) -> tuple[int, int, list[Finding]]:
    moves, findings = 0, []
    with reading(path) as conn:
        for ident in named:
            made, found = check_episode(conn, ident)
            moves += made
            findings += found
    return len(named), moves, findings


def check_episode(conn: sqlite3.Connection, ident: str) -> tuple[int, list[Finding]]:
    """Return the moves of a finished episode and what is wrong with it."""
    row = rows(conn, "SELECT * FROM episodes WHERE id = ?", ident)[0]
    steps = rows(conn, "SELECT * FROM steps WHERE episode_id = ? ORDER BY step", ident)
    return len(steps), [*differences(row, steps), *_compare(conn, "episode", ident, digests.of_rows(conn, "episode", ident))]


def _within(study: str | None, column: str = "id") -> str:
    """Return SQL that keeps a study's episodes; the name has been looked up, it cannot be anything else."""
    if study is None:
        return ""
    inner = "SELECT s.episode_id FROM study_episodes s JOIN participants p ON p.id = s.participant_id"
    return f" AND {column} IN ({inner} WHERE p.study = '{study.replace(chr(39), chr(39) * 2)}')"


def _idents(conn: sqlite3.Connection, study: str | None) -> list[str]:
    sql = f"SELECT id FROM episodes WHERE ended_ms IS NOT NULL{_within(study)} ORDER BY started_ms, id"
    return [str(row[0]) for row in conn.execute(sql)]


def _compare(conn: sqlite3.Connection, kind: digests.Kind, ident: str, found: str) -> Iterator[Finding]:
    stored = digests.kept(conn, kind, ident)
    if stored != found:
        where = f"{'participant' if kind == 'participant' else 'episode'} {ident}"
        what = "digest of its input events" if kind == "events" else "digest of its stored fields"
        yield Finding(where, what, stored or "missing", found)


def _check_events(conn: sqlite3.Connection, study: str | None) -> Iterator[Finding]:
    for (ident,) in conn.execute(
        f"SELECT DISTINCT episode_id FROM input_events WHERE 1{_within(study, 'episode_id')}"
    ).fetchall():
        yield from _compare(conn, "events", ident, digests.of_events(conn, ident))


def _check_participants(conn: sqlite3.Connection, study: str | None) -> Iterator[Finding]:
    for (ident,) in conn.execute("SELECT id FROM participants WHERE ? IS NULL OR study = ?", (study, study)).fetchall():
        yield from _compare(conn, "participant", ident, digests.of_rows(conn, "participant", ident))


_OWNERS = {
    "episode": "SELECT id FROM episodes WHERE ended_ms IS NOT NULL",
    "events": "SELECT episode_id FROM input_events",
    "participant": "SELECT id FROM participants",
}
_LOOSE = {
    "steps": "episode_id NOT IN (SELECT id FROM episodes)",
    "input_events": "episode_id NOT IN (SELECT id FROM episodes)",
    "study_episodes": "episode_id NOT IN (SELECT id FROM episodes) OR participant_id NOT IN (SELECT id FROM participants)",
    "stage_events": "participant_id NOT IN (SELECT id FROM participants)",
}


def _orphans(conn: sqlite3.Connection) -> Iterator[Finding]:
    """Return digests of what is no longer there, and rows that belong to nothing."""
    for kind, owners in _OWNERS.items():
        sql = f"SELECT id FROM digests WHERE kind = ? AND id NOT IN ({owners})"
        for (ident,) in conn.execute(sql, [kind]).fetchall():
            where = f"{'participant' if kind == 'participant' else 'episode'} {ident}"
            yield Finding(where, f"a digest of kind {kind}", "kept", "nothing it belongs to (deleted or opened again)")
    for table, loose in _LOOSE.items():
        for (count,) in conn.execute(f"SELECT count(*) FROM {table} WHERE {loose}").fetchall():
            if count:
                yield Finding(f"table {table}", "rows", count, "no episode or participant that they belong to")
