"""Every finished episode of a database simulated again, every entry of its chain made again: whatever differs, by name.

That proves the file consistent: what it says happened is what its causes give. It cannot prove who made it; the signature
of a release does that for whoever knows the key.
"""

from __future__ import annotations

import itertools
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from app.jobs import Jobs, cores
from app.play.daily_terrain import check_daily
from app.storage import checks
from app.storage.checks import ChainState, EarlierHead, chain_state, check_chain, find_head
from app.storage.database import reading
from app.storage.resimulation import Finding
from app.study.checks import check_attestation, check_studies
from app.study.folder import Advance, Folder
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode

PARALLEL_FROM = 4_000
"""The number of episodes from which several processes are faster than one."""

EPISODES_PER_TASK = 200


@dataclass(frozen=True)
class Verification:
    """What a verification came to.

    episodes, moves   simulated
    still_open        unfinished episodes, not simulated
    findings          what differs; empty when all is well
    chain             what the chain is; None where none was read
    since             what came after an earlier head, where one was given and found
    """

    episodes: int
    moves: int
    still_open: int
    findings: tuple[Finding, ...]
    seconds: float
    chain: ChainState | None = None
    since: EarlierHead | None = None

    @property
    def failed(self) -> int:
        """How many episodes, participants, studies or files have a finding."""
        return len({finding.where for finding in self.findings})


def verify_database(
    path: Path,
    advance: Advance = lambda done, total: None,
    secrets: Mapping[str, bytes] | None = None,
    study: str | None = None,
    head: str | None = None,
) -> Verification:
    """Verify a database; StoreError when it is not one of ours.

    advance   called with (episodes simulated, of how many)
    secrets   of studies that are still open, where they are known; closed ones hold theirs
    study     only this study's episodes and participants
    head      an earlier head that must be in the chain (hex)
    """
    with reading(path) as conn:
        result = verify_moment(conn, path, advance, secrets, study)
        since = None if head is None else find_head(conn, head)
    if head is not None and since is None:
        lost = Finding(
            "chain",
            "the head given",
            head,
            "no entry with it: taken away, made anew, or of another database",
        )
        return replace(result, findings=(*result.findings, lost))
    return replace(result, since=since)


def verify_moment(
    conn: sqlite3.Connection,
    path: Path,
    advance: Advance = lambda done, total: None,
    secrets: Mapping[str, bytes] | None = None,
    study: str | None = None,
) -> Verification:
    """Verify a database as the connection sees it; the other parameters are those of `verify_database`."""
    Episode.begin(EnvConfig.of("random", 5), seed=0).step(
        0
    )  # compiles the rules, which is no part of the rate
    began = time.monotonic()
    findings: list[Finding] = []
    moves = done = 0
    episodes = checks.finished_episodes(conn, study)
    for checked, made, found in _check_episodes(path, conn, episodes):
        moves += made
        done += checked
        findings += found
        advance(done, len(episodes))
    findings += checks.check_entries(conn, study)
    findings += check_studies(conn, secrets or {}, study)
    findings += check_chain(conn)
    if study is None:
        findings += [*checks.check_owners(conn), *check_daily(conn)]
    still_open = checks.count_unfinished(conn, study)
    seconds = time.monotonic() - began
    return Verification(
        len(episodes), moves, still_open, tuple(findings), seconds, chain_state(conn)
    )


def check_policy_files(folder: Folder, names: Iterable[str]) -> Iterator[Finding]:
    """Yield what is wrong with the kept files of some frozen studies' policies; earlier versions kept none."""
    for study in map(folder.study, names):
        if study.protocol.policy_hashes:
            for path, found, recorded in study.policy_files.damaged():
                yield Finding(
                    f"file {path}",
                    "sha256",
                    f"{recorded} when the study was frozen",
                    found or "no such file",
                )


def _check_episodes(
    path: Path, conn: sqlite3.Connection, episodes: Sequence[str]
) -> Iterator[tuple[int, int, list[Finding]]]:
    """Yield (episodes, moves, findings) part by part, from several processes where there are many episodes.

    Each process reads for itself: a finished episode does not change, and one that was changed is what is looked for.
    """
    if len(episodes) < PARALLEL_FROM or cores() == 1:
        for ident in episodes:
            yield (1, *_check_episode(conn, ident))
        return
    tasks = [
        tuple(episodes[at : at + EPISODES_PER_TASK])
        for at in range(0, len(episodes), EPISODES_PER_TASK)
    ]
    with Jobs(min(cores(), len(tasks))) as jobs:
        yield from jobs.map(_run_task, itertools.repeat(path), tasks)


def _check_episode(conn: sqlite3.Connection, ident: str) -> tuple[int, list[Finding]]:
    """Return the moves of a finished episode and what is wrong with it."""
    row, steps, findings = checks.check_episode(conn, ident)
    return len(steps), [*findings, *check_attestation(conn, row, steps)]


def _run_task(path: Path, episodes: Sequence[str]) -> tuple[int, int, list[Finding]]:
    moves, findings = 0, []
    with reading(path) as conn:
        for ident in episodes:
            made, found = _check_episode(conn, ident)
            moves += made
            findings += found
    return len(episodes), moves, findings
