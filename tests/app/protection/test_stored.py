"""Stored bytes of an address, a player and a study: only new boards are refused.

An open board is charged what it can store, so that whatever is open never comes to more than the budget.
"""

import itertools
import shutil
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from humanplay.board.charges import LEAST_EVENTS
from humanplay.db.input_events import EVENT_BYTES
from humanplay.web.protection.limits import ASKER, Asker, BudgetedCharges
from humanplay.web.settings import Limits
from tests.support.page_loads import LOAD
from tests.support.recorded import ask
from tests.support.study import Person, freeze

PRESS = {"kind": "keydown", "code": "ArrowUp", "repeat": False, "trusted": True, "step": 0}


def percent(size):
    """The limit that lets so many bytes be stored."""
    return 100 * size / shutil.disk_usage(tempfile.gettempdir()).total


def begin(client, **wanted):
    return client.post("/api/sessions", json={"size": 9, "seed": 5, **wanted})


def send_batch(socket, episode, number, size):
    """How many of a batch of input events are kept."""
    events = [{**PRESS, "client_ms": 20 * number + place / 10} for place in range(size)]
    batch = f"batch-{number:06}"
    socket.send({"kind": "events", "episode": episode, "batch": batch, **LOAD, "events": events})
    return socket.receive("kept")["count"]


def send_events(socket, episode, batches):
    for number in range(batches):
        assert send_batch(socket, episode, number, 100) == 100


def fill(server, client, session, episode, first=0, most=80):
    """Send batches of 200 input events until one is refused; return their number."""
    with server.socket(session, client) as socket:
        sent = range(first, first + most)
        return next((at - first for at in sent if not send_batch(socket, episode, at, 200)), most)


def crash(server, client, session):
    """Move south until the episode ends, and return its id."""
    with server.socket(session, client) as socket:
        frame = socket.receive("frame")
        while frame["outcome"] is None:
            socket.act(frame, "south")
            frame = socket.frame_after(frame["step"])
    return frame["episode"]


def file_bytes(server):
    """The size of the database but for its free pages."""
    server.execute("SELECT 1")
    return ask(server.services.store.path, "SELECT sum(pgsize) FROM dbstat")[0][0]


def disk_of(monkeypatch, total):
    """Let the disk seem so large; half of it is free."""
    seen = shutil.disk_usage(tempfile.gettempdir())._replace(total=total, free=total // 2)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: seen)


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
            assert (
                "this network may store 0.02 MB a day, and all of it was" in answer.json()["detail"]
            )
        path = f"/api/sessions/{board['session']}/episodes"
        assert client.post(path).status_code == 429
        assert send_batch(socket, frame["episode"], 4, 100) == 100
        socket.act(frame, "south", input="key")
        assert socket.frame_after(0)["step"] == 1
    assert server.protection.refusals["stored"] == 4


def test_metrics_are_read_on_their_own_thread_while_bytes_are_counted(tmp_path):
    charges, until = BudgetedCharges(Limits(), tmp_path / "play.db"), time.monotonic() + 1
    asked = []
    app = SimpleNamespace(state=SimpleNamespace(cookies=""))

    def read():
        while time.monotonic() < until:
            asked.append(charges.most("address"))

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(1) as metrics:
            reading = metrics.submit(read)
            for number in itertools.takewhile(
                lambda _: time.monotonic() < until, itertools.count()
            ):
                client = f"10.0.{number // 250 % 250}.{number % 250}", 1
                scope = {"type": "http", "headers": [], "client": client, "app": app}
                ASKER.set(Asker(scope, True))
                charges.open(str(number), "", 9)
                if number >= 300:
                    charges.close(str(number - 300), 5)
            reading.result()
    finally:
        sys.setswitchinterval(interval)
        ASKER.set(None)
    assert max(asked) >= 9


def test_a_player_has_a_budget_of_their_own(serve):
    server = serve(limits=Limits(stored_player_percent=percent(1000)))
    client = server.client()
    assert [begin(client).status_code for _ in range(3)] == [201, 201, 429]
    assert begin(server.client()).status_code == 201


def test_short_episodes_count_until_midnight_and_are_refused_at_their_cookies_budget(
    serve, monkeypatch
):
    """An open one is charged far more; an ended one, what it has stored."""
    fast = "100000+100000/s"
    rates = dict.fromkeys(("episodes_per_address", "episodes_per_player", "messages"), fast)
    server = serve(limits=Limits(stored_player_percent=percent(1_500_000), **rates))
    client = server.page()
    session = begin(client).json()["session"]
    began = 1
    while (answer := client.post(f"/api/sessions/{session}/episodes")).status_code == 201:
        frame = answer.json()["frame"]
        act = {"episode": frame["episode"], "step": 0, "action": "south"}
        client.post(f"/api/sessions/{session}/act", json=act)
        began += 1
        assert began < 2_000
    assert "this browser may store 1.5 MB a day" in answer.json()["detail"]
    assert began > 200
    tomorrow = time.time() + 86_400
    monkeypatch.setattr(time, "time", lambda: tomorrow)
    assert client.post(f"/api/sessions/{session}/episodes").status_code == 201


def test_a_class_of_participants_plays_on_where_their_address_has_spent_its_budget(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    server = serve(limits=Limits(stored_address_percent=percent(1)))
    assert [begin(server.client()).status_code for _ in range(2)] == [201, 429]
    for _ in range(20):
        person = Person(server, client=server.client())
        person.to_tutorial()
        person.call("next")
        with person.socket() as socket:
            socket.act(socket.receive("frame"), "south", input="key")
            assert socket.frame_after(0)["step"] == 1
    assert server.protection.refusals == {"stored": 1}


def test_a_study_has_a_budget_of_its_own(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    server = serve(limits=Limits(stored_study_percent=percent(1000)))
    person = Person(server, client=server.client())
    person.to_warm_up()
    assert "this study may store" in person.refused("next", status=429)
    assert begin(server.client()).status_code == 201


def test_nothing_begins_below_the_threshold_of_free_disk_and_moves_go_on(serve, monkeypatch):
    server = serve(limits=Limits(free_mb=100))
    client = server.page()
    board = begin(client).json()
    full = shutil.disk_usage(tempfile.gettempdir())._replace(free=99_999_999)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: full)
    answer = begin(client)
    assert answer.status_code == 507
    assert "the server's disk has less than 100 MB left" in answer.json()["detail"]
    with server.socket(board["session"], client) as socket:
        socket.act(socket.receive("frame"), "south", input="key")
        assert socket.frame_after(0)["step"] == 1


def test_boards_that_are_filled_from_one_address_store_a_hundredth_of_the_disk_a_day_at_most(
    serve, monkeypatch
):
    disk = 400_000_000
    disk_of(monkeypatch, disk)
    server = serve(limits=Limits(free_mb=0, messages="100000+1000/s"))
    before, boards = file_bytes(server), []
    for round_ in range(2):
        for _ in range(12):  # as many as may begin, each with a browser of its own
            if (answer := begin(client := server.page())).status_code == 201:
                boards.append((client, answer.json()["session"], answer.json()["frame"]["episode"]))
        for client, session, episode in boards:
            fill(server, client, session, episode, 1000 * round_)
        for client, session, episode in boards:
            crash(server, client, session)
            fill(server, client, session, episode, 1000 * round_ + 500)
            client.post(f"/api/sessions/{session}/episodes")
    grown, counted = file_bytes(server) - before, max(server.protection.charges.today().values())
    one = 2000 + 81 * 85 + LEAST_EVENTS * EVENT_BYTES
    print(f"{len(boards)} boards, grown {grown}, counted {counted}, allowed {disk // 100}")
    assert 0.004 * disk < counted <= 0.005 * disk + one
    assert grown <= 0.01 * disk
    assert server.protection.charges.largest(1)[0]["bytes"] >= counted


def test_what_an_open_board_can_store_stays_charged_over_midnight_until_it_ends(serve, monkeypatch):
    budget = 1_000_000
    server = serve(limits=Limits(stored_address_percent=percent(budget)))
    boards = []
    for _ in range(2):
        client = server.page()
        boards.append((client, begin(client).json()))
    assert begin(server.page()).status_code == 429
    tomorrow = time.time() + 86_400
    monkeypatch.setattr(time, "time", lambda: tomorrow)
    assert begin(server.page()).status_code == 429
    for client, board in boards:
        episode = crash(server, client, board["session"])
        assert fill(server, client, board["session"], episode, most=2) == 2, "it counts by itself"
    assert begin(server.page()).status_code == 201


def test_an_episode_keeps_as_many_events_as_it_has_room_for_and_every_move(serve):
    server = serve()
    client = server.page()
    board = begin(client).json()
    episode = board["frame"]["episode"]
    stored_events = 200 * fill(server, client, board["session"], episode)
    assert 0.95 * LEAST_EVENTS < stored_events <= LEAST_EVENTS
    with server.socket(board["session"], client) as socket:
        frame = socket.receive("frame")
        for step in range(40):
            socket.act(frame, "east" if step % 2 else "west")
            frame = socket.frame_after(step)
            if frame["outcome"] is not None:
                break
        assert frame["step"] == step + 1


def test_an_open_episode_is_charged_again_after_a_restart(serve):
    limits = Limits(stored_address_percent=percent(20_000))
    server = serve(limits=limits)
    client = server.page()
    board = begin(client).json()
    server.stop()
    again = serve(limits=limits)
    page = again.page(cookies=client.cookies)
    assert again.protection.charges.today() == {}
    with again.socket(board["session"], page) as socket:
        frame = socket.receive("frame")
        assert send_batch(socket, board["frame"]["episode"], 0, 100) == 100
        assert begin(again.page()).status_code == 429
        socket.act(frame, "south", input="key")
        assert socket.frame_after(0)["step"] == 1


@pytest.mark.parametrize("load", ["boards", "large boards", "moves", "events"])
def test_what_is_counted_is_what_the_file_grows_by(serve, load):
    server = serve()
    client, before = server.page(), file_bytes(server)
    sides = {"large boards": 128, "moves": 42}
    for number in range(60 if "boards" in load else 1):
        client = server.client() if number else client
        board = begin(client, size=sides.get(load, 21)).json()
        episode, steps = board["frame"]["episode"], 1200 if load == "moves" else 0
        with server.socket(board["session"], client) as socket:
            socket.receive("frame")
            if load == "events":
                send_events(socket, episode, 40)
        for step in range(steps + 1):  # it ends by leaving the grid
            action = "north" if step == steps else ("east", "west")[step % 2]
            act = {"episode": episode, "step": step, "action": action}
            path = f"/api/sessions/{board['session']}/act"
            assert client.post(path, json=act).status_code == 200
    grown, counted = file_bytes(server) - before, max(server.protection.charges.today().values())
    print(f"{load}: grown {grown}, counted {counted}")
    assert 0.7 * grown < counted < 1.5 * grown
