"""Tables that only a bundle's database has: the policies' episodes, and what is computed from each episode's input.

They are derived, so an import leaves them behind, and the next release makes them anew.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Sequence
from pathlib import Path

from app.storage.connection import rows
from app.storage.database import transaction
from app.study.data import StudyData
from app.study.policy_episodes import PolicyEpisode
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.score import steps_to_target

INITIALS = "".join(name[0].upper() for name in ACTIONS)
_TABLES = (
    """CREATE TABLE input_summaries (
        episode_id TEXT PRIMARY KEY REFERENCES episodes(id),
        labels TEXT NOT NULL, -- JSON, a list
        pause_share REAL NOT NULL) STRICT""",
    """CREATE TABLE policy_episodes (
        place INTEGER NOT NULL, -- of the policy among those compared
        policy TEXT NOT NULL,
        policy_hash TEXT,
        terrain_index INTEGER NOT NULL,
        seed INTEGER NOT NULL,
        outcome TEXT NOT NULL,
        steps INTEGER NOT NULL,
        steps_to_99 INTEGER NOT NULL,
        score REAL NOT NULL,
        actions TEXT NOT NULL,
        trajectory_hash TEXT NOT NULL,
        PRIMARY KEY (policy, terrain_index)) STRICT""",
)


def write_derived(database: Path, data: StudyData, episodes: Sequence[PolicyEpisode]) -> None:
    """Write both tables into a bundle's database.

    data      the study as that database holds it
    episodes  of the policies, on its ranked terrains
    """
    places = {name: place for place, name in enumerate(dict.fromkeys(each.policy for each in episodes))}
    found = [(places[each.policy], *_row(each, data.protocol.env_config)) for each in episodes]
    conn = sqlite3.connect(database, isolation_level=None)
    try:
        with transaction(conn):
            for statement in _TABLES:
                conn.execute(statement)
            summaries = [
                (trial.episode, json.dumps(list(trial.labels)), trial.pause_share)
                for trial in data.trials
                if trial.ended_ms is not None
            ]
            conn.executemany("INSERT INTO input_summaries VALUES (?, ?, ?)", summaries)
            conn.executemany(f"INSERT INTO policy_episodes VALUES ({', '.join('?' * 11)})", found)
    finally:
        conn.close()


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
