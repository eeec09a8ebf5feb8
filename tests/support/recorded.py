"""Real episodes stored as the server does it, for the tests of their readers."""

from __future__ import annotations

import itertools
import sqlite3
import time
from collections.abc import Sequence
from contextlib import closing

from humanplay.db.input_events import InputEventRow, add_input_events
from humanplay.db.store import Closing, SessionRow, StepRow, Store, StoredEpisode, Trial
from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.episode import Episode
from tests.support.page_loads import STORED_LOAD

SMALL = EnvConfig("random", 5, 7, sensor_radius=2)
NOW = int(time.time() * 1000)
KEYS = ("ArrowUp", "ArrowRight", "ArrowDown", "ArrowLeft")
"""By action."""
_numbers = itertools.count()


def ask(path, sql, *values):
    """Return the rows of a query on a database, which a server may have open."""
    with closing(sqlite3.connect(path)) as conn:
        return conn.execute(sql, values).fetchall()


def alter(path, *statements):
    """Execute statements on a database file; return how many rows the last changed."""
    with closing(sqlite3.connect(path, isolation_level=None)) as conn:
        return [conn.execute(statement).rowcount for statement in statements][-1]


def add_session(
    store: Store, player: str | None = "ada", driver: str = "human", rival_of: str | None = None
) -> str:
    """Return the id of a new session."""
    if player is not None:
        store.add_player(player, NOW)
    session = f"recorded-session-{next(_numbers)}"
    store.add_session(SessionRow(session, player, driver, rival_of, "follow", 2.0, NOW))
    return session


def resumable(store: Store, now_ms: int) -> list[StoredEpisode]:
    """Every session that a server would resume, in the order of storing."""
    ids = [row["id"] for row in store.query("SELECT id FROM sessions ORDER BY rowid")]
    return [
        session
        for stored_id in ids
        if (session := store.resume_session(stored_id, now_ms)) is not None
    ]


def open_episode(
    store: Store,
    session: str,
    seed: int,
    config: EnvConfig = SMALL,
    number: int = 0,
    after=lambda row: None,
    **rest,
):
    """The row of a new open episode and the episode itself.

    after  called with the row in the same transaction
    """
    episode = Episode.begin(config, seed=seed)
    fields = {
        "seed_chosen": False,
        "driver": "human",
        "assisted": False,
        "started_ms": NOW + next(_numbers),
        **rest,
    }
    row = Trial(
        id=f"recorded-episode-{next(_numbers)}",
        session_id=session,
        number=number,
        task="mars",
        core_version=CORE_VERSION,
        config=config,
        seed=seed,
        terrain=episode.record().terrain,
        start=episode.start,
        policy_seed=3,
        **fields,
    )
    with store.transaction():
        store.next_episode((), [row])
        after(row)
    return row, episode


def add_steps(
    store: Store,
    row: Trial,
    episode: Episode,
    actions: Sequence[int],
    driver: str = "human",
    level: str | None = None,
) -> None:
    """Make the moves, a person's with presses, and store them up to the ending.

    The ending closes the episode.
    """
    for action in actions:
        if episode.ended:
            return
        frame, reward = episode.steps, episode.step(action)
        at, down_ms, input_kind = row.started_ms + 100 * episode.steps, 100.0 * episode.steps, None
        if driver == "human":
            press = InputEventRow("keydown", KEYS[action], False, True, down_ms, frame, 2.5)
            add_input_events(store, row.id, [press], at, f"step-{frame}", STORED_LOAD)
            input_kind = "key"
        step = StepRow(
            episode_id=row.id,
            step=frame,
            action=action,
            reward=reward,
            discovered=episode.discovered,
            server_ms=at,
            client_ms=down_ms + 0.5,
            key_down_ms=down_ms,
            key_up_ms=down_ms + 80.5,
            input=input_kind,
            driver=driver,
        )
        store.add_step(step)
        if episode.ended:
            store.next_episode(
                [Closing(row.id, episode.record(), at, level or level_of(driver))], ()
            )


def level_of(driver: str) -> str | None:
    """Return the attestation of an episode that `add_steps` recorded."""
    return "attested" if driver == "human" else None


def tour(episode: Episode) -> list[int]:
    """Actions that explore an episode's terrain: nearest frontier on the true map."""
    from marsexplorer.policies import load

    policy, twin = (
        load("frontier-cost", episode.config.sensor_radius),
        Episode.begin(episode.config, seed=episode.seed),
    )
    policy.reset(0)
    while not twin.ended:
        twin.step(policy.act(twin.observation()))
    return list(twin.actions)


def play(
    store: Store,
    seed: int,
    player: str | None = "ada",
    explore: bool = False,
    config: EnvConfig = SMALL,
    actions: Sequence[int] | None = None,
    **rest,
) -> Trial:
    """The row of a finished episode in its own session: a tour, or given up.

    actions  instead of two free moves, where it explores nothing
    """
    session = add_session(store, player)
    row, episode = open_episode(store, session, seed, config, **rest)
    driver = rest.get("driver", "human")
    moves = tour(episode) if explore else actions or free_moves(episode)[:2]
    add_steps(store, row, episode, moves, driver)
    if not episode.ended:
        episode.abandon()
        store.next_episode(
            [Closing(row.id, episode.record(), row.started_ms + 1000, level_of(driver))], ()
        )
    return row


def free_moves(episode: Episode) -> list[int]:
    """Return a move to a free neighbour and back, some times over."""
    row, col = episode.start
    if not episode.terrain[row, col + 1]:
        return [1, 3] * 5
    assert not episode.terrain[row + 1, col]
    return [2, 0] * 5
