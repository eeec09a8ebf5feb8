"""Input events of a person's episodes: stored once each, and read back in order.

The functions work on a store's connection and in its transactions.
"""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from humanplay.db import chain
from humanplay.db.columns import TABLES
from humanplay.db.reader import Reader
from humanplay.db.rows import EventRow
from humanplay.db.store import Store, forget_batches

MAX_EVENTS_PER_EPISODE = 50_000
"""Most input events kept of an episode: some hours of typing."""
EVENT_BYTES, BATCH_BYTES = 80, 90
"""Bytes of the database's file that an input event takes, and a batch of them, whose id (in two
trees) comes on top."""
MAX_PAGE_LOADS = 200
"""Most loads of the page that an episode's input events may come from."""
COPIED_GAPS = (12, 40)
"""Fewest and most gaps between presses, from the first on, that are compared with another
episode's: twelve gaps in tenths of a millisecond are the same twice by a copy alone, and the more
are compared, the less two clocks of 100 ms are taken for one."""
COMPARED_EPISODES = 5_000
"""Newest episodes that are compared: a look at 5,000 takes some 20 ms."""

_FIRST = "SELECT coalesce(max(number) + 1, 0) AS first FROM input_events WHERE episode_id = ?"
_ENDED = "SELECT ended_ms FROM episodes WHERE id = ?"
_BATCH = "SELECT 1 FROM event_batches WHERE episode_id = ? AND batch = ?"
_BYTES = f"""SELECT (SELECT coalesce(max(number) + 1, 0) FROM input_events WHERE episode_id = ?1) * {EVENT_BYTES}
    + (SELECT coalesce(sum({BATCH_BYTES} + 2 * length(batch)), 0) FROM event_batches WHERE episode_id = ?1) AS n"""
_LOADS = "SELECT number, tab, load_id, tab_id FROM page_loads WHERE episode_id = ? ORDER BY number"
_GAP = """(SELECT b.key_down_ms - a.key_down_ms FROM steps a JOIN steps b ON b.episode_id = a.episode_id AND b.step = a.step + 1
    WHERE a.episode_id = f.id AND a.step = {step})"""
_COMPARED = """(SELECT id FROM episodes WHERE driver = 'human' AND ended_ms IS NOT NULL AND id != ?1
    ORDER BY ended_ms DESC LIMIT ?2) f"""


TOO_MANY_EVENTS = "this episode has more input events than are kept; the rest is dropped"


class TooManyEventsError(ValueError):
    """No more input events are stored of an episode; the text says why."""


class PageLoad(NamedTuple):
    """A load of the page, and the tab that it is in, by the ids that the page drew."""

    load_id: str
    tab_id: str


class InputEventRow(NamedTuple):
    """An input event as the page saw it; times are ms of its page load's clock."""

    kind: str
    code: str | None
    repeat: bool | None
    trusted: bool | None
    client_ms: float
    step: int | None
    round_trip_ms: float | None


def batch_bytes(events: int, batch: str) -> int:
    """Bytes of the database's file that a batch takes.

    Args:
        events: How many are in it.
        batch: Its id.
    """
    return events * EVENT_BYTES + BATCH_BYTES + 2 * len(batch)


def add_input_events(
    store: Store,
    episode_id: str,
    events: Sequence[InputEventRow],
    at_ms: int,
    batch: str,
    page_load: PageLoad,
    room: float = math.inf,
) -> None:
    """Store a batch of input events of an episode once, however often it comes.

    A batch that was being sent when the connection broke can arrive after its repetition and after
    later batches. Events that come after the end of the episode get a later time than the end, so
    that the rows say what was there when it ended.

    Args:
        batch: Its id, which its page drew.
        room: Bytes that all input events of the episode may take.

    Raises:
        TooManyEventsError: Beyond the room, MAX_EVENTS_PER_EPISODE or MAX_PAGE_LOADS; nothing of
            the batch is stored.
    """
    if not events:
        return
    with store.transaction():
        conn = store.connection
        if conn.execute(_BATCH, (episode_id, batch)).fetchone():
            return
        first: int = conn.execute(_FIRST, [episode_id]).fetchone()[0]
        (stored,) = conn.execute(_BYTES, [episode_id]).fetchone()
        taken = stored + batch_bytes(len(events), batch)
        if first + len(events) > MAX_EVENTS_PER_EPISODE or taken > room:
            raise TooManyEventsError(TOO_MANY_EVENTS)
        numbers = _number_load(conn, episode_id, page_load)
        (ended_ms,) = conn.execute(_ENDED, [episode_id]).fetchone()
        at_ms = at_ms if ended_ms is None else max(at_ms, ended_ms + 1)
        rows = [
            (episode_id, number, *numbers, *event, at_ms)
            for number, event in enumerate(events, first)
        ]
        conn.executemany(TABLES["input_events"].insert(), rows)
        conn.execute("INSERT INTO event_batches VALUES (?, ?, ?)", (episode_id, first, batch))
        if ended_ms is not None:
            forget_batches(conn, episode_id)
        chain.append_late_events(conn, episode_id, first)


def _number_load(conn: sqlite3.Connection, episode_id: str, page_load: PageLoad) -> tuple[int, int]:
    """The numbers of a tab and of its page load in an episode."""
    loads = conn.execute(_LOADS, [episode_id]).fetchall()
    tabs = {tab_id: tab for _, tab, _, tab_id in loads}
    for number, tab, load_id, _ in loads:
        if load_id == page_load.load_id:
            return tab, number
    if len(loads) >= MAX_PAGE_LOADS:
        raise TooManyEventsError(
            f"this episode has input events of {MAX_PAGE_LOADS} loads of its page, the most that are kept; go on in one of them"
        )
    tab = tabs.get(page_load.tab_id, len(tabs))
    row = (episode_id, len(loads), tab, *page_load)
    conn.execute(TABLES["page_loads"].insert(), row)
    return tab, len(loads)


def input_events(reader: Reader, episode_id: str) -> list[EventRow]:
    """An episode's input events in order."""
    sql = "SELECT * FROM input_events WHERE episode_id = ? ORDER BY number"
    return reader.query(sql, [episode_id])


def count_input_events(reader: Reader, episode_id: str) -> int:
    """How many input events of an episode are stored.

    They are numbered from 0 on, and none goes while it runs.
    """
    return int(reader.query(_FIRST, [episode_id])[0]["first"])


def has_copied_timing(reader: Reader, episode_id: str) -> bool:
    """Whether an episode's presses have the gaps of another ended episode's.

    Presses are those of the moves (`steps.key_down_ms`), from the first on. Only a copy to the
    tenth of a millisecond is found.
    """
    sql = "SELECT key_down_ms FROM steps WHERE episode_id = ? ORDER BY step LIMIT ?"
    times = [row["key_down_ms"] for row in reader.query(sql, [episode_id, COPIED_GAPS[1] + 1])]
    if None in times or len(times) <= COPIED_GAPS[0]:
        return False
    gaps = [after - before for before, after in pairwise(times)]
    # SQLite stops at the first gap that differs; after the fewest gaps the other episode may have ended
    alike = [
        f"coalesce(abs({_GAP.format(step=step)} - {gap!r}) < 0.06, {step >= COPIED_GAPS[0]:d})"
        for step, gap in enumerate(gaps)
    ]
    same = " AND ".join(alike)
    sql = f"SELECT 1 FROM {_COMPARED} WHERE {same} LIMIT 1"
    return bool(reader.query(sql, [episode_id, COMPARED_EPISODES]))
