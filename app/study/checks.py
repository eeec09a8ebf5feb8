"""Studies against their protocol: hashes, the revealed secret, every seed, and what each participant was given to play.

Episodes against their input events: the level of their attestation follows from these.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from app.play.attestation import COPIED, Conditions, attest, key_map_of
from app.storage.checks import (
    InputOf,
    episodes_of,
    input_of,
    order_events,
    participants_of,
    studies,
)
from app.storage.resimulation import Finding
from app.storage.study_rows import StudyRow
from app.study import seeds
from app.study.protocol import Protocol, StudyError, canonical_json, parse_protocol

Level = tuple[str | None, str | None]
"""The level of an episode's attestation, and the reason why it is not attested."""


@dataclass(frozen=True)
class _Expected:
    """What the episodes of a study are checked against; `secret` is None where it is not known."""

    protocol: Protocol
    protocol_hash: str
    secret: bytes | None


def check_studies(
    conn: sqlite3.Connection, secrets: Mapping[str, bytes], only: str | None = None
) -> Iterator[Finding]:
    """Yield what is wrong with the studies of a database and with what their participants were given.

    secrets  of open studies, where they are known
    """
    for study in studies(conn, only):
        yield from _check_study(conn, study, secrets.get(study.name))


def _check_study(
    conn: sqlite3.Connection, study: StudyRow, known: bytes | None
) -> Iterator[Finding]:
    where = f"study {study.name}"
    try:
        data = json.loads(study.protocol)
        found = hashlib.sha256(canonical_json(data)).hexdigest()
        protocol = parse_protocol(data)
        secret = bytes.fromhex(study.secret) if study.secret else known
    except (ValueError, StudyError) as error:
        yield Finding(where, "protocol or secret", "something unreadable", str(error))
        return
    if found != study.protocol_hash:
        yield Finding(where, "protocol_hash", study.protocol_hash, found)
    if secret is not None and seeds.commitment(secret) != study.commitment:
        yield Finding(
            where, "commitment", study.commitment, f"{seeds.commitment(secret)} from the secret"
        )
    expected = _Expected(protocol, study.protocol_hash, secret)
    for participant in participants_of(conn, study.name):
        episodes = episodes_of(conn, participant)
        order = yield from _ranked_order(conn, participant, episodes, expected)
        yield from _check_order(participant, episodes, expected, order)
        for row in episodes:
            yield from _check_cause(row, expected)


def _ranked_order(
    conn: sqlite3.Connection, participant: str, episodes: list[dict[str, Any]], expected: _Expected
) -> Generator[Finding, None, list[int] | None]:
    """Return the order of a participant's ranked terrains, None where it is not known; yield what is wrong with its number."""
    secret, count = expected.secret, expected.protocol.ranked
    if not any(row["phase"] == "ranked" for row in episodes):
        return None
    kind, details = order_events(conn, participant)
    number = _order_number(details)
    if number is None:
        yield Finding(
            f"participant {participant}",
            "number in the Latin square",
            details,
            "one whole number from 0",
        )
        return None
    return (
        None
        if secret is None
        else seeds.balanced_order(secret, expected.protocol_hash, kind, number, count)
    )


def _order_number(details: list[str]) -> int | None:
    """Return the number in the one event that fixes an order; None when there is not one, or no number in it."""
    try:
        (number,) = (json.loads(detail)["number"] for detail in details)
    except (ValueError, TypeError, KeyError):
        return None
    return number if isinstance(number, int) and number >= 0 else None


def _check_order(
    participant: str, episodes: list[dict[str, Any]], expected: _Expected, ranked: list[int] | None
) -> Iterator[Finding]:
    """Yield what is wrong with the numbers and terrains of a participant's episodes."""
    where = f"participant {participant}"
    for phase, count in (
        ("warm_up", expected.protocol.warm_up),
        ("ranked", expected.protocol.ranked),
    ):
        numbers = [row["trial"] for row in episodes if row["phase"] == phase]
        terrains = [row["terrain_index"] for row in episodes if row["phase"] == phase]
        if numbers != list(range(len(numbers))):
            yield Finding(where, f"{phase} trials", numbers, "0, 1, 2, ... without a gap")
        if len(set(terrains)) < len(terrains) or not set(terrains) <= set(range(count)):
            yield Finding(
                where, f"{phase} terrains", terrains, f"each of 0..{count - 1} at most once"
            )
        order = list(range(count)) if phase == "warm_up" else ranked
        if order is not None and terrains != order[: len(terrains)]:
            yield Finding(where, f"order of {phase} terrains", terrains, order[: len(terrains)])


def _check_cause(row: dict[str, Any], expected: _Expected) -> Iterator[Finding]:
    """Yield what is wrong with an episode's configuration, its flags and its seed."""
    where, config_hash = f"episode {row['id']}", expected.protocol.env_config.hash
    if row["config_hash"] != config_hash:
        yield Finding(where, "config_hash", row["config_hash"], f"{config_hash} of the protocol")
    if row["seed_chosen"] or row["assisted"]:
        yield Finding(where, "seed_chosen, assisted", (row["seed_chosen"], row["assisted"]), (0, 0))
    seed = None
    if row["phase"] == "tutorial":
        seed = seeds.TUTORIAL_SEED
    elif expected.secret is not None:
        label: Literal["ranked", "warm-up"] = "ranked" if row["phase"] == "ranked" else "warm-up"
        seed = seeds.seed(expected.secret, expected.protocol_hash, label, row["terrain_index"])
    if seed is not None and row["seed"] != seed:
        what = f"seed of {row['phase']} terrain {row['terrain_index']} (trial {row['trial']})"
        yield Finding(where, what, row["seed"], f"{seed} from the study's secret")


def check_attestation(
    conn: sqlite3.Connection, row: dict[str, Any], steps: list[dict[str, Any]]
) -> Iterator[Finding]:
    """Yield what is wrong with the level of a finished episode and with the reason for it.

    row, steps  as `app.storage.checks.check_episode` returns them

    `declared` is the level of episodes that an earlier version recorded: those follow from nothing, but none is of a board
    that a cookie moves. That an episode's timing is another one's copy follows from rows that need not be here.
    Earlier versions of the playground attested no long burst, and what they stored of one may stand.
    """
    stored: Level = (row["attestation"], row["attestation_reason"])
    where = f"episode {row['id']}"
    if row["driver"] != "human":
        if stored != (None, None):
            yield Finding(
                where,
                "attestation",
                _in_words(stored),
                f"none, since its driver is {row['driver']}",
            )
        return
    if stored == ("declared", None) and row["control"] == "bearer":
        return
    given = input_of(conn, row["id"])
    derive = partial(_derive_level, row["started_ms"], steps, given)
    found, others = derive(row["ended_ms"]), [derive(None)]
    if not given.is_studys:
        others.append(derive(None, types_ahead=False))
    if not any(_fits(stored, each) for each in (found, *others)):
        yield Finding(where, "attestation", _in_words(stored), _in_words(found))


def _derive_level(
    started_ms: int,
    steps: list[dict[str, Any]],
    given: InputOf,
    until_ms: int | None,
    types_ahead: bool = True,
) -> Level:
    """Return an episode's level and reason by its rows; what a participant chose after `until_ms` does not matter.

    Without `until_ms` everything matters: a server's clock that was set back makes an earlier choice look later.
    """
    try:
        settings = [
            json.loads(detail)
            for at_ms, detail in given.settings
            if until_ms is None or at_ms <= until_ms
        ]
        conditions = Conditions(
            started_ms,
            key_map_of(settings),
            tuple(given.supervised_ms),
            types_ahead and not given.is_studys,
        )
        found = attest(steps, given.events, conditions)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
        return None, f"rows that cannot be read: {error}"
    return found.level, found.reason


def _fits(stored: Level, found: Level) -> bool:
    return (
        found[0] in ("attested", "supervised")
        if stored == ("unattested", COPIED)
        else stored == found
    )


def _in_words(level: Level) -> str:
    return " because: ".join(str(part) for part in level if part is not None) or "none"
