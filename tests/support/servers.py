"""Servers for the tests: real ones on real ports, each with app and database."""

import asyncio
import http.cookiejar
import random
import threading
import time
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from importlib.util import find_spec

import httpx
import pytest
import uvicorn
from websockets.sync.client import connect

from humanplay.web.simulate import Clock, Socket

PACE = random.Random(7)
PATIENCE_S = 60.0
"""How long anything in a test may take before it counts as never."""
CLOSE_S = 1.0
"""How long a socket waits at its end for a server that has more to read of it first."""


def eventually(claim, seconds=PATIENCE_S):
    """The first true value of `claim()`; fail after `seconds`.

    The longer it lasts, the more rarely it is asked.
    """
    began = time.monotonic()
    while (waited := time.monotonic() - began) < seconds:
        answer = claim()
        if answer:
            return answer
        time.sleep(min(max(0.01, waited / 20), 0.25))
    raise AssertionError(f"not within {seconds} s: {claim}")


def forged(cookie):
    """A signed cookie with another signature.

    Not its last character: two of that one's bits carry nothing.
    """
    body, sign = cookie[:-8], cookie[-8:]
    return body + ("A" if sign[0] != "A" else "B") + sign[1:]


class MovableClock(Clock):
    """A clock that a test moves on, so that fast people look slow to the server."""

    def __init__(self):
        super().__init__()
        self.skipped_ms = self.set_back_ms = 0

    def now_ms(self):
        """What the server's clock says, which alone is set back."""
        return time.time_ns() // 1_000_000 + self.skipped_ms - self.set_back_ms

    def page_ms(self):
        """performance.now() of a page that was loaded when this machine was started."""
        return round(time.monotonic() * 1000 + self.skipped_ms, 1)

    def wait(self, ms):
        self.skipped_ms += ms


class HastyClock(Clock):
    """The clock of people at a server in another process: they wait for nothing.

    Its clock cannot be moved on.
    """

    def wait(self, ms):
        pass


class Engine(uvicorn.Server):
    """uvicorn's server that ends at once.

    uvicorn looks ten times a second, and pauses as long at the end.
    """

    async def startup(self, sockets=None):
        self._loop, self._ending = asyncio.get_running_loop(), asyncio.Event()
        await super().startup(sockets)

    def end(self):
        """Tell it to end; for any thread."""
        self.should_exit = True
        self._loop.call_soon_threadsafe(self._ending.set)

    async def main_loop(self):
        tick = 0
        while not await self.on_tick(tick):
            tick = (tick + 1) % 10
            with suppress(TimeoutError):
                await asyncio.wait_for(self._ending.wait(), 0.1)

    async def shutdown(self, sockets=None):
        """Shut down as uvicorn does, without waiting if no connection is open."""
        deadline = time.monotonic() + 0.02
        while self._is_busy() and time.monotonic() < deadline:
            await asyncio.sleep(0.001)  # clients that have closed are noticed meanwhile
        if self._is_busy():
            await super().shutdown(sockets)
            return
        for closable in (*self.servers, *(sockets or ())):
            closable.close()
        await self.lifespan.shutdown()

    def _is_busy(self):
        return bool(self.server_state.connections or self.server_state.tasks)


class RunningServer:
    """A server at `url`, and clients for it."""

    def __init__(self, port, clock=None):
        self.port, self.url, self.clock = port, f"http://127.0.0.1:{port}", clock
        self.app = self.check = None
        self._clients = []

    def client(self, **rest):
        # nothing here speaks TLS, and reading the certificates takes 20 ms
        rest = {"verify": False, **rest}
        client = httpx.Client(base_url=self.url, timeout=PATIENCE_S, trust_env=False, **rest)
        if self.check is not None:
            client.event_hooks["response"].append(partial(self.check, self.app))
        self._clients.append(client)
        return client

    def page(self, **rest):
        """A client whose requests are those of the server's own page."""
        return self.client(headers={"Origin": self.url}, **rest)

    @contextmanager
    def socket(
        self, session_id, client=None, origin=True, path="/ws/sessions/", max_queue=None, **headers
    ):
        """Yield a Socket with the client's cookie and the page's Origin.

        max_queue  messages that wait for the test before nothing more is read; None reads them all,
                   so that it closes at once
        """
        if client is not None and client.cookies:
            headers["Cookie"] = "; ".join(f"{c.name}={c.value}" for c in client.cookies.jar)
        page_origin = self.url if origin is True else origin or None
        url = f"ws://127.0.0.1:{self.port}{path}{session_id}"
        plain = {"proxy": None, "compression": None, "max_size": None, "max_queue": max_queue}
        times = {"open_timeout": PATIENCE_S, "close_timeout": CLOSE_S}
        with connect(
            url, origin=page_origin, additional_headers=headers, **plain, **times
        ) as connection:
            yield Socket(connection, self.clock or HastyClock(), PACE)

    def explore(self, client, session_id, instead=lambda socket, frame, action: False):
        """Play a board to its end by keys, as a rule would, and return its last frame.

        instead  makes a move in another way, where it returns True
        """
        from humanplay.tasks.mars.run import occupancy_codes
        from marsexplorer.config import ACTIONS
        from marsexplorer.policies import load

        policy = load("frontier-cost")
        policy.reset(1)
        with self.socket(session_id, client) as socket:
            frame = socket.receive("frame")
            while frame["outcome"] is None:
                action = ACTIONS[policy.act(occupancy_codes(frame))]
                if not instead(socket, frame, action):
                    socket.act(frame, action, input="key")
                frame = socket.frame_after(frame["step"])
        return frame

    @property
    def protection(self):
        """What a server in this process counts of its clients."""
        return self.app.state.protection

    @property
    def services(self):
        """The services of a server in this process: its store, lobby, viewer and so on."""
        return self.app.state.services

    def on_loop(self, coroutine):
        """Return what a coroutine of a server in this process returns."""
        loop = self.services.store.writes._loop
        return asyncio.run_coroutine_threadsafe(coroutine, loop).result(PATIENCE_S)

    def execute(self, sql):
        """Execute a statement on the server's own writing connection."""
        store = self.services.store
        self.on_loop(store.write(lambda: store.connection.execute(sql).fetchall()))

    def close(self):
        for client in self._clients:
            client.close()


def hasty_limits():
    """Limits under which people at machine speed are not slowed down."""
    from humanplay.web.settings import Limits

    fast = "100000+100000/s"
    return Limits(messages=fast, requests_per_address=fast, paced_per_address=fast)


@pytest.fixture
def limits():
    """The limits of a server that is asked for none."""
    return hasty_limits()


@pytest.fixture(scope="session")
def shipped_policies():
    """The policies of a server without further ones, loaded once.

    Loading each is most of a server's start.

    None in a tree without MarsExplorer.
    """
    if find_spec("humanplay.tasks.mars") is None:
        return None
    from humanplay.tasks.mars.policies import PolicyCatalogue

    return PolicyCatalogue()


@contextmanager
def running_server(policies, /, sources=None, **settings):
    """Yield a server in a thread of this process, with settings and policies."""
    from humanplay.board.sources import Sources
    from humanplay.web.listening import bound_connections, listen, uvicorn_config
    from humanplay.web.server import AppParts, create_app
    from humanplay.web.settings import Settings

    sock = listen("127.0.0.1", 0)
    bound_connections(sock, settings["limits"].answer_s)
    clock = MovableClock()
    server = RunningServer(sock.getsockname()[1], clock)
    sources = sources or Sources(clock_ms=clock.now_ms)
    server.app = create_app(Settings(**settings), AppParts(sources, policies))
    engine = Engine(uvicorn_config(server.app))
    thread = threading.Thread(target=engine.run, kwargs={"sockets": [sock]}, daemon=True)
    thread.start()
    # the rules are compiled first, perhaps
    eventually(lambda: engine.started or not thread.is_alive(), 240)
    assert engine.started

    def stop():
        if thread.is_alive():
            engine.end()
            thread.join(PATIENCE_S)
            assert not thread.is_alive(), "the server did not stop"
        sock.close()
        server.close()

    loop_clock = time.pthread_getcpuclockid(thread.ident)
    server.stop, server.engine = stop, engine
    # processor seconds of the event loop's thread
    server.loop_s = lambda: time.clock_gettime(loop_clock)
    try:
        yield server
    finally:
        server.close()
        stop()


@pytest.fixture
def serve(tmp_path, limits, shipped_policies):
    """`serve(...)` starts a server as `running_server` does, in the test's folder.

    `offered` are sources of policies that it loads itself, besides those of `policies`. Every
    answer must be as described.
    """
    from tests.support.answers import check_answer

    with ExitStack() as running:

        def start(sources=None, policies=None, offered=(), **settings):
            paths = {"database": tmp_path / "playground.db"}
            settings = {**paths, "limits": limits, "policies": offered, **settings}
            one = running_server(policies or shipped_policies, sources, **settings)
            server = running.enter_context(one)
            server.check = check_answer
            return server

        yield start


@pytest.fixture
def server(serve):
    """One server with the defaults."""
    return serve()


@pytest.fixture
def spawn(tmp_path, tmp_path_factory, limits):
    """`spawn()` starts a server that can be killed, on the same database every time.

    `listening` is a socket that it inherits as systemd would pass it on.
    """
    from tests.support.forked_server import ServerProcess

    processes, servers, logs = [], [], tmp_path_factory.mktemp("servers")

    def start(listening=None, **settings):
        paths = {"database": str(tmp_path / "playground.db")}
        settings = {**paths, "port": 0, "limits": limits, **settings}
        process = ServerProcess(settings, logs / f"{len(processes)}.log", listening)
        processes.append(process)
        lines = []
        for line in process.lines():
            lines.append(line)
            if "is open at" in line:
                break
        assert lines, "the server printed nothing"
        assert "is open at" in lines[-1], "".join(lines)
        server = RunningServer(int(lines[-1].split("http://127.0.0.1:")[1].split()[0]))
        server.process, server.printed = process, lines
        servers.append(server)

        def kill():
            for end in (process.kill, process.wait, process.stdout.close, server.close):
                end()

        server.kill = kill
        return server

    yield start
    for process in processes:
        if process.poll() is None:
            process.kill()
            process.wait()
        process.stdout.close()
    for server in servers:
        server.close()


@pytest.fixture
def no_cookies():
    """A cookie policy for clients that keep none: a script without a jar."""
    return http.cookiejar.DefaultCookiePolicy(allowed_domains=[])
