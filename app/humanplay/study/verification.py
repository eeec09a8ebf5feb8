"""What in a database differs from what its causes give.

Every finished episode is simulated again, and every entry of the chain is computed again. That
proves the file consistent. It cannot prove who wrote the file: the signature of a release does, to
anybody who knows the key.
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
from typing import Literal, NamedTuple

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
    """The result of a verification.

    Attributes:
        episodes, moves: Simulated.
        still_open: Unfinished episodes, which are not simulated.
        findings: What differs; empty if nothing does.
        chain: Its length and head; None if no chain was read.
        since: What came after the earlier head that was asked for.
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
    """Verify a database.

    Args:
        advance: Called with the episodes that are simulated, and their number.
        secrets: Study -> its secret, of open studies. Closed ones have theirs in the database.
        study: Verify only this study's episodes and participants.
        head: An earlier head that must be in the chain (hex).

    Raises:
        StoreError: If it is no database of the playground.
    """
    with reading(path) as conn:
        verification = verify_moment(conn, path, advance, secrets, study)
        since = None if head is None else find_head(conn, head)
    if head is not None and since is None:
        gone = "no entry with it: taken away, made anew, or of another database"
        lost = Finding("chain", "the head given", head, gone)
        return replace(verification, findings=(*verification.findings, lost))
    return replace(verification, since=since)


def verify_moment(
    conn: sqlite3.Connection,
    path: Path,
    advance: Advance = lambda done, total: None,
    secrets: Mapping[str, bytes] | None = None,
    study: str | None = None,
) -> Verification:
    """Verify a database as a connection sees it; else as `verify_database`."""
    for task in checks.tasks(conn):
        # an unknown task is a finding of the episodes that name it
        with suppress(ValueError):
            environment_of(task).prepare()
    # the seconds are those of the simulation, without what an environment needs to start
    started_s = time.monotonic()
    findings: list[Finding] = []
    moves = done = 0
    episodes = checks.finished_episodes(conn, study)
    for part in _check_episodes(path, conn, episodes):
        moves += part.moves
        done += part.episodes
        findings += part.findings
        advance(done, len(episodes))
    findings += checks.check_entries(conn, study)
    findings += check_series(conn, secrets or {}, study)
    findings += check_chain(conn)
    findings += checks.check_marks(conn)
    if study is None:
        findings += checks.check_owners(conn)
        findings += volunteers.differences(conn)
    # another version is no tampering: it is named after all that may be
    findings.sort(key=lambda finding: finding.what == "core_version")
    still_open = checks.count_unfinished(conn, study)
    seconds = time.monotonic() - started_s
    state = chain_state(conn)
    return Verification(len(episodes), moves, still_open, tuple(findings), seconds, state)


def check_policy_files(folder: Folder, names: Iterable[str]) -> Iterator[Finding]:
    """Find stored files of frozen studies' policies that were changed or lost."""
    for study in map(folder.study, names):
        if study.protocol.policy_hashes:
            for path, present, recorded in study.policy_files.damaged():
                wanted = f"{recorded} when the study was frozen"
                yield Finding(f"file {path}", "sha256", wanted, present or "no such file")


class _CheckedPart(NamedTuple):
    """How many episodes and moves were simulated, and what differs in them."""

    episodes: int
    moves: int
    findings: list[Finding]


def _check_episodes(
    path: Path, conn: sqlite3.Connection, episodes: Sequence[str]
) -> Iterator[_CheckedPart]:
    """Simulate episodes, in several processes if there are many.

    A process reads the database itself, perhaps at a later moment than `conn`. A finished episode
    does not change; if one was changed, that is a finding at either moment.
    """
    if len(episodes) < PARALLEL_FROM or cores() == 1:
        for ident in episodes:
            yield _check_episode(conn, ident)
        return
    starts = range(0, len(episodes), EPISODES_PER_TASK)
    tasks = [tuple(episodes[start : start + EPISODES_PER_TASK]) for start in starts]
    with Jobs(min(cores(), len(tasks))) as jobs:
        yield from jobs.map(_run_task, itertools.repeat(path), tasks)


def _check_episode(conn: sqlite3.Connection, ident: str) -> _CheckedPart:
    episode = checks.check_episode(conn, ident)
    findings = [*episode.findings, *check_attestation(conn, episode)]
    return _CheckedPart(1, len(episode.steps), findings)


def _run_task(path: Path, episodes: Sequence[str]) -> _CheckedPart:
    with reading(path) as conn:
        parts = [_check_episode(conn, ident) for ident in episodes]
    moves = sum(part.moves for part in parts)
    findings = [finding for part in parts for finding in part.findings]
    return _CheckedPart(len(episodes), moves, findings)


Level = tuple[str | None, str | None]
"""The level of an episode's attestation, and the reason why it is not attested."""


@dataclass(frozen=True)
class _Expectation:
    """What the episodes of a series must fit.

    Attributes:
        config_hash: Of every episode's configuration.
        key: The secret from which the seeds follow; None if it is unknown.
    """

    series: SeriesRow
    config_hash: str
    key: bytes | None


def check_series(
    conn: sqlite3.Connection, secrets: Mapping[str, bytes], only: str | None = None
) -> Iterator[Finding]:
    """Check studies and daily terrains, and what people got to play in them.

    Args:
        secrets: Study -> its secret, of open studies.
        only: Name of the one study to check.
    """
    for row in series(conn, only):
        yield from _check_series(conn, row, secrets)


def _check_series(
    conn: sqlite3.Connection, row: SeriesRow, secrets: Mapping[str, bytes]
) -> Iterator[Finding]:
    subject = f"{row.kind} {row.name}"
    # 1. what was fixed before anybody played
    try:
        fields = json.loads(row.protocol)
        protocol_hash = hashlib.sha256(canonical_json(fields)).hexdigest()
        rules = parse_protocol(fields) if row.kind == "study" else DailyTerrain.of(row)
        config = rules.env_config if isinstance(rules, Protocol) else rules.config
        secret = bytes.fromhex(row.secret) if row.secret else secrets.get(row.name)
    except (ValueError, TypeError, KeyError, StudyError) as error:
        yield Finding(subject, "protocol or secret", "something unreadable", str(error))
        return
    if protocol_hash != row.protocol_hash:
        yield Finding(subject, "protocol_hash", row.protocol_hash, protocol_hash)
    if secret is not None and (commitment := seeds.commitment(secret)) != row.commitment:
        of_folder = (
            ""
            if row.secret
            else " in the folder beside the database, which may be another server's"
        )
        from_secret = f"{commitment} from the secret{of_folder}"
        yield Finding(subject, "commitment", row.commitment, from_secret)
    # 2. what people played
    expected = _Expectation(row, config.hash, secret)
    if isinstance(rules, Protocol):
        yield from _check_participants(conn, rules, expected)
    else:
        yield from _check_attempts(conn, rules, expected)


def _check_participants(
    conn: sqlite3.Connection, protocol: Protocol, expected: _Expectation
) -> Iterator[Finding]:
    """Check when participants joined, their arms, and their episodes."""
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
    """Check the attention checks that a participant was noted to have missed.

    Without any answer of the participant only skipped blocks are checked: the answers to the others
    were erased, or a release left them out.
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
        block_answers = {
            question: answer
            for (answered_block, answered_turn, question), answer in answers.items()
            if (answered_block, answered_turn) == (name, turn)
        }
        if noted != (missed := missed_in(block, block_answers)):
            yield Finding(person, f"missed attention checks in {name}", noted, missed)


def _check_attempts(
    conn: sqlite3.Connection, terrain: DailyTerrain, expected: _Expectation
) -> Iterator[Finding]:
    """Check who made the attempts at a day's terrain, and when."""
    starts_ms, ends_ms = terrain.series.frozen_ms, terrain.ends_ms
    for row in attempts_at(conn, terrain.series.name):
        subject = f"episode {row['id']}"
        if row["player_id"] != row["owner_id"]:
            yield Finding(subject, "player of a daily attempt", row["player_id"], row["owner_id"])
        if not starts_ms <= row["started_ms"] < ends_ms + START_SLACK_MS:
            wanted = f"a time on {terrain.day} (UTC)"
            yield Finding(subject, "start of a daily attempt", row["started_ms"], wanted)
        yield from _check_cause(row, expected)


def _ranked_order(
    conn: sqlite3.Connection,
    participant: str,
    episodes: list[PlacedEpisode],
    protocol: Protocol,
    expected: _Expectation,
    arm: str | None,
) -> Generator[Finding, None, list[int] | None]:
    """Check the number that gives the order of a participant's ranked terrains.

    Returns:
        The order as indices of terrains; None if it is unknown.
    """
    if not any(row["phase"] == "ranked" for row in episodes):
        return None
    details = event_details(conn, participant, ORDER_EVENT)
    number = _number_in(details)
    if number is None:
        person = f"participant {participant}"
        yield Finding(person, "number in the Latin square", details, "one whole number from 0")
        return None
    if expected.key is None:
        return None
    group = seeds.order_group(kind_of(conn, participant), arm)
    protocol_hash = expected.series.protocol_hash
    return seeds.balanced_order(expected.key, protocol_hash, group, number, protocol.ranked)


def _arm(
    conn: sqlite3.Connection, participant: str, protocol: Protocol, expected: _Expectation
) -> Generator[Finding, None, str | None]:
    """Check a participant's assignment to an arm.

    Returns:
        The name of the arm; None if there is none.
    """
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
    """Check the numbers and terrains of a participant's episodes.

    Args:
        ranked: Indices of the ranked terrains in their order; None if it is unknown.
    """
    person = f"participant {participant}"
    for phase, count in (("warm_up", protocol.most_warm_up), ("ranked", protocol.ranked)):
        numbers = [row["trial"] for row in episodes if row["phase"] == phase]
        terrains = [row["terrain_index"] for row in episodes if row["phase"] == phase]
        if numbers != list(range(len(numbers))):
            yield Finding(person, f"{phase} trials", numbers, "0, 1, 2, ... without a gap")
        if len(set(terrains)) < len(terrains) or not set(terrains) <= set(range(count)):
            wanted = f"each of 0..{count - 1} at most once"
            yield Finding(person, f"{phase} instances", terrains, wanted)
        order = list(range(count)) if phase == "warm_up" else ranked
        if order is not None and terrains != order[: len(terrains)]:
            yield Finding(person, f"order of {phase} instances", terrains, order[: len(terrains)])


def _check_stage(
    conn: sqlite3.Connection,
    participant: str,
    episodes: list[PlacedEpisode],
    protocol: Protocol,
) -> Iterator[Finding]:
    """Check that a participant at the debrief has ended every ranked episode."""
    ended = sum(row["phase"] == "ranked" and row["ended_ms"] is not None for row in episodes)
    if ended < protocol.ranked and {"debrief", "complete"} & stages_of(conn, participant):
        wanted = f"{protocol.ranked}, since they came to the debrief"
        yield Finding(f"participant {participant}", "ranked episodes that ended", ended, wanted)


def _check_cause(row: PlacedEpisode, expected: _Expectation) -> Iterator[Finding]:
    """Check an episode's series, its configuration, its flags and its seed."""
    subject, config_hash = f"episode {row['id']}", expected.config_hash
    if row["series"] != expected.series.name:
        yield Finding(subject, "series", row["series"], expected.series.name)
    if row["config_hash"] != config_hash:
        yield Finding(subject, "config_hash", row["config_hash"], f"{config_hash} of the protocol")
    if row["seed_chosen"] or row["assisted"]:
        flags = (row["seed_chosen"], row["assisted"])
        yield Finding(subject, "seed_chosen, assisted", flags, (0, 0))
    seed = None
    if row["phase"] == "tutorial":
        seed = seeds.TUTORIAL_SEED
    elif expected.key is not None:
        label: Literal["ranked", "warm-up"] = "ranked" if row["phase"] == "ranked" else "warm-up"
        seed = seeds.seed(expected.key, expected.series.protocol_hash, label, row["terrain_index"])
    if seed is not None and row["seed"] != seed:
        seed_of = f"seed of {row['phase']} instance {row['terrain_index']} (trial {row['trial']})"
        yield Finding(subject, seed_of, row["seed"], f"{seed} from the secret")


def check_attestation(conn: sqlite3.Connection, episode: CheckedEpisode) -> Iterator[Finding]:
    """Check the level of a finished episode, and the reason for it.

    One reason is not checked: that the timing copies another episode, whose rows may be elsewhere.
    """
    row = episode.row
    if episode.allowed is None and _has_clock(row["task"]):
        return  # which action followed from the keys depends on what the environment allowed
    stored: Level = (row["attestation"], row["attestation_reason"])
    derive = partial(_derive_level, episode, input_of(conn, row["id"]))
    derived = derive(row["ended_ms"])
    # later settings of the participant only matter if the level does not follow without them
    if not _fits(stored, derived, row["driver"]) and not _fits(stored, derive(None), row["driver"]):
        wanted = _in_words(derived)
        if row["driver"] != "human":
            wanted = f"none, since its driver is {row['driver']}, unless it is spoilt"
        yield Finding(f"episode {row['id']}", "attestation", _in_words(stored), wanted)


def _derive_level(episode: CheckedEpisode, circumstances: InputOf, until_ms: int | None) -> Level:
    """Derive an episode's level and reason from its rows.

    Args:
        until_ms: Ignore the settings that the participant chose later. None for no bound: after a
            server's clock was set back, an earlier setting looks later.
    """
    try:
        settings = [
            json.loads(detail)
            for at_ms, detail in circumstances.settings
            if until_ms is None or at_ms <= until_ms
        ]
        environment = environment_of(episode.row["task"])
        conditions = Conditions(
            started_ms=episode.row["started_ms"],
            key_map=key_map_of(environment.keys, settings),
            supervised_ms=tuple(circumstances.supervised_ms),
            types_ahead=not circumstances.is_studys,
            controls=controls_of(environment, settings) if environment.clock else (),
            allowed=(episode.allowed or ()) if environment.clock else (),
        )
        attested = attest(episode.steps, episode.events, conditions)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
        return None, f"rows that cannot be read: {error}"
    return attested.level, attested.reason


def _has_clock(task: str) -> bool:
    """Whether a task's boards tick; False for an unknown task."""
    try:
        return environment_of(task).clock is not None
    except ValueError:
        return False


def _fits(stored: Level, derived: Level, driver: str) -> bool:
    """Whether an episode can have the stored level if its rows give the derived one."""
    if driver != "human" and derived[0] != "spoilt":
        return stored == (None, None)
    if stored == ("spoilt", COPIED):
        return derived[0] not in (None, "unattested")
    return stored == derived


def _in_words(level: Level) -> str:
    return " because: ".join(str(part) for part in level if part is not None) or "none"
