"""Reads use a fixed number of connections that keep little in memory."""

import asyncio
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from humanplay.db.read_threads import THREADS, ReadThreads
from humanplay.db.reader import Reader
from humanplay.db.store import READ_CACHE_KB
from tests.support.servers import eventually

PASSWORD = "an operator's password"


def test_all_that_the_store_reads_goes_over_the_connections_that_were_opened_at_the_start(serve):
    server = serve(idle_s=0.2)
    reads = server.services.store._reads

    def visit(number):
        client = server.page()
        begun = client.post("/api/sessions", json={"size": 9}).json()
        for url in ("/", "/me", f"/watch/{begun['watch']}", "/daily", "/leaderboard", "/api/me/session", "/api/episodes",
                    "/api/daily", f"/api/watch/{begun['watch']}", "/api/leaderboard", "/healthz", "/readyz"):  # fmt: skip
            assert client.get(url).status_code == 200, url

    assert len(reads) == THREADS
    with ThreadPoolExecutor(6) as people:
        list(people.map(visit, range(6)))
    eventually(lambda: len(server.services.lobby) == 0)
    assert len(reads) == THREADS
    cache_sizes = server.on_loop(
        server.services.store.read(lambda: server.services.store.query("PRAGMA cache_size"))
    )
    assert cache_sizes == [{"cache_size": -READ_CACHE_KB}]


def test_one_list_is_read_at_a_time_whoever_asks(serve, monkeypatch):
    """Each working thread delays the event loop, and with it moves."""
    server, inside, most, read = serve(), [], [], Reader.episodes

    def read_slowly(*given):
        inside.append(given)
        most.append(len(inside))
        time.sleep(0.05)
        inside.pop()
        return read(*given)

    monkeypatch.setattr(Reader, "episodes", read_slowly)
    client = server.client()
    with ThreadPoolExecutor(10) as people:
        answers = list(people.map(client.get, ["/api/episodes"] * 20))
    assert {answer.status_code for answer in answers} == {200}
    assert max(most) == 1


def test_whoever_asks_for_no_list_waits_for_none(serve, monkeypatch):
    goes_on = threading.Event()
    monkeypatch.setattr(Reader, "episodes", lambda *_: goes_on.wait(30) and [])
    server = serve(admin_password=PASSWORD)
    client, page = server.client(), server.page()
    with ThreadPoolExecutor(2) as people:
        lists = [people.submit(client.get, "/api/episodes") for _ in range(2)]
        try:
            for url, status in (("/api/daily", 200), ("/api/studies", 200), ("/api/studies/none/me", 404),
                                ("/nowhere", 404), ("/api/admin/overview", 401)):  # fmt: skip
                assert page.get(url, timeout=5).status_code == status, url
            login = {"password": PASSWORD}
            assert page.post("/api/admin/login", json=login, timeout=5).status_code == 200
            assert not any(answer.done() for answer in lists)
        finally:
            goes_on.set()
        assert {answer.result().status_code for answer in lists} == {200}


def test_each_thread_that_reads_has_one_of_the_connections_that_were_opened_at_the_start():
    opened = []

    class Connection:
        def __init__(self):
            self.is_open = True
            opened.append(self)

        def close(self):
            self.is_open = False

    async def read_at_once(reads):
        together = threading.Barrier(THREADS)

        def read():
            together.wait(10)
            return reads.connection()

        return await asyncio.gather(*(reads.run(read) for _ in range(THREADS)))

    reads = ReadThreads(Connection)
    assert len(opened) == len(reads) == THREADS
    assert set(asyncio.run(read_at_once(reads))) == set(opened)
    assert len(opened) == THREADS
    reads.close()
    assert not any(connection.is_open for connection in opened)

    def fail():
        if len(opened) == THREADS + 2:
            raise OSError("no more files")
        return Connection()

    with pytest.raises(OSError, match="no more files"):
        ReadThreads(fail)
    assert not any(connection.is_open for connection in opened)
