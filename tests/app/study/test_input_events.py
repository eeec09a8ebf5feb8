"""Input events of a study: each batch is answered, and stored once."""

import hashlib
import json
import sqlite3

import pytest

from humanplay.db import input_events
from humanplay.study.folder import Folder, StudyError
from humanplay.study.verification import verify_database
from tests.support.page_loads import LOAD, STORED_LOAD
from tests.support.recorded import ask
from tests.support.study import Person, freeze

PRESS = {
    "kind": "keydown",
    "code": "ArrowUp",
    "repeat": False,
    "trusted": True,
    "client_ms": 12.3,
    "step": 0,
}
BATCH = [
    PRESS,
    {"kind": "blur", "client_ms": 13},
    {"kind": "keyup", "code": "ArrowUp", "client_ms": 14.5, "round_trip_ms": 3},
]
NEXT = [{**PRESS, "client_ms": 20.1}]


@pytest.fixture(autouse=True)
def study(tmp_path):
    return freeze(tmp_path / "playground.db-studies")


@pytest.fixture
def person(server):
    return at_a_board(server)


def at_a_board(server):
    person = Person(server)
    person.to_warm_up()
    person.call("next")
    return person


def send_events(socket, episode, events, batch=None, load=LOAD):
    """Send a batch, and return (count, reason) of the answer.

    Without an ID it is named by its content.
    """
    batch = batch or hashlib.sha256(json.dumps(events).encode()).hexdigest()
    message = {"kind": "events", "episode": episode, "batch": batch, **load, "events": events}
    socket.send(message)
    answer = socket.receive("kept")
    assert answer["episode"] == episode
    return answer["count"], answer["reason"]


def kept(tmp_path):
    """Episode -> (number, kind, client_ms) of each stored event.

    No row has lost its digest.
    """
    path = tmp_path / "playground.db"
    assert verify_database(path).findings == ()
    return ask(path, "SELECT number, kind, client_ms FROM input_events ORDER BY episode_id, number")


ONCE = [(0, "keydown", 12.3), (1, "blur", 13.0), (2, "keyup", 14.5)]


def test_each_batch_is_answered_with_how_many_are_kept(person, tmp_path):
    episode = person.frame["episode"]
    with person.socket() as socket:
        assert send_events(socket, episode, BATCH) == (3, None)
        assert send_events(socket, episode, []) == (0, None)
        assert send_events(socket, episode, NEXT) == (1, None)
    assert kept(tmp_path) == [*ONCE, (3, "keydown", 20.1)]
    sql = "SELECT code, repeat, trusted, step, round_trip_ms, server_ms > 0 FROM input_events ORDER BY number"
    assert ask(tmp_path / "playground.db", sql)[:3] == [
        ("ArrowUp", 0, 1, 0, None, 1),
        (*[None] * 5, 1),
        ("ArrowUp", None, None, None, 3.0, 1),
    ]


def test_a_key_that_neither_the_standard_nor_the_participant_names_is_kept_as_unidentified(
    person, tmp_path
):
    person.call("settings", {"keys": {"north": ["Odd1"], "south": ["KeyS"]}})
    codes = ["x" * 60, "Odd1", "F24", "NumpadHash", "", "west", "OSLeft"]
    with person.socket() as socket:
        send_events(socket, person.frame["episode"], [{**PRESS, "code": code} for code in codes])
    sql = "SELECT code FROM input_events ORDER BY number"
    stored = [code for (code,) in ask(tmp_path / "playground.db", sql)]
    odd = "Unidentified"
    assert stored == [odd, "Odd1", "F24", "NumpadHash", odd, "west", odd]


def test_a_batch_sent_again_is_kept_once_whatever_came_between(person, tmp_path):
    episode = person.frame["episode"]
    with person.socket() as socket, person.socket() as other_tab:
        assert send_events(socket, episode, BATCH) == (3, None)
        assert send_events(socket, episode, BATCH) == (3, None)
        assert send_events(other_tab, episode, NEXT) == (1, None)
        assert send_events(other_tab, episode, BATCH) == (3, None)
        assert send_events(socket, episode, NEXT) == (1, None)
    assert kept(tmp_path) == [*ONCE, (3, "keydown", 20.1)]


def test_a_batch_is_known_by_its_id_whatever_is_in_it(person, tmp_path):
    episode = person.frame["episode"]
    with person.socket() as socket:
        assert send_events(socket, episode, BATCH, batch="first-batch") == (3, None)
        assert send_events(socket, episode, BATCH, batch="second-batch") == (3, None)
        assert send_events(socket, episode, BATCH, batch="first-batch") == (3, None)
    assert len(kept(tmp_path)) == 6


def test_a_batch_takes_no_more_work_among_forty_thousand_nearly_equal_events(server, person):
    """Instructions of SQLite's own machine, which are the same on every run."""
    episode, store = person.frame["episode"], server.services.store
    work = []

    def add(number):
        counted = [0]
        store.connection.set_progress_handler(lambda: counted.__setitem__(0, counted[0] + 1), 100)
        row = input_events.InputEventRow("keydown", "ArrowUp", False, True, 12.3, 0, None)
        batch = [row] * 199 + [row._replace(step=number)]
        input_events.add_input_events(store, episode, batch, 1, f"batch-{number}", STORED_LOAD)
        work.append(counted[0])

    def add_all():
        with store.transaction():
            for number in range(200):
                add(number)
        store.connection.set_progress_handler(None, 0)

    server.on_loop(store.write(add_all))
    assert work[-1] < 2 * work[0], work[:: len(work) // 5]


def test_of_an_ended_episode_only_the_ids_of_its_newest_batches_are_kept(person, tmp_path):
    """A page repeats what it has not seen kept, which is its newest."""
    episode = person.frame["episode"]
    batches = [[{**PRESS, "client_ms": 20.0 + number}] for number in range(30)]
    with person.socket() as socket:
        for batch in batches:
            assert send_events(socket, episode, batch) == (1, None)
    person.play(input=None)
    person.call("next")
    count = "SELECT count(*) FROM event_batches WHERE episode_id = ?"
    assert ask(tmp_path / "playground.db", count, episode) == [(4,)]
    late = [[{**PRESS, "client_ms": 60.0 + number}] for number in range(5)]
    with person.socket() as socket:
        for batch in (*batches[-4:], *late, *late[-4:]):
            assert send_events(socket, episode, batch) == (1, None)
    assert len(kept(tmp_path)) == 35
    assert ask(tmp_path / "playground.db", count, episode) == [(4,)]


def test_the_same_events_of_another_episode_are_kept_too(person, tmp_path):
    first = person.frame["episode"]
    person.play(input=None)
    person.call("next")
    with person.socket() as socket:
        assert send_events(socket, first, BATCH) == (3, None)
        assert send_events(socket, person.frame["episode"], BATCH) == (3, None)
    assert len(kept(tmp_path)) == 6


def test_a_batch_whose_answer_a_kill_swallowed_is_kept_once(spawn, tmp_path):
    server = spawn()
    person = at_a_board(server)
    episode = person.frame["episode"]
    with person.socket() as socket:
        assert send_events(socket, episode, BATCH) == (3, None)
        server.kill()
    server = spawn()
    again = Person(server, client=server.client(cookies=dict(person.client.cookies)), joins=False)
    again.me()
    with again.socket() as socket:
        assert send_events(socket, episode, BATCH) == (3, None)
        assert send_events(socket, episode, NEXT) == (1, None)
    server.kill()
    assert kept(tmp_path) == [*ONCE, (3, "keydown", 20.1)]


def test_what_is_not_kept_is_answered_with_the_reason(server, person, tmp_path, monkeypatch):
    other = at_a_board(server)
    begun = person.client.post("/api/sessions").json()
    with server.socket(begun["session"], person.client) as socket:
        count, reason = send_events(socket, begun["frame"]["episode"], BATCH)
        assert (count, "every move is a script's" in reason) == (0, True)
    with person.socket() as socket:
        count, reason = send_events(socket, other.frame["episode"], BATCH)
        assert (count, "none of this participant's" in reason) == (0, True)
        monkeypatch.setattr(input_events, "MAX_EVENTS_PER_EPISODE", 4)
        assert send_events(socket, person.frame["episode"], BATCH) == (3, None)
        count, reason = send_events(socket, person.frame["episode"], [*NEXT, *NEXT])
        assert (count, "more input events than are kept" in reason) == (0, True)
        assert send_events(socket, person.frame["episode"], NEXT) == (1, None)
        assert send_events(socket, person.frame["episode"], BATCH) == (3, None), (
            "there is always room for what is kept already"
        )
        Folder(tmp_path / "playground.db-studies").close("small")
        count, reason = send_events(socket, person.frame["episode"], BATCH)
        assert (count, "is closed" in reason) == (0, True)
    assert kept(tmp_path) == [*ONCE, (3, "keydown", 20.1)]


def test_what_cannot_be_kept_now_is_answered_without_a_reason(
    server, person, tmp_path, monkeypatch
):
    episode = person.frame["episode"]

    def fail(*_):
        raise sqlite3.OperationalError("database or disk is full")

    def thaw(*_):
        raise StudyError("protocol.json was changed after the study was frozen")

    with person.socket() as socket:
        for patched, failure in (
            ("humanplay.db.chain.append_late_events", fail),
            ("humanplay.study.folder.Folder.study", thaw),
        ):
            with monkeypatch.context() as patch:
                patch.setattr(patched, failure)
                assert send_events(socket, episode, BATCH) == (0, None)
        assert kept(tmp_path) == []
        assert send_events(socket, episode, BATCH) == (3, None)
    assert kept(tmp_path) == ONCE


def test_a_malformed_batch_is_an_error(person, tmp_path):
    malformed = {
        "events must hold at most 200, got 201": [PRESS] * 201,
        "kind must be": [{**PRESS, "kind": "wink"}],
        "client_ms is missing": [{"kind": "keydown"}],
        "unknown field 'mood'": [{**PRESS, "mood": 1}],
    }
    with person.socket() as socket:
        message = {
            "kind": "events",
            "episode": person.frame["episode"],
            "batch": "a-batch-id",
            **LOAD,
        }
        for detail, events in malformed.items():
            socket.send({**message, "events": events})
            assert detail in socket.receive("error")["detail"]
        for name in ("page_load", "tab"):
            for detail, drawn in (
                (f'{name} must be at least 8 characters long, got "short"', "short"),
                (f"{name} must be at most 64 characters long", "x" * 65),
                (f"{name} must be text, got 7", 7),
                ("an id must be without control characters", "a-load\n-id"),
            ):
                socket.send({**message, "events": [PRESS], name: drawn})
                assert detail in socket.receive("error")["detail"]
            socket.send({key: message[key] for key in message if key != name} | {"events": [PRESS]})
            assert f"{name} is missing" in socket.receive("error")["detail"]
    assert kept(tmp_path) == []


def test_events_say_which_load_of_the_page_in_which_tab_they_come_from(
    person, tmp_path, monkeypatch
):
    episode = person.frame["episode"]
    loads = [
        {"page_load": f"page-load-{load}", "tab": f"browser-tab-{tab}"}
        for load, tab in ((1, 1), (2, 1), (3, 2), (1, 1))
    ]
    with person.socket() as socket:
        for number, load in enumerate(loads):
            event = {**PRESS, "client_ms": 20.0 + number}
            assert send_events(socket, episode, [event], load=load) == (1, None)
        monkeypatch.setattr(input_events, "MAX_PAGE_LOADS", 3)
        another = {"page_load": "page-load-4", "tab": "browser-tab-1"}
        count, reason = send_events(socket, episode, NEXT, load=another)
        assert (count, "of 3 loads of its page, the most that are kept" in reason) == (0, True)
        assert send_events(socket, episode, NEXT, load=loads[1]) == (1, None)
    sql = "SELECT tab, page_load FROM input_events ORDER BY number"
    assert ask(tmp_path / "playground.db", sql) == [(0, 0), (0, 1), (1, 2), (0, 0), (0, 1)]
    sql = "SELECT number, tab, load_id FROM page_loads ORDER BY number"
    assert ask(tmp_path / "playground.db", sql) == [
        (0, 0, "page-load-1"),
        (1, 0, "page-load-2"),
        (2, 1, "page-load-3"),
    ]
    assert verify_database(tmp_path / "playground.db").findings == ()
