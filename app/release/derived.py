"""Tables that only a bundle's database has: the policies' episodes, and what is computed of each episode's input and moves.

They are derived, so an import leaves them behind, and the next release makes them anew.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Sequence
from dataclasses import astuple
from pathlib import Path
from types import MappingProxyType
from typing import Any

from app.moves.likeness import EpisodeAgreements
from app.moves.regret import RegretRow
from app.storage.columns import TABLES
from app.storage.database import rows, transaction
from app.study.data import StudyData
from app.study.policy_episodes import PolicyEpisode
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.evaluation.agreement import Agreement
from marsexplorer.score import steps_to_target

INITIALS = "".join(name[0].upper() for name in ACTIONS)


def write_derived(
    database: Path,
    data: StudyData,
    episodes: Sequence[PolicyEpisode],
    regrets: Sequence[RegretRow] = (),
    agreements: EpisodeAgreements = MappingProxyType({}),
) -> None:
    """Write the tables into a bundle's database.

    data        the study as that database holds it
    episodes    of the policies, on its ranked terrains
    regrets, agreements  of the moves of ranked episodes
    """
    places = {
        name: place for place, name in enumerate(dict.fromkeys(each.policy for each in episodes))
    }
    found = [(places[each.policy], *_row(each, data.protocol.env_config)) for each in episodes]
    conn = sqlite3.connect(database, isolation_level=None)
    try:
        with transaction(conn):
            for table in TABLES.values():
                for statement in table.statements("bundle database"):
                    conn.execute(statement)
            _add(
                conn,
                "input_summaries",
                (
                    (trial.id, json.dumps(list(trial.labels)), trial.pause_share)
                    for trial in data.trials
                    if trial.ended_ms is not None
                ),
            )
            _add(conn, "policy_episodes", found)
            _add(conn, "move_regrets", map(astuple, regrets))
            _add(
                conn,
                "move_agreements",
                ((*key, each.moves, each.agreed) for key, each in agreements.items()),
            )
    finally:
        conn.close()


def _add(conn: sqlite3.Connection, table: str, found: Iterable[tuple[Any, ...]]) -> None:
    conn.executemany(TABLES[table].insert("bundle database"), found)


def read_policy_episodes(conn: sqlite3.Connection) -> tuple[PolicyEpisode, ...]:
    """Return the policies' episodes that a bundle's database holds; none from a bundle of an earlier version."""
    if not rows(conn, "SELECT 1 FROM sqlite_master WHERE name = 'policy_episodes'"):
        return ()
    return tuple(
        PolicyEpisode(
            policy=row["policy"],
            policy_hash=row["policy_hash"],
            terrain=row["terrain_index"],
            seed=row["seed"],
            actions=bytes(INITIALS.index(letter) for letter in row["actions"]),
            trajectory_hash=row["trajectory_hash"],
        )
        for row in rows(conn, "SELECT * FROM policy_episodes ORDER BY place, terrain_index")
    )


def read_agreements(conn: sqlite3.Connection) -> dict[tuple[str, str], Agreement]:
    """Return the agreements of moves by (episode id, policy) that a bundle's database holds."""
    if not rows(conn, "SELECT 1 FROM sqlite_master WHERE name = 'move_agreements'"):
        return {}
    found = rows(conn, "SELECT * FROM move_agreements")
    return {
        (row["episode_id"], row["policy"]): Agreement(row["moves"], row["agreed"]) for row in found
    }


def read_regrets(conn: sqlite3.Connection) -> tuple[RegretRow, ...]:
    """Return the regrets of moves that a bundle's database holds, by episode and move."""
    if not rows(conn, "SELECT 1 FROM sqlite_master WHERE name = 'move_regrets'"):
        return ()
    found = rows(conn, "SELECT * FROM move_regrets ORDER BY episode_id, step")
    return tuple(RegretRow(episode=row.pop("episode_id"), **row) for row in found)


def _row(each: PolicyEpisode, config: EnvConfig) -> tuple[str | int | float | None, ...]:
    episode = each.replay(config)
    return (
        each.policy,
        each.policy_hash,
        each.terrain,
        each.seed,
        episode.outcome,
        episode.steps,
        steps_to_target(config, episode.outcome, episode.steps),
        episode.score,
        "".join(INITIALS[action] for action in each.actions),
        each.trajectory_hash,
    )
