"""Studies against their protocol: hashes, the revealed secret, every seed, and what each participant was given to play."""

from __future__ import annotations

import hashlib
import json
import re
import sqlite3
from collections.abc import Iterator, Mapping
from typing import Any

from app.storage.resimulation import Finding
from app.study import seeds
from app.study.protocol import Protocol, StudyError, canonical_json, checked

ORIGINAL_ID = re.compile(r"[0-9a-f]{32}")
"""A participant's id as a server draws it. A pseudonym is not one: the order of terrains was drawn for the id it hides."""

_TRIALS = """SELECT s.phase, s.trial, s.terrain, s.participant_id, e.id, e.seed, e.config_hash, e.seed_chosen, e.assisted
    FROM study_episodes s JOIN episodes e ON e.id = s.episode_id WHERE s.participant_id = ? ORDER BY s.phase, s.trial"""


def check_studies(conn: sqlite3.Connection, secrets: Mapping[str, bytes], only: str | None = None) -> Iterator[Finding]:
    """Return what is wrong with the studies of a database and with what their participants were given.

    secrets  of open studies, where they are known
    """
    sql = "SELECT name, protocol, protocol_hash, commitment, secret FROM studies WHERE ? IS NULL OR name = ?"
    for name, protocol, protocol_hash, commitment, revealed in conn.execute(sql, (only, only)).fetchall():
        where = f"study {name}"
        try:
            data = json.loads(protocol)
            found = hashlib.sha256(canonical_json(data)).hexdigest()
            parsed = checked(data)
            secret = bytes.fromhex(revealed) if revealed else secrets.get(name)
        except (ValueError, StudyError) as error:
            yield Finding(where, "protocol or secret", "something unreadable", str(error))
            continue
        if found != protocol_hash:
            yield Finding(where, "protocol_hash", protocol_hash, found)
        if secret is not None and seeds.commitment(secret) != commitment:
            yield Finding(where, "commitment", commitment, f"{seeds.commitment(secret)} from the secret")
        for (participant,) in conn.execute("SELECT id FROM participants WHERE study = ? ORDER BY joined_ms", [name]).fetchall():
            yield from _of_participant(conn, participant, parsed, protocol_hash, secret)


def _of_participant(
    conn: sqlite3.Connection, participant: str, protocol: Protocol, protocol_hash: str, secret: bytes | None
) -> Iterator[Finding]:
    trials = conn.execute(_TRIALS, [participant]).fetchall()
    where = f"participant {participant}"
    for phase, count in (("warm_up", protocol.warm_up), ("ranked", protocol.ranked)):
        played = [row for row in trials if row[0] == phase]
        numbers, terrains = [row[1] for row in played], [row[2] for row in played]
        if numbers != list(range(len(numbers))):
            yield Finding(where, f"{phase} trials", numbers, "0, 1, 2, ... without a gap")
        if len(set(terrains)) < len(terrains) or not set(terrains) <= set(range(count)):
            yield Finding(where, f"{phase} terrains", terrains, f"each of 0..{count - 1} at most once")
        if phase == "warm_up":
            expected: list[int] = list(range(count))
        elif secret is not None and ORIGINAL_ID.fullmatch(participant):
            expected = seeds.order(secret, protocol_hash, participant, count)
        else:
            continue
        if terrains != expected[: len(terrains)]:
            yield Finding(where, f"order of {phase} terrains", terrains, expected[: len(terrains)])
    for row in trials:
        yield from _of_trial(row, protocol, protocol_hash, secret)


def _of_trial(row: tuple[Any, ...], protocol: Protocol, protocol_hash: str, secret: bytes | None) -> Iterator[Finding]:
    phase, trial, terrain, _, episode, seed, config_hash, seed_chosen, assisted = row
    where = f"episode {episode}"
    if config_hash != protocol.env_config.hash:
        yield Finding(where, "config_hash", config_hash, f"{protocol.env_config.hash} of the protocol")
    if seed_chosen or assisted:
        yield Finding(where, "seed_chosen, assisted", (seed_chosen, assisted), (0, 0))
    expected = None
    if phase == "tutorial":
        expected = seeds.TUTORIAL_SEED
    elif secret is not None:
        expected = seeds.seed(secret, protocol_hash, "ranked" if phase == "ranked" else "warm-up", terrain)
    if expected is not None and seed != expected:
        yield Finding(where, f"seed of {phase} terrain {terrain} (trial {trial})", seed, f"{expected} from the study's secret")
