"""The sums that the volunteers' estimates are made from.

There are a player's sums for each configuration; the write that ends an episode adds to them. A
finished episode does not change, so sums only grow; after an erasure or a merge they are made again
from the episodes.
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
"""Most relative difference between sums of the same numbers in another order."""


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
        """The sums of one episode."""
        is_spoilt = trial.attestation == "spoilt"
        played = trial.as_left()
        counted = trial.forfeited() if is_spoilt else played
        score, played_score = counted.score or 0.0, played.score or 0.0
        steps, played_steps = counted.steps_to_target or 0, played.steps_to_target or 0
        is_abandoned, has_failed = counted.outcome == "abandoned", not counted.succeeded
        return cls(1, is_abandoned, is_spoilt, has_failed, score, steps, played_score, played_steps)


_COUNTED = f"SELECT {TRIAL} FROM episodes e {JOINED} WHERE e.ended_ms IS NOT NULL AND {HUMAN_SCORE_CONDITION}"
_ADD = f"""{TABLES["volunteers"].insert()} ON CONFLICT (config_hash, player_id) DO UPDATE SET
    {", ".join(f"{name} = {name} + excluded.{name}" for name in Sums._fields)}"""
_CHANGE = """INSERT INTO volunteer_figures VALUES (?, ?, ?, lower(hex(randomblob(8))))
    ON CONFLICT (config_hash) DO UPDATE SET state = excluded.state"""
_RANKED = f"""SELECT s.owner_id, e.seed, e.steps, e.outcome, e.attestation, e.ended_ms FROM episodes e {JOINED}
    WHERE e.ended_ms IS NOT NULL AND e.seed IS NOT NULL AND e.config_hash = ? AND {HUMAN_SCORE_CONDITION}"""
_SUMS = ", ".join(Sums._fields)
_PLAYERS = f"SELECT {_SUMS} FROM volunteers WHERE config_hash = ? ORDER BY player_id"
_PLAYER = f"SELECT {_SUMS} FROM volunteers WHERE config_hash = ? AND player_id = ?"


def add_episode(conn: sqlite3.Connection, episode_id: str) -> None:
    """Add an episode that has just ended to its player's sums, if it counts.

    Call it in the transaction that ends it.
    """
    for trial, config in _counted(conn, " AND e.id = ?", episode_id):
        conn.execute(_ADD, (trial.config_hash, trial.owner_id, *Sums.of(trial)))
        conn.execute(_CHANGE, (trial.config_hash, trial.task, config))


def renew(conn: sqlite3.Connection) -> None:
    """Make all sums again from the episodes; call it inside a transaction."""
    sums, configs = _from_episodes(conn)
    conn.execute("DELETE FROM volunteers")
    conn.execute("DELETE FROM volunteer_figures")
    conn.executemany(_ADD, [(*key, *player) for key, player in sums.items()])
    conn.executemany(_CHANGE, [(config_hash, *played) for config_hash, played in configs.items()])


def played_configs(reader: Reader) -> list[tuple[str, str, str, str]]:
    """(hash, task, JSON, state) of each configuration with counted episodes.

    The state is new whenever a sum is.
    """
    rows = reader.query("SELECT config_hash, task, config, state FROM volunteer_figures")
    return [(row["config_hash"], row["task"], row["config"], row["state"]) for row in rows]


def players_of(reader: Reader, config_hash: str) -> list[Sums]:
    """The sums of everybody with counted episodes of a configuration, in one order."""
    return [Sums(**row) for row in reader.query(_PLAYERS, [config_hash])]


def player_sums(reader: Reader, config_hash: str, player: str) -> Sums | None:
    """A player's sums for a configuration; None without counted episodes."""
    rows = reader.query(_PLAYER, [config_hash, player])
    return Sums(**rows[0]) if rows else None


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
    """A text that changes whenever a counted episode of a configuration ends, or None."""
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
    """Yield stored sums that differ from those of the episodes."""
    sums, configs = _from_episodes(conn)
    stored_sums = {
        (row[0], row[1]): Sums(*row[2:]) for row in conn.execute("SELECT * FROM volunteers")
    }
    for key in sorted(stored_sums.keys() | sums.keys()):
        stored, derived = stored_sums.get(key), sums.get(key)
        if stored is None or derived is None or not _are_close(stored, derived):
            estimate = f"volunteers' figure {key[0][:12]}"
            yield Finding(estimate, "a player's sums", tuple(stored or ()), tuple(derived or ()))
    noted = {row[0]: row[1:3] for row in conn.execute("SELECT * FROM volunteer_figures")}
    for hash_ in sorted(noted.keys() | configs.keys()):
        if (named := noted.get(hash_)) != (played := configs.get(hash_)):
            yield Finding(f"volunteers' figure {hash_[:12]}", "its configuration", named, played)


def _are_close(one: Sums, other: Sums) -> bool:
    is_close = partial(math.isclose, rel_tol=ROUNDING, abs_tol=ROUNDING)
    return all(map(is_close, one, other))


def _from_episodes(
    conn: sqlite3.Connection,
) -> tuple[dict[tuple[str, str], Sums], dict[str, tuple[str, str]]]:
    """All sums, worked out from the episodes.

    Returns:
        The sums by configuration's hash and player, and the task and configuration (JSON) of each
        hash.
    """
    sums, configs = dict[tuple[str, str], Sums](), dict[str, tuple[str, str]]()
    for trial, config in _counted(conn):
        key, added = (trial.config_hash, str(trial.owner_id)), Sums.of(trial)
        before = sums.get(key)
        sums[key] = added if before is None else Sums(*map(add, before, added))
        configs[key[0]] = (trial.task, config)
    return sums, configs


def _counted(
    conn: sqlite3.Connection, which: str = "", *values: str
) -> Iterator[tuple[Trial, str]]:
    """Yield counted episodes with their configurations as JSON.

    A row that is no episode, or whose score has no mean, is left out: `verify` finds the former.

    Args:
        which: An SQL condition with an AND before it; "" for all.
    """
    for row in stream(conn, f"{_COUNTED}{which} ORDER BY e.started_ms, e.id", *values):
        try:
            trial = Trial.of(row)
        except (ValueError, TypeError):
            continue
        if trial.score is not None and math.isfinite(trial.score):
            yield trial, row["config"]
