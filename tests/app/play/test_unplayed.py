"""Boards left for a day are deleted if unplayed, else closed; a study's stay."""

import asyncio
import itertools
import secrets
from contextlib import closing

from humanplay.board.lobby import Lobby
from humanplay.board.ranked import PageBoards
from humanplay.board.sources import Sources
from humanplay.db import chain
from humanplay.db.playground import delete_unplayed
from humanplay.db.store import SessionRow, Store
from humanplay.study.verification import verify_database
from humanplay.tasks.mars.policies import PolicyCatalogue
from humanplay.tasks.mars.task import Mars
from humanplay.web.settings import Limits
from tests.support.page_loads import LOAD
from tests.support.recorded import NOW, ask, open_episode, play
from tests.support.servers import eventually
from tests.support.study import Person, freeze

DAY_H = 24
LATER = NOW + 3_600_000
TABLES = (
    "players",
    "sessions",
    "episodes",
    "steps",
    "input_events",
    "participants",
    "series_episodes",
)


def ids(path):
    return {id_ for (id_,) in ask(path, "SELECT id FROM sessions")}


def counts(path):
    return {table: ask(path, f"SELECT count(*) FROM {table}")[0][0] for table in TABLES}


async def delete_later(path, hours):
    """Delete what is unplayed some hours from now, on a server that has just started."""
    with closing(Store(path)) as store:
        lobby = Lobby(
            store,
            Mars(PolicyCatalogue()),
            Sources(clock_ms=lambda: Sources().clock_ms() + int(hours * 3_600_000)),
            600.0,
        )
        head = chain.head(store.connection)
        deleted = await PageBoards(lobby, 1e9, DAY_H).delete_unplayed()
        assert chain.head(store.connection) == head
        lobby.close()
    return deleted


def test_boards_that_nobody_has_moved_on_are_deleted_and_nothing_else_is(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    server = serve()
    path = tmp_path / "playground.db"
    staying, gone = set(), set()

    def begin(client=None, **body):
        return (client or server.page()).post("/api/sessions", json={"size": 9, **body}).json()

    for _ in range(3):
        gone.add(begin()["session"])
    begun = begin(rival="frontier-cost")
    gone |= {begun["session"], begun["rival"]["session"]}
    moved = server.page()
    begun = begin(moved)
    with server.socket(begun["session"], moved) as socket:
        socket.act(socket.receive("frame"), "south", input="key")
        socket.frame_after(0)
    staying.add(begun["session"])
    pressed = server.page()
    begun = begin(pressed)
    with server.socket(begun["session"], pressed) as socket:
        socket.send(
            {
                "kind": "events",
                "batch": secrets.token_hex(8),
                **LOAD,
                "episode": begun["frame"]["episode"],
                "events": [{"kind": "blur", "client_ms": 1}],
            }
        )
        assert socket.receive("kept")["count"] == 1
    staying.add(begun["session"])
    ended = server.client()
    begun = begin(ended)
    ended.post(f"/api/sessions/{begun['session']}/episodes")
    staying.add(begun["session"])
    policy = begin(player="frontier-cost")
    eventually(
        lambda: (
            server.client().get(f"/api/sessions/{policy['session']}/history").status_code
            in (200, 404)
        )
    )
    staying.add(server.page().post("/api/daily").json()["session"])
    person = Person(server)
    person.to_tutorial()
    person.call("next")
    staying.add(person.where["session"])
    newest = begin()["session"]
    server.stop()

    before = counts(path)
    assert asyncio.run(delete_later(path, DAY_H - 1)) == 0
    assert counts(path) == before
    assert asyncio.run(delete_later(path, DAY_H + 1)) >= len(gone)
    left = ids(path)
    assert not left & gone
    assert staying | {newest} <= left
    after = counts(path)
    assert after["players"] < before["players"]
    assert [after[table] for table in TABLES[3:]] == [before[table] for table in TABLES[3:]]
    assert verify_database(path).findings == ()


def test_a_board_that_is_open_stays_however_old_it_is(serve, tmp_path):
    server = serve()
    client = server.page()
    begun = client.post("/api/sessions", json={"size": 9}).json()
    server.page().post("/api/sessions", json={"size": 9})
    server.clock.skipped_ms += 48 * 3_600_000
    boards = server.services.page_boards
    assert server.on_loop(boards.delete_unplayed()) == 0
    assert client.get(f"/api/sessions/{begun['session']}").status_code == 200


def test_boards_that_are_in_use_do_not_keep_later_ones_from_being_deleted(tmp_path):
    with closing(Store(tmp_path / "playground.db")) as store:
        for number in range(7):
            store.add_session(SessionRow(f"s{number}", None, "human", None, "follow", 8.0, number))
            open_episode(store, f"s{number}", number)
        deleted, after, in_use = [], 0, {"s0", "s1", "s3"}
        while after is not None:
            sessions, _, after = delete_unplayed(store, LATER, in_use.__contains__, after, most=2)
            deleted += sessions
        assert deleted == ["s2", "s4", "s5"], "s6 is the newest of all"


def test_a_look_for_them_is_as_short_beside_many_episodes_that_have_ended(tmp_path):
    """All moves wait for it, once a minute."""

    def steps_of_a_look(store):
        steps = itertools.count()
        store.connection.set_progress_handler(lambda: next(steps) < 0, 1)
        assert delete_unplayed(store, LATER, lambda _: False) == ([], [], None)
        store.connection.set_progress_handler(None, 1)
        return next(steps)

    with closing(Store(tmp_path / "playground.db")) as store:
        play(store, 0)
        once = steps_of_a_look(store)
        for seed in range(1, 60):
            play(store, seed)
        assert steps_of_a_look(store) < 2 * once


def test_a_running_server_deletes_them_by_itself(serve, tmp_path):
    server = serve(limits=Limits(unplayed_h=0.0001), abandon_after_s=1.0, idle_s=0.2)
    session = server.page().post("/api/sessions", json={"size": 9}).json()["session"]
    server.page().post("/api/sessions", json={"size": 9})  # the newest of all stays
    eventually(lambda: session not in ids(tmp_path / "playground.db"))


def test_what_was_left_for_a_day_is_closed_but_in_a_study(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    server = serve()
    person = Person(server, client=server.client())
    person.to_tutorial()
    person.call("next")
    with person.socket() as socket:
        socket.act(socket.receive("frame"), "south", input="key")
        socket.frame_after(0)
    client, scripts = server.page(), server.client()
    moved = client.post("/api/sessions", json={"size": 9, "seed": 5}).json()
    toucher = server.page()
    touched = toucher.post("/api/sessions", json={"size": 9, "seed": 5}).json()
    with server.socket(touched["session"], toucher) as socket:
        focus = {"kind": "focus", "client_ms": 1.0}
        episode = touched["frame"]["episode"]
        batch = {"batch": "one-batch", **LOAD, "events": [focus]}
        socket.send({"kind": "events", "episode": episode, **batch})
        assert socket.receive("kept")["count"] == 1
    script = scripts.post("/api/sessions", json={"size": 9, "seed": 5}).json()
    for begun, by in ((moved, client), (script, scripts)):
        act = {"episode": begun["frame"]["episode"], "step": 0, "action": "south"}
        assert by.post(f"/api/sessions/{begun['session']}/act", json=act).status_code == 200
    boards = server.services.page_boards

    def outcomes():
        sql = "SELECT id, outcome FROM episodes WHERE outcome IS NOT NULL"
        return dict(ask(tmp_path / "playground.db", sql))

    server.clock.skipped_ms += (DAY_H - 1) * 3_600_000
    server.on_loop(boards.abandon_left())
    assert outcomes() == {}
    server.clock.skipped_ms += 2 * 3_600_000
    server.on_loop(boards.abandon_left())
    left = {board["frame"]["episode"]: "abandoned" for board in (moved, touched, script)}
    assert outcomes() == left
