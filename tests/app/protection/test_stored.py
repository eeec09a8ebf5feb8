"""Bytes that are stored for an address, a player and a study: what begins is refused, what is open goes on."""

import shutil
import sqlite3
from contextlib import closing

import pytest

from app.web.settings import Limits
from tests.support.study import Person, freeze

PRESS = {"kind": "keydown", "code": "ArrowUp", "repeat": False, "trusted": True, "step": 0}


def percent(size):
    """The limit that lets so many bytes be stored."""
    return 100 * size / shutil.disk_usage("/tmp").total


def begin(client, **wanted):
    return client.post("/api/sessions", json={"size": 9, "seed": 5, **wanted})


def send_events(socket, episode, batches):
    for number in range(batches):
        events = [{**PRESS, "client_ms": 10 * number + each / 10} for each in range(100)]
        batch = f"batch-{number:06}"
        socket.send({"kind": "events", "episode": episode, "batch": batch, "events": events})
        assert socket.receive("kept")["count"] == 100


def test_a_full_budget_refuses_what_begins_and_no_move_or_key_event_of_what_is_open(serve):
    server = serve(limits=Limits(stored_address_percent=percent(20_000)))
    client = server.page()
    board = begin(client).json()
    with server.socket(board["session"], client) as socket:
        frame = socket.receive("frame")
        send_events(socket, frame["episode"], 3)
        for answer in (begin(client), begin(server.client()), client.post("/api/daily")):
            assert answer.status_code == 429
            assert 0 < int(answer.headers["retry-after"]) <= 86_400
            said = "this network has stored 0.02 MB today, all that it may: what is open goes on"
            assert said in answer.json()["detail"]
        path = f"/api/sessions/{board['session']}/episodes"
        assert client.post(path).status_code == 429
        send_events(socket, frame["episode"], 1)
        socket.act(frame, "south", input="key")
        assert socket.frame_after(0)["step"] == 1
    assert server.protection.refusals["stored"] == 4


def test_a_player_has_a_budget_of_their_own(serve):
    server = serve(limits=Limits(stored_player_percent=percent(1000)))
    client = server.client()
    assert [begin(client).status_code for _ in range(3)] == [201, 201, 429]
    assert begin(server.client()).status_code == 201


def test_a_class_of_a_hundred_participants_plays_on_where_their_address_has_spent_its_budget(
    serve, tmp_path
):
    freeze(tmp_path / "studies")
    server = serve(limits=Limits(stored_address_percent=percent(1)))
    assert [begin(server.client()).status_code for _ in range(2)] == [201, 429]
    for _ in range(100):
        person = Person(server, client=server.client())
        person.to_tutorial()
        person.call("next")
        with person.socket() as socket:
            socket.act(socket.receive("frame"), "south", input="key")
            assert socket.frame_after(0)["step"] == 1
    assert server.protection.refusals == {"stored": 1}


def test_a_study_has_a_budget_of_its_own(serve, tmp_path):
    freeze(tmp_path / "studies")
    server = serve(limits=Limits(stored_study_percent=percent(1000)))
    person = Person(server, client=server.client())
    person.to_warm_up()
    assert "this study has stored" in person.refused("next", status=429)
    assert begin(server.client()).status_code == 201


def test_nothing_begins_below_the_threshold_of_free_disk_and_moves_go_on(serve, monkeypatch):
    server = serve(limits=Limits(free_mb=100))
    client = server.page()
    board = begin(client).json()
    full = shutil.disk_usage("/tmp")._replace(free=99_999_999)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: full)
    answer = begin(client)
    assert answer.status_code == 507
    assert "the server's disk has less than 100 MB left" in answer.json()["detail"]
    with server.socket(board["session"], client) as socket:
        socket.act(socket.receive("frame"), "south", input="key")
        assert socket.frame_after(0)["step"] == 1


@pytest.mark.parametrize("what", ["boards", "large boards", "moves", "events"])
def test_what_is_counted_is_what_the_file_grows_by(serve, tmp_path, what):
    server = serve()
    client = server.page()

    def size():
        server.execute("SELECT 1")
        with closing(sqlite3.connect(tmp_path / "playground.db")) as db:
            ((pages,),) = db.execute("SELECT sum(pgsize) FROM dbstat").fetchall()
        return pages

    board = begin(client, size=21).json()
    stored = server.protection.stored.today()
    with server.socket(board["session"], client) as socket:
        frame = socket.receive("frame")
        before, counted = size(), max(stored.values())
        if what == "events":
            send_events(socket, frame["episode"], 40)
        elif what == "moves":
            for step in range(400):
                action = "east" if step % 2 == 0 else "west"
                act = {"episode": frame["episode"], "step": step, "action": action}
                path = f"/api/sessions/{board['session']}/act"
                assert client.post(path, json=act).status_code == 200
        else:
            side = 128 if what == "large boards" else 9
            for _ in range(60):
                one = server.client()
                board = begin(one, size=side).json()
                frame = board["frame"]
                act = {"episode": frame["episode"], "step": 0, "action": "south"}
                one.post(f"/api/sessions/{board['session']}/act", json=act)
    grown, counted = size() - before, max(stored.values()) - counted
    print(f"{what}: grown {grown}, counted {counted}")
    assert 0.7 * grown < counted < 1.5 * grown
