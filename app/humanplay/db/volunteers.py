"""What the volunteers' figures are made from: a player's sums for a configuration, kept by the
write that ends an episode.

A finished episode does not change, so sums only grow; after an erasure or a merge they are made
again from the episodes.
"""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Collection, Iterator
from functools import partial
from operator import add
from typing import NamedTuple

from humanplay.db.columns import TABLES
from humanplay.db.database import stream
from humanplay.db.reader import HUMAN_SCORE_CONDITION, JOINED, TRIAL, Reader
from humanplay.db.resimulation import Finding
from humanplay.db.trial import Trial

ROUNDING = 1e-9
"""Relative difference of sums of the same numbers in another order, at most."""


class Sums(NamedTuple):
    """What counted episodes come to: numbers of episodes, and sums over them.

    One that was left has the score of `Trial.as_left`. A spoilt one counts as abandoned;
    `played_score` and `played_steps` are with it as it was played. Steps are those of
    `Trial.steps_to_target`.
    """

    episodes: int
    abandoned: int
    spoilt: int
    failed: int
    score: float
    steps: int
    played_score: float
    played_steps: int

    @classmethod
    def of(cls, trial: Trial) -> Sums:
        """Return them of one episode."""
        is_spoilt = trial.attestation == "spoilt"
        own = trial.as_left()
        each = trial.forfeited() if is_spoilt else own
        score, played = each.score or 0.0, own.score or 0.0
        steps, played_steps = each.steps_to_target or 0, own.steps_to_target or 0
        is_abandoned, has_failed = each.outcome == "abandoned", not each.succeeded
        return cls(1, is_abandoned, is_spoilt, has_failed, score, steps, played, played_steps)


_COUNTED = f"SELECT {TRIAL} FROM episodes e {JOINED} WHERE e.ended_ms IS NOT NULL AND {HUMAN_SCORE_CONDITION}"
_ADD = f"""{TABLES["volunteers"].insert()} ON CONFLICT (config_hash, player_id) DO UPDATE SET
    {", ".join(f"{each} = {each} + excluded.{each}" for each in Sums._fields)}"""
_CHANGE = """INSERT INTO volunteer_figures VALUES (?, ?, ?, lower(hex(randomblob(8))))
    ON CONFLICT (config_hash) DO UPDATE SET state = excluded.state"""
_RANKED = f"""SELECT s.owner_id, e.seed, e.steps, e.outcome, e.attestation, e.ended_ms FROM episodes e {JOINED}
    WHERE e.ended_ms IS NOT NULL AND e.seed IS NOT NULL AND e.config_hash = ? AND {HUMAN_SCORE_CONDITION}"""
_SUMS = ", ".join(Sums._fields)
_PLAYERS = f"SELECT {_SUMS} FROM volunteers WHERE config_hash = ? ORDER BY player_id"
_PLAYER = f"SELECT {_SUMS} FROM volunteers WHERE config_hash = ? AND player_id = ?"


def add_episode(conn: sqlite3.Connection, episode_id: str) -> None:
    """Add an episode that has just ended to its player's sums, if it counts; call it in the
    transaction that ends it."""
    for trial, config in _counted(conn, " AND e.id = ?", episode_id):
        conn.execute(_ADD, (trial.config_hash, trial.owner_id, *Sums.of(trial)))
        conn.execute(_CHANGE, (trial.config_hash, trial.task, config))


def renew(conn: sqlite3.Connection) -> None:
    """Make all sums again from the episodes; call it inside a transaction."""
    sums, configs = _from_episodes(conn)
    conn.execute("DELETE FROM volunteers")
    conn.execute("DELETE FROM volunteer_figures")
    conn.executemany(_ADD, [(*key, *found) for key, found in sums.items()])
    conn.executemany(_CHANGE, [(config_hash, *played) for config_hash, played in configs.items()])


def played_configs(reader: Reader) -> list[tuple[str, str, str, str]]:
    """Return (hash, task, JSON, state) of each configuration with counted episodes; the state is
    new whenever a sum is."""
    found = reader.query("SELECT config_hash, task, config, state FROM volunteer_figures")
    return [(row["config_hash"], row["task"], row["config"], row["state"]) for row in found]


def players_of(reader: Reader, config_hash: str) -> list[Sums]:
    """Return the sums of everybody who has counted episodes of a configuration, in an order that
    stays."""
    return [Sums(**row) for row in reader.query(_PLAYERS, [config_hash])]


def player_sums(reader: Reader, config_hash: str, player: str) -> Sums | None:
    """Return a player's sums for a configuration; None without counted episodes."""
    found = reader.query(_PLAYER, [config_hash, player])
    return Sums(**found[0]) if found else None


class RankedRun(NamedTuple):
    """A ranked episode that counts: whose, on which terrain, and when it ended.

    Attributes:
        moves: To the goal; None where it was not reached.
    """

    player_id: str
    seed: int
    moves: int | None
    ended_ms: int


def state_of(reader: Reader, config_hash: str) -> str | None:
    """What changes whenever a counted episode of a configuration ends; None before the first."""
    sql = "SELECT state FROM volunteer_figures WHERE config_hash = ?"
    return next((str(row["state"]) for row in reader.query(sql, [config_hash])), None)


def ranked_runs(reader: Reader, config_hash: str, successes: Collection[str]) -> list[RankedRun]:
    """All ranked episodes of a configuration that count; a spoilt one as not finished."""
    runs = []
    for row in reader.query(_RANKED, [config_hash]):
        is_finished = row["outcome"] in successes and row["attestation"] != "spoilt"
        moves = row["steps"] if is_finished else None
        runs.append(RankedRun(row["owner_id"], row["seed"], moves, row["ended_ms"]))
    return runs


def differences(conn: sqlite3.Connection) -> Iterator[Finding]:
    """Yield what is kept and not as the episodes give it."""
    sums, configs = _from_episodes(conn)
    kept = {(row[0], row[1]): Sums(*row[2:]) for row in conn.execute("SELECT * FROM volunteers")}
    for key in sorted(kept.keys() | sums.keys()):
        stored, made = kept.get(key), sums.get(key)
        if stored is None or made is None or not _are_close(stored, made):
            where = f"volunteers' figure {key[0][:12]}"
            yield Finding(where, "a player's sums", tuple(stored or ()), tuple(made or ()))
    noted = {row[0]: row[1:3] for row in conn.execute("SELECT * FROM volunteer_figures")}
    for each in sorted(noted.keys() | configs.keys()):
        if (named := noted.get(each)) != (played := configs.get(each)):
            yield Finding(f"volunteers' figure {each[:12]}", "its configuration", named, played)


def _are_close(one: Sums, other: Sums) -> bool:
    is_close = partial(math.isclose, rel_tol=ROUNDING, abs_tol=ROUNDING)
    return all(map(is_close, one, other))


def _from_episodes(
    conn: sqlite3.Connection,
) -> tuple[dict[tuple[str, str], Sums], dict[str, tuple[str, str]]]:
    """Return the sums by configuration's hash and player, and the task and configuration (JSON) of
    each hash."""
    sums, configs = dict[tuple[str, str], Sums](), dict[str, tuple[str, str]]()
    for trial, config in _counted(conn):
        key, found = (trial.config_hash, str(trial.owner_id)), Sums.of(trial)
        if (known := sums.get(key)) is not None:
            found = Sums(*map(add, known, found))
        sums[key], configs[key[0]] = found, (trial.task, config)
    return sums, configs


def _counted(
    conn: sqlite3.Connection, which: str = "", *values: str
) -> Iterator[tuple[Trial, str]]:
    """Yield counted episodes with their configurations as JSON, all or those that an SQL condition
    names.

    One whose row is no episode's, or whose score has no mean, is left out: `verify` finds the
    former.
    """
    for row in stream(conn, f"{_COUNTED}{which} ORDER BY e.started_ms, e.id", *values):
        try:
            trial = Trial.of(row)
        except (ValueError, TypeError):
            continue
        if trial.score is not None and math.isfinite(trial.score):
            yield trial, row["config"]
