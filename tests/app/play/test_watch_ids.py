"""Boards are found by their ids for watching, at hardly any cost in memory."""

import asyncio
import gc
import tracemalloc
from collections import OrderedDict, defaultdict
from types import FunctionType, ModuleType

from humanplay.board.sources import WatchIds
from humanplay.db.store import Store
from tests.support.recorded import add_session
from tests.support.servers import eventually

BYTES_A_SESSION = 40
"""Most that memory holds of a session: its id for watching takes 16, an array that grows a few more."""


def test_nothing_in_memory_goes_by_the_ids_of_a_session_that_has_left(serve):
    server = serve(idle_s=0.2)
    client = server.page()
    begun = client.post("/api/sessions", json={"size": 9, "rival": "frontier-cost"}).json()
    ids = {begun["session"], begun["rival"]["session"], begun["frame"]["episode"]}
    with server.socket(begun["session"], client) as socket:
        socket.receive("frame")
    assert server.on_loop(_watched(server, begun["watch"])) == begun["session"]

    eventually(lambda: len(server.services.lobby) == 0)
    charged = server.services.lobby.charges._open  # an episode that has not ended
    eventually(lambda: all(holder is charged for holder in _keyed_by(ids, server.services)), 10)


def _keyed_by(ids, root):
    """Return all sets and dictionaries within an object that hold one of the ids."""
    seen, left, holders = {id(root)}, [root], []
    while left:
        for referent in gc.get_referents(left.pop()):
            if id(referent) in seen or isinstance(
                referent, (type, ModuleType, FunctionType, str, bytes)
            ):
                continue
            seen.add(id(referent))
            left.append(referent)
            if type(referent) in (dict, set, OrderedDict, defaultdict) and any(
                one in referent for one in ids
            ):
                holders.append(referent)
    return holders


async def _watched(server, watch):
    return await server.services.lobby.watch_ids.session(watch)


def test_boards_are_found_by_their_ids_for_watching_in_a_few_bytes_of_each(tmp_path, monkeypatch):
    monkeypatch.setattr("humanplay.board.sources.SESSIONS_A_LOOK", 300)
    store, count = Store(tmp_path / "playground.db"), 1_200
    with store.transaction():
        sessions = [add_session(store) for _ in range(count)]

    def look_for(session):
        return asyncio.run(watch_ids.session(watch_ids.of(session)))

    watch_ids = WatchIds(store)
    assert look_for(sessions[-1]) == sessions[-1]
    gc.collect()
    tracemalloc.start()
    try:
        watch_ids = WatchIds(store)
        assert look_for(sessions[-1]) == sessions[-1]
        gc.collect()
        grown = tracemalloc.get_traced_memory()[0] / count
    finally:
        tracemalloc.stop()
    assert grown < BYTES_A_SESSION
    assert [look_for(session_id) for session_id in sessions[::100]] == sessions[::100]
    with store.transaction():
        store.connection.execute("DELETE FROM sessions WHERE id = ?", [sessions[7]])
        sessions.append(add_session(store))
    assert look_for(sessions[7]) is None
    assert look_for(sessions[-1]) == sessions[-1]
    for other in (
        watch_ids.of("nobody"),
        watch_ids.of(sessions[2])[:-1] + "x",
        watch_ids.of(sessions[2]).upper(),
        "x" * 24,
        "",
    ):
        assert asyncio.run(watch_ids.session(other)) is None
    last = watch_ids.of(sessions[2])[-1]
    forged = watch_ids.of(sessions[2])[:-1] + ("0" if last != "0" else "1")
    assert asyncio.run(watch_ids.session(forged)) is None, (
        "its first 64 bits are those of a session"
    )
    monkeypatch.setattr("humanplay.board.sources.MAX_FOUND", 20)
    assert [look_for(session_id) for session_id in sessions[50:]] == sessions[50:]
    assert len(watch_ids._found) <= 20
    store.close()
