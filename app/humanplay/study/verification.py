"""Every finished episode of a database simulated again, every entry of its chain made again: whatever differs, by name.

That proves the file consistent: what it says happened is what its causes give. It cannot prove who made it; the signature
of a release does that for whoever knows the key.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import sqlite3
import time
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from humanplay.board.attestation import COPIED, Conditions, attest, key_map_of
from humanplay.board.controls import controls_of
from humanplay.db import checks, volunteers
from humanplay.db.checks import (
    ChainState,
    CheckedEpisode,
    EarlierHead,
    InputOf,
    answers_of,
    attempts_at,
    chain_state,
    check_chain,
    episodes_of,
    event_details,
    find_head,
    input_of,
    kind_of,
    participants_of,
    series,
    stages_of,
)
from humanplay.db.database import reading
from humanplay.db.resimulation import Finding
from humanplay.db.rows import PlacedEpisode
from humanplay.db.study_rows import ARM_EVENT, BLOCK_EVENT, ORDER_EVENT, SeriesRow
from humanplay.jobs import Jobs, cores
from humanplay.study import seeds
from humanplay.study.arms import stage_of_assignment
from humanplay.study.days import START_SLACK_MS, DailyTerrain
from humanplay.study.folder import Advance, Folder
from humanplay.study.protocol import Protocol, StudyError, canonical_json, parse_protocol
from humanplay.study.questions import missed_in
from humanplay.task.registration import environment_of

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
        gone = "no entry with it: taken away, made anew, or of another database"
        lost = Finding("chain", "the head given", head, gone)
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
    for task in checks.tasks(conn):
        with suppress(ValueError):  # found with the episodes that name it
            environment_of(task).prepare()  # which is no part of the rate
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
    findings += check_series(conn, secrets or {}, study)
    findings += check_chain(conn)
    findings += checks.check_marks(conn)
    if study is None:
        findings += checks.check_owners(conn)
        findings += volunteers.differences(conn)
    # another version is no tampering: whether a row was changed is said before that
    findings.sort(key=lambda each: each.what == "core_version")
    still_open = checks.count_unfinished(conn, study)
    seconds = time.monotonic() - began
    state = chain_state(conn)
    return Verification(len(episodes), moves, still_open, tuple(findings), seconds, state)


def check_policy_files(folder: Folder, names: Iterable[str]) -> Iterator[Finding]:
    """Yield what is wrong with the kept files of some frozen studies' policies."""
    for study in map(folder.study, names):
        if study.protocol.policy_hashes:
            for path, found, recorded in study.policy_files.damaged():
                wanted = f"{recorded} when the study was frozen"
                yield Finding(f"file {path}", "sha256", wanted, found or "no such file")


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
    each = EPISODES_PER_TASK
    tasks = [tuple(episodes[at : at + each]) for at in range(0, len(episodes), each)]
    with Jobs(min(cores(), len(tasks))) as jobs:
        yield from jobs.map(_run_task, itertools.repeat(path), tasks)


def _check_episode(conn: sqlite3.Connection, ident: str) -> tuple[int, list[Finding]]:
    """Return the moves of a finished episode and what is wrong with it."""
    episode = checks.check_episode(conn, ident)
    return len(episode.steps), [*episode.findings, *check_attestation(conn, episode)]


def _run_task(path: Path, episodes: Sequence[str]) -> tuple[int, int, list[Finding]]:
    moves, findings = 0, []
    with reading(path) as conn:
        for ident in episodes:
            made, found = _check_episode(conn, ident)
            moves += made
            findings += found
    return len(episodes), moves, findings


Level = tuple[str | None, str | None]
"""The level of an episode's attestation, and the reason why it is not attested."""


@dataclass(frozen=True)
class _Expected:
    """What the episodes of a series are checked against; `key`, which the seeds follow from, is None where it is not known."""

    series: SeriesRow
    config_hash: str
    key: bytes | None


def check_series(
    conn: sqlite3.Connection, secrets: Mapping[str, bytes], only: str | None = None
) -> Iterator[Finding]:
    """Yield what is wrong with the studies and daily terrains of a database, and with what people were given to play.

    secrets  of open studies, where they are known
    """
    for row in series(conn, only):
        yield from _check_series(conn, row, secrets)


def _check_series(
    conn: sqlite3.Connection, row: SeriesRow, secrets: Mapping[str, bytes]
) -> Iterator[Finding]:
    where = f"{row.kind} {row.name}"
    try:
        data = json.loads(row.protocol)
        found = hashlib.sha256(canonical_json(data)).hexdigest()
        of = parse_protocol(data) if row.kind == "study" else DailyTerrain.of(row)
        config = of.env_config if isinstance(of, Protocol) else of.config
        secret = _secret(row, secrets)
    except (ValueError, TypeError, KeyError, StudyError) as error:
        yield Finding(where, "protocol or secret", "something unreadable", str(error))
        return
    if found != row.protocol_hash:
        yield Finding(where, "protocol_hash", row.protocol_hash, found)
    if secret is not None and (bound := seeds.commitment(secret)) != row.commitment:
        of_folder = (
            ""
            if row.secret
            else " in the folder beside the database, which may be another server's"
        )
        yield Finding(where, "commitment", row.commitment, f"{bound} from the secret{of_folder}")
    expected = _Expected(row, config.hash, secret)
    if isinstance(of, Protocol):
        yield from _check_participants(conn, of, expected)
    else:
        yield from _check_attempts(conn, of, expected)


def _secret(row: SeriesRow, secrets: Mapping[str, bytes]) -> bytes | None:
    return bytes.fromhex(row.secret) if row.secret else secrets.get(row.name)


def _check_participants(
    conn: sqlite3.Connection, protocol: Protocol, expected: _Expected
) -> Iterator[Finding]:
    """Yield what is wrong with a study's participants: when they joined, and their episodes."""
    frozen_ms = expected.series.frozen_ms
    for participant, joined_ms in participants_of(conn, expected.series.name):
        if joined_ms < frozen_ms:
            wanted = f"{frozen_ms} or later, when the study was frozen"
            yield Finding(f"participant {participant}", "time of joining", joined_ms, wanted)
        episodes = episodes_of(conn, participant)
        arm = yield from _arm(conn, participant, protocol, expected)
        order = yield from _ranked_order(conn, participant, episodes, protocol, expected, arm)
        yield from _check_order(participant, episodes, protocol, order)
        yield from _check_stage(conn, participant, episodes, protocol)
        yield from _check_missed(conn, participant, protocol)
        for row in episodes:
            yield from _check_cause(row, expected)


def _check_missed(
    conn: sqlite3.Connection, participant: str, protocol: Protocol
) -> Iterator[Finding]:
    """Yield that somebody missed other attention checks than was noted.

    Of a participant without any answer the skipped blocks alone are checked: the others' answers were erased, or a
    release left them out.
    """
    answers = answers_of(conn, participant)
    blocks = {block.name: block for block in protocol.blocks}
    for text in event_details(conn, participant, BLOCK_EVENT):
        detail = _detail_of(text)
        name, turn, noted = detail.get("block"), detail.get("turn"), detail.get("missed")
        person = f"participant {participant}"
        if name not in blocks:
            yield Finding(person, "block of questions", name, f"one of {', '.join(blocks)}")
            continue
        block, is_skipped = blocks[name], bool(detail.get("skipped"))
        if not block.attention_checks or not (answers or is_skipped):
            continue
        its = {
            asked: answer for (of, at, asked), answer in answers.items() if (of, at) == (name, turn)
        }
        if noted != (missed := missed_in(block, its)):
            yield Finding(person, f"missed attention checks in {name}", noted, missed)


def _check_attempts(
    conn: sqlite3.Connection, terrain: DailyTerrain, expected: _Expected
) -> Iterator[Finding]:
    """Yield what is wrong with the attempts at a day's terrain."""
    began, ended = terrain.series.frozen_ms, terrain.ends_ms
    for row in attempts_at(conn, terrain.series.name):
        where = f"episode {row['id']}"
        if row["player_id"] != row["owner_id"]:
            yield Finding(where, "player of a daily attempt", row["player_id"], row["owner_id"])
        if not began <= row["started_ms"] < ended + START_SLACK_MS:
            found = f"a time on {terrain.day} (UTC)"
            yield Finding(where, "start of a daily attempt", row["started_ms"], found)
        yield from _check_cause(row, expected)


def _ranked_order(
    conn: sqlite3.Connection,
    participant: str,
    episodes: list[PlacedEpisode],
    protocol: Protocol,
    expected: _Expected,
    arm: str | None,
) -> Generator[Finding, None, list[int] | None]:
    """Return the order of a participant's ranked terrains, None where it is not known; yield what is wrong with its number."""
    key, of = expected.key, expected.series.protocol_hash
    if not any(row["phase"] == "ranked" for row in episodes):
        return None
    details = event_details(conn, participant, ORDER_EVENT)
    number = _number_in(details)
    if number is None:
        where = f"participant {participant}"
        yield Finding(where, "number in the Latin square", details, "one whole number from 0")
        return None
    group = seeds.order_group(kind_of(conn, participant), arm)
    return None if key is None else seeds.balanced_order(key, of, group, number, protocol.ranked)


def _arm(
    conn: sqlite3.Connection, participant: str, protocol: Protocol, expected: _Expected
) -> Generator[Finding, None, str | None]:
    """Return a participant's arm; yield what is wrong with their assignment."""
    person = f"participant {participant}"
    details = event_details(conn, participant, ARM_EVENT)
    is_due = stage_of_assignment(protocol) in stages_of(conn, participant)
    if not details and not is_due:
        return None
    detail = _detail_of(details[0]) if len(details) == 1 else {}
    name = str(detail.get("arm"))
    if detail.get("assigned_by") == "operator":
        if protocol.recruitment != "invitation" or name not in {arm.name for arm in protocol.arms}:
            yield Finding(person, "assignment by the operator", name, "an arm, and an invitation")
        return name
    number = _number_in(details)
    if number is None or not protocol.arms:
        wanted = "one, with a whole number from 0" if protocol.arms else "none: there are no arms"
        yield Finding(person, "assignment to an arm", details, wanted)
        return None
    if expected.key is not None:
        kind, arms = kind_of(conn, participant), protocol.arms
        drawn = seeds.drawn_arm(
            expected.key, expected.series.protocol_hash, kind, number, len(arms)
        )
        if name != arms[drawn].name:
            yield Finding(person, "arm", name, f"{arms[drawn].name}, by their number {number}")
    return name


def _detail_of(text: str) -> dict[str, object]:
    """The details of an event; none if they are no JSON object."""
    try:
        detail = json.loads(text)
    except ValueError:
        return {}
    return detail if isinstance(detail, dict) else {}


def _number_in(details: list[str]) -> int | None:
    """The number in the one event of a drawing; None if there is no such number."""
    number = _detail_of(details[0]).get("number") if len(details) == 1 else None
    return number if isinstance(number, int) and number >= 0 else None


def _check_order(
    participant: str, episodes: list[PlacedEpisode], protocol: Protocol, ranked: list[int] | None
) -> Iterator[Finding]:
    """Yield what is wrong with the numbers and terrains of a participant's episodes."""
    where = f"participant {participant}"
    for phase, count in (("warm_up", protocol.most_warm_up), ("ranked", protocol.ranked)):
        numbers = [row["trial"] for row in episodes if row["phase"] == phase]
        terrains = [row["terrain_index"] for row in episodes if row["phase"] == phase]
        if numbers != list(range(len(numbers))):
            yield Finding(where, f"{phase} trials", numbers, "0, 1, 2, ... without a gap")
        if len(set(terrains)) < len(terrains) or not set(terrains) <= set(range(count)):
            wanted = f"each of 0..{count - 1} at most once"
            yield Finding(where, f"{phase} instances", terrains, wanted)
        order = list(range(count)) if phase == "warm_up" else ranked
        if order is not None and terrains != order[: len(terrains)]:
            yield Finding(where, f"order of {phase} instances", terrains, order[: len(terrains)])


def _check_stage(
    conn: sqlite3.Connection,
    participant: str,
    episodes: list[PlacedEpisode],
    protocol: Protocol,
) -> Iterator[Finding]:
    """Yield that a participant who came to the debrief has ended fewer ranked episodes than that takes."""
    ended = sum(row["phase"] == "ranked" and row["ended_ms"] is not None for row in episodes)
    if ended < protocol.ranked and {"debrief", "complete"} & stages_of(conn, participant):
        wanted = f"{protocol.ranked}, since they came to the debrief"
        yield Finding(f"participant {participant}", "ranked episodes that ended", ended, wanted)


def _check_cause(row: PlacedEpisode, expected: _Expected) -> Iterator[Finding]:
    """Yield what is wrong with an episode's series, its configuration, its flags and its seed."""
    where, config_hash = f"episode {row['id']}", expected.config_hash
    if row["series"] != expected.series.name:
        yield Finding(where, "series", row["series"], expected.series.name)
    if row["config_hash"] != config_hash:
        yield Finding(where, "config_hash", row["config_hash"], f"{config_hash} of the protocol")
    if row["seed_chosen"] or row["assisted"]:
        yield Finding(where, "seed_chosen, assisted", (row["seed_chosen"], row["assisted"]), (0, 0))
    seed = None
    if row["phase"] == "tutorial":
        seed = seeds.TUTORIAL_SEED
    elif expected.key is not None:
        label: Literal["ranked", "warm-up"] = "ranked" if row["phase"] == "ranked" else "warm-up"
        seed = seeds.seed(expected.key, expected.series.protocol_hash, label, row["terrain_index"])
    if seed is not None and row["seed"] != seed:
        what = f"seed of {row['phase']} instance {row['terrain_index']} (trial {row['trial']})"
        yield Finding(where, what, row["seed"], f"{seed} from the secret")


def check_attestation(conn: sqlite3.Connection, episode: CheckedEpisode) -> Iterator[Finding]:
    """Yield what is wrong with the level of a finished episode and with the reason for it.

    That an episode's timing is another one's copy follows from rows that need not be here.
    """
    row = episode.row
    if episode.allowed is None and _has_clock(row["task"]):
        return  # which action followed from the keys depends on what the environment allowed
    stored: Level = (row["attestation"], row["attestation_reason"])
    derive = partial(_derive_level, episode, input_of(conn, row["id"]))
    found = derive(row["ended_ms"])
    # what a participant chose later is asked for only where the level does not follow without it
    if not _fits(stored, found, row["driver"]) and not _fits(stored, derive(None), row["driver"]):
        what = _in_words(found)
        if row["driver"] != "human":
            what = f"none, since its driver is {row['driver']}, unless it is spoilt"
        yield Finding(f"episode {row['id']}", "attestation", _in_words(stored), what)


def _derive_level(episode: CheckedEpisode, given: InputOf, until_ms: int | None) -> Level:
    """Return an episode's level and reason by its rows; what a participant chose after `until_ms` does not matter.

    Without `until_ms` everything matters: a server's clock that was set back makes an earlier choice look later.
    """
    try:
        known = (s for at_ms, s in given.settings if until_ms is None or at_ms <= until_ms)
        settings = [json.loads(detail) for detail in known]
        environment = environment_of(episode.row["task"])
        controls = controls_of(environment, settings) if environment.clock else ()
        allowed = (episode.allowed or ()) if environment.clock else ()
        asked = tuple(given.supervised_ms), not given.is_studys, controls, allowed
        key_map = key_map_of(environment.keys, settings)
        conditions = Conditions(episode.row["started_ms"], key_map, *asked)
        attested = attest(episode.steps, episode.events, conditions)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
        return None, f"rows that cannot be read: {error}"
    return attested.level, attested.reason


def _has_clock(task: str) -> bool:
    """Whether a task's boards tick; False for a task that is not known here."""
    try:
        return environment_of(task).clock is not None
    except ValueError:
        return False


def _fits(stored: Level, found: Level, driver: str) -> bool:
    if driver != "human" and found[0] != "spoilt":
        return stored == (None, None)
    return found[0] not in (None, "unattested") if stored == ("spoilt", COPIED) else stored == found


def _in_words(level: Level) -> str:
    return " because: ".join(str(part) for part in level if part is not None) or "none"
