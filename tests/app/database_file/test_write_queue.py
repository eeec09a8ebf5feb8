"""The event loop never waits for SQLite: only moves wait, and say why."""

import asyncio
import json
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from functools import partial

import numpy as np
import pytest

from humanplay.board import attestation
from humanplay.board.messages import encode_error
from humanplay.db import store as writer
from humanplay.db.store import (
    BROKEN,
    FULL,
    LOCKED,
    MAX_WAITING,
    SLOW,
    WAITS,
    StepRow,
    Store,
    StoreError,
    WriteQueue,
)
from tests.support.keyboard import press
from tests.support.recorded import NOW, add_session, open_episode
from tests.support.servers import eventually
from tests.support.write_lock import locked_elsewhere

COMMIT_S = 0.25
"""Seconds that a commit takes on the slow disk of these tests."""


def delay_commits(server, seconds):
    """Delay each commit of a server, as a slow disk does, with the interpreter free.

    Return a list that grows by each commit.
    """
    store, commits = server.services.store, []

    def wait(statement):
        if statement == "COMMIT":
            commits.append(statement)
            time.sleep(seconds)

    server.on_loop(
        store.write(lambda: store._own_db.conn.set_trace_callback(wait if seconds else None))
    )
    return commits


def waits_ms(client, paths, seconds):
    """Return the time that each of some seconds' requests took."""
    waits, began = [], time.monotonic()
    while time.monotonic() - began < seconds:
        for path in paths:
            asked = time.perf_counter()
            assert client.get(path).status_code == 200
            waits.append(1000 * (time.perf_counter() - asked))
        time.sleep(0.01)
    return waits


def begin(client, seed=5):
    return (
        client.post("/api/sessions", json={"size": [9, 13], "seed": seed}).raise_for_status().json()
    )


def act(client, begun, step):
    wanted = {
        "episode": begun["frame"]["episode"],
        "step": step,
        "action": ("south", "north")[step % 2],
    }
    return client.post(f"/api/sessions/{begun['session']}/act", json=wanted)


@pytest.mark.parametrize("held_s", [1.3, pytest.param(10, marks=pytest.mark.long)])
def test_a_locked_database_delays_moves_alone_and_its_player_knows_why(serve, tmp_path, held_s):
    server = serve()
    path, client, other = tmp_path / "playground.db", server.client(), server.client()
    begun = begin(client)
    drives = client.post(
        "/api/sessions", json={"size": [9, 13], "player": "frontier-cost", "seed": 6}
    ).json()["session"]
    client.post(f"/api/sessions/{drives}/pace", json={"moves_per_second": 1}).raise_for_status()
    paths = ["/", "/api/levels", f"/api/sessions/{begun['session']}", "/api/episodes"]
    with server.socket(begun["session"], client) as socket, ThreadPoolExecutor(1) as pool:
        frame = socket.receive("frame")
        socket.receive("history")
        before = waits_ms(other, paths, min(held_s, 3))
        with locked_elsewhere(path):
            for step, action in enumerate(["south", "north", "south"]):
                socket.act({**frame, "step": step}, action)
            begins = pool.submit(client.post, "/api/sessions", json={"size": [9, 13], "seed": 7})
            during = waits_ms(other, paths, held_s)
            assert socket.receive() == json.loads(encode_error(WAITS))
            assert not begins.done()
            assert client.get(f"/api/sessions/{begun['session']}").json() == frame, (
                "no frame before its step is committed"
            )
        assert socket.frame_after(2)["step"] == 3
        assert begins.result().status_code == 201
    actions = [step["action"] for step in server.services.store.steps(frame["episode"])]
    assert actions == [2, 0, 2]
    driven = client.get(f"/api/sessions/{drives}").json()
    eventually(lambda: client.get(f"/api/sessions/{drives}").json()["step"] > driven["step"])
    p99, p99_before = np.percentile(during, 99), np.percentile(before, 99)
    print(
        f"\n{held_s} s locked: answers to others p99 {p99:.1f} ms, slowest {max(during):.1f}; before p99 {p99_before:.1f}"
    )
    assert max(during) < 1000, "SQLite's own wait would be 5 seconds"
    assert np.median(during) < 3 * np.median(before) + 5


@pytest.mark.parametrize("seconds", [2, pytest.param(10, marks=pytest.mark.long)])
def test_a_disk_that_answers_slowly_delays_moves_alone(serve, seconds):
    """Others' pages, requests and sockets are answered as before."""
    server = serve()
    client, other = server.client(), server.client()
    begun, still = begin(client), begin(other, 6)
    paths = [
        "/",
        "/healthz",
        "/api/levels",
        f"/api/sessions/{still['session']}",
        "/api/episodes",
        "/api/me/session",
    ]
    stop = threading.Event()

    def play(step=0):
        while not stop.is_set():
            assert act(client, begun, step).status_code == 200
            step += 1
        return step

    with ThreadPoolExecutor(1) as pool:
        before = waits_ms(other, paths, seconds)
        delay_commits(server, COMMIT_S)
        moves = pool.submit(play)
        during = waits_ms(other, paths, seconds)
        with server.socket(still["session"], other) as socket:
            assert socket.receive("frame") == still["frame"]
            asked = time.perf_counter()
            socket.connection.ping().wait(10)
            during.append(1000 * (time.perf_counter() - asked))
        stop.set()
        assert 1 <= moves.result() <= (seconds + 5) / COMMIT_S
    delay_commits(server, 0)
    p99, p99_before = np.percentile(during, 99), np.percentile(before, 99)
    print(
        f"\ncommits of {1000 * COMMIT_S:.0f} ms: answers to others p99 {p99:.1f} ms; before p99 {p99_before:.1f} ms"
    )
    assert np.median(during) < 3 * np.median(before) + 5
    assert p99 < 2 * p99_before + 1000 * COMMIT_S / 2, "nobody waited for a commit"


def test_a_player_hears_of_a_slow_disk_and_no_frame_comes_before_its_commit(serve):
    server = serve()
    client = server.client()
    begun = begin(client)
    delay_commits(server, 1.5)
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        socket.receive("history")
        socket.act(frame, "south")
        assert socket.receive() == json.loads(encode_error(SLOW))
        assert server.client().get(f"/api/sessions/{begun['session']}").json() == frame
        assert socket.receive("frame")["step"] == 1
    delay_commits(server, 0)


def test_a_synthetic_player_waits_for_a_slow_disk(serve):
    server = serve()
    client = server.client()
    begun = begin(client)
    delay_commits(server, 1.5)
    with server.socket(begun["session"], client) as socket:
        socket.act(socket.receive("frame"), "south")
        assert socket.frame_after(0)["step"] == 1
    delay_commits(server, 0)


def press_and_move(board, server, *move):
    server.clock.skipped_ms += 150
    press(board, *move, server.clock.page_ms())


def test_a_move_is_recorded_with_the_press_before_it_and_the_last_press_is_in_the_chain(
    serve, monkeypatch
):
    compare, compared = attestation.attest, []
    monkeypatch.setattr(writer, "GATHER_S", 1.0)
    monkeypatch.setattr(
        attestation, "attest", lambda *given: (compared.append(1), compare(*given))[1]
    )
    server = serve()
    client = server.page()
    begun = client.post("/api/sessions").json()
    with server.socket(begun["session"], client) as board:
        frame = board.receive("frame")
        board.receive("history")
        away = ("south", "ArrowDown") if frame["grid"][1][0] == "." else ("east", "ArrowRight")
        back = ("north", "ArrowUp") if away[0] == "south" else ("west", "ArrowLeft")
        commits = delay_commits(server, 0.1)
        for step, way in enumerate((away, back)):
            before = len(commits)
            press_and_move(board, server, frame["episode"], step, *way)
            answers = sorted((board.receive() for _ in range(2)), key=lambda answer: answer["kind"])
            assert [answer["kind"] for answer in answers] == ["frame", "kept"]
            assert (answers[0]["step"], answers[1]["count"]) == (step + 1, 1)
            assert len(commits) == before + 1
        press_and_move(board, server, frame["episode"], 2, "north", "ArrowUp")
        assert board.frame_after(2)["outcome"] == "out_of_bounds"
        delay_commits(server, 0)
    episode = client.get(f"/api/episodes/{frame['episode']}").json()
    assert (episode["counts"], episode["attestation"], episode["attestation_reason"]) == (
        True,
        "attested",
        None,
    )
    assert len(compared) == 1, "on a thread that reads, and not again on the one that writes"


def test_a_read_that_takes_long_delays_no_move(serve):
    """Half a second in SQLite for each of more reads than there are threads for them."""
    server = serve()
    store, client = server.services.store, server.client()
    begun, rest = (
        begin(client),
        "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT {}) SELECT max(i) FROM n",
    )
    began = time.perf_counter()
    store.connection.execute(rest.format(100_000)).fetchall()
    count = round(0.5 * 100_000 / (time.perf_counter() - began))

    def moves_ms(steps):
        waits = []
        for step in steps:
            asked = time.perf_counter()
            assert act(client, begun, step).status_code == 200
            waits.append(1000 * (time.perf_counter() - asked))
        return waits

    before = moves_ms(range(20))
    with ThreadPoolExecutor(6) as pool:
        reads = [
            pool.submit(
                server.on_loop,
                store.read(lambda: store.connection.execute(rest.format(count)).fetchall()),
            )
            for _ in range(6)
        ]
        during = moves_ms(range(20, 40))
        assert not all(read.done() for read in reads)
    print(
        f"\na move takes {np.median(before):.1f} ms, {np.median(during):.1f} beside long reads, at most {max(during):.1f}"
    )
    assert np.median(during) < 5 * np.median(before) + 50, (
        "a move that waits for a read takes 500 ms"
    )


def test_more_writes_than_may_wait_are_refused_and_nothing_of_them_is_kept(serve, monkeypatch):
    monkeypatch.setattr("humanplay.db.store.MAX_WAITING", 3)
    assert MAX_WAITING == 1000
    server = serve()
    boards = [begin(server.client(), seed) for seed in range(8)]
    delay_commits(server, 0.5)
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda begun: act(server.client(), begun, 0), boards))
    delay_commits(server, 0)
    refused = [answer.json()["detail"] for answer in answers if answer.status_code == 503]
    assert len(refused) >= 3
    assert set(refused) == {FULL}
    for begun, answer in zip(boards, answers, strict=True):
        steps = server.services.store.steps(begun["frame"]["episode"])
        assert len(steps) == (answer.status_code == 200)
        assert act(server.client(), begun, len(steps)).status_code == 200, (
            "each board goes on where it stands"
        )


def test_a_thread_that_has_failed_is_seen_and_no_move_is_made(serve):
    server = serve()
    client = server.client()
    begun = begin(client)
    with pytest.raises(StoreError, match="started anew"):
        server.on_loop(server.services.store.write(sys.exit))
    ready = client.get("/readyz")
    assert (ready.status_code, ready.json()["detail"]) == (503, BROKEN)
    assert client.get("/api/health").json()["detail"] == BROKEN
    refused = act(client, begun, 0)
    assert (refused.status_code, refused.json()["detail"]) == (503, BROKEN)
    assert client.get(f"/api/sessions/{begun['session']}").json() == begun["frame"]
    server.stop()
    assert act(serve().client(), begun, 0).status_code == 200, (
        "a server that is started anew goes on"
    )


def step_row(episode_id, step):
    """Return the row of a move; what it came to is checked elsewhere."""
    return StepRow(episode_id, step, 2, 1.0, 9, NOW, None, None, None, None, "human")


def with_threads(path, scenario):
    """Return what `scenario(store)` returns while the threads of a store are started."""

    async def whole():
        with closing(Store(path)) as store:
            episodes = [open_episode(store, add_session(store), seed)[0].id for seed in range(4)]
            store.start_threads()
            try:
                return await scenario(store, episodes)
            finally:
                await asyncio.to_thread(store.stop_threads)

    return asyncio.run(whole())


async def blocked(store):
    """Keep the writing thread busy; return the event that frees it, and its write."""
    busy, go_on = threading.Event(), threading.Event()
    waiting = asyncio.create_task(store.write(lambda: (busy.set(), go_on.wait(10))))
    await asyncio.to_thread(busy.wait, 10)
    return go_on, waiting


def test_writes_that_wait_are_committed_together_and_one_that_fails_fails_alone(tmp_path):
    commits, published = [], []

    async def scenario(store, episodes):
        store._own_db.conn.set_trace_callback(
            lambda sql: commits.append(sql) if sql in ("COMMIT", "ROLLBACK") else None
        )
        go_on, _ = await blocked(store)
        wanted = [
            (episodes[0], 0),
            (episodes[1], 0),
            (episodes[2], 7),
            (episodes[0], 1),
            (episodes[3], 0),
        ]
        writes = [
            asyncio.create_task(
                store.write(
                    partial(store.add_step, step_row(*move)),
                    then=lambda _, move=move: published.append(move),
                )
            )
            for move in wanted
        ]
        await asyncio.sleep(0.05)
        assert published == []
        go_on.set()
        results = await asyncio.gather(*writes, return_exceptions=True)
        assert [result is None for result in results] == [True, True, False, True, True]
        assert "step 7 is not the next" in str(results[2])
        assert published == [move for move in wanted if move[1] != 7], (
            "in the order in which they were asked for"
        )
        assert commits == ["COMMIT"]
        return [len(await store.read(lambda id_=episode: store.steps(id_))) for episode in episodes]

    assert with_threads(tmp_path / "a.db", scenario) == [2, 1, 0, 1]


def test_a_commit_that_fails_is_an_error_of_everybody_whose_write_was_in_it(tmp_path):
    async def scenario(store, episodes):
        go_on, _ = await blocked(store)
        writes = [
            asyncio.create_task(store.write(partial(store.add_step, step_row(episode, 0))))
            for episode in episodes
        ]
        await asyncio.sleep(0.05)
        (tmp_path / "a.db").rename(tmp_path / "elsewhere.db")
        go_on.set()
        results = await asyncio.gather(*writes, return_exceptions=True)
        (tmp_path / "elsewhere.db").rename(tmp_path / "a.db")
        assert all("deleted, moved or replaced" in str(result) for result in results)
        return [len(await store.read(lambda id_=episode: store.steps(id_))) for episode in episodes]

    assert with_threads(tmp_path / "a.db", scenario) == [0, 0, 0, 0]


def test_what_was_asked_for_is_written_before_the_thread_ends_and_whoever_has_gone_is_no_reason_not_to(
    tmp_path,
):
    followed = []

    async def scenario(store, episodes):
        go_on, _ = await blocked(store)
        writes = [
            asyncio.create_task(
                store.write(partial(store.add_step, step_row(episode, 0)), then=followed.append)
            )
            for episode in episodes
        ]
        await asyncio.sleep(0.05)
        writes[0].cancel()
        stopping = asyncio.create_task(asyncio.to_thread(store.stop_threads))
        await asyncio.sleep(0.05)
        with pytest.raises(StoreError, match="about to stop"):
            await store.write(lambda: None)
        go_on.set()
        await stopping
        await asyncio.gather(*writes[1:])
        return [len(store.steps(episode)) for episode in episodes]

    assert with_threads(tmp_path / "a.db", scenario) == [1, 1, 1, 1]
    assert followed == [None] * 4, "memory follows the database also where nobody waits any more"


def test_a_write_is_refused_when_the_lock_stays(tmp_path, monkeypatch):
    monkeypatch.setattr("humanplay.db.store.PATIENCE_S", 0.05)

    async def scenario(store, episodes):
        with locked_elsewhere(tmp_path / "a.db"), pytest.raises(StoreError, match=LOCKED):
            await store.write(lambda: store.add_step(step_row(episodes[0], 0)))
        return store.writes.fault

    assert with_threads(tmp_path / "a.db", scenario) is None


def test_a_write_whose_turn_does_not_come_is_refused_and_never_made(tmp_path, monkeypatch):
    monkeypatch.setattr("humanplay.db.store.PATIENCE_S", 0.1)
    monkeypatch.setattr("humanplay.db.store.NOTICE_S", 0.05)

    async def scenario(store, episodes):
        go_on, _ = await blocked(store)
        with pytest.raises(StoreError, match="has not answered for a while: nothing has changed"):
            await store.write(lambda: store.add_step(step_row(episodes[0], 0)))
        go_on.set()
        return await store.write(lambda: len(store.steps(episodes[0])))

    assert with_threads(tmp_path / "a.db", scenario) == 0


def test_a_database_on_the_event_loop_is_warned_of_and_cannot_be_written_there(tmp_path):
    async def scenario(store, episodes):
        with pytest.warns(RuntimeWarning, match="on the event loop"):
            store.steps(episodes[0])
        with pytest.raises(RuntimeError, match=r"await Store\.write"):
            store.add_step(step_row(episodes[0], 0))

    with_threads(tmp_path / "a.db", scenario)


class StoppingLoop(asyncio.SelectorEventLoop):
    """A loop in which another thread ends the queue just before the next write."""

    queue = None

    def create_future(self):
        if (queue := self.queue) is not None:
            self.queue = None
            self.stopping = threading.Thread(target=queue.stop)
            self.stopping.start()
            time.sleep(0.2)  # it has asked for the end by now
        return super().create_future()


def test_a_write_that_is_asked_for_while_the_queue_ends_is_answered():
    """It was put behind the end of the queue, and whoever awaited it waited for ever."""
    loop = StoppingLoop()
    queue = WriteQueue(lambda: None, lambda: None)

    async def scenario():
        queue.start()
        assert await queue.put(lambda: "before") == "before"
        loop.queue = queue
        async with asyncio.timeout(10):
            assert await queue.put(lambda: "meanwhile") == "meanwhile"

    try:
        loop.run_until_complete(scenario())
        loop.stopping.join(10)
        assert not loop.stopping.is_alive()
    finally:
        loop.close()
