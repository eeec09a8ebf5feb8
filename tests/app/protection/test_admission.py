"""Caps on connections and sockets, and rates of joins, boards and episodes: by address and by cookie."""

import asyncio
import gc
import json
import re
import socket as sockets
import subprocess
import sys
import time
import tracemalloc
from contextlib import ExitStack
from pathlib import Path
from statistics import median

import pytest
from websockets.exceptions import InvalidStatus

from app.protection import Admission, Protection
from app.protection.admission import MAX_IDLE, Rates
from app.protection.connections import OTHER_FILES
from app.settings import STATIC, Limits
from tests.support.servers import eventually
from tests.support.study import Person, freeze

TOKEN = "a-token-of-the-operator"


def descriptors():
    """How many file descriptors this process has open, which is the server's too."""
    return len(list(Path("/proc/self/fd").iterdir()))


def opened(server):
    return sockets.create_connection(("127.0.0.1", server.port), timeout=20)


def ask(connection, accept="*/*"):
    """Ask for the page over an open connection and return the whole answer."""
    connection.sendall(
        f"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nAccept: {accept}\r\nConnection: close\r\n\r\n".encode()
    )
    return b"".join(iter(lambda: connection.recv(65536), b"")).decode()


def test_connections_beyond_the_cap_get_503_and_a_time_to_return_and_everything_is_given_back(
    serve,
):
    server = serve(limits=Limits(connections_per_address=20))
    slots, before = server.services.protection.connections.slots, descriptors()
    with ExitStack() as stack:
        held = [stack.enter_context(opened(server)) for _ in range(20)]
        eventually(lambda: slots.open == 20)
        with opened(server) as one_too_many:
            answer = ask(one_too_many, "text/html")
        assert answer.startswith("HTTP/1.1 503 ")
        assert "retry-after: 30" in answer
        assert "The playground is full" in answer
        with opened(server) as script:
            assert json.loads(ask(script).split("\r\n\r\n")[1])["detail"].startswith(
                "The playground is full"
            )
        assert ask(held[0]).startswith("HTTP/1.1 200 ")
    eventually(lambda: slots.open == 0)
    eventually(lambda: descriptors() <= before)
    assert server.client().get("/").status_code == 200
    assert server.services.protection.refusals["connections"] == 2


def test_the_cap_on_connections_fits_the_files_that_the_server_may_open():
    """In a process of its own: a limit that was lowered cannot be raised again."""
    code = "import resource as r; r.setrlimit(r.RLIMIT_NOFILE, (600, 700)); from app.protection.connections import make_room"
    code += "; print(make_room(100), r.getrlimit(r.RLIMIT_NOFILE)[0], make_room(1000), r.getrlimit(r.RLIMIT_NOFILE)[0])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split() == [
        "100", "612", "188", "700",
    ]  # fmt: skip


def test_the_caps_of_a_server_follow_the_files_that_it_may_open():
    """As many connections as fit, and websockets in proportion, so that pages can be loaded when all of these are taken."""
    code = "import resource as r; r.setrlimit(r.RLIMIT_NOFILE, (600, 700)); from app.settings import Limits"
    code += "; from app.protection.service import Protection; protection = Protection(Limits())"
    code += "; print(*(sum(slots.take(None) for _ in range(5000)) for slots in (protection.connections.slots, protection.sockets)))"
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert said.split() == ["188", "94"]


def test_connections_in_total_have_a_cap_and_one_address_cannot_open_them_too_fast(serve):
    total = serve(limits=Limits(connections=3))
    with ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(opened(total))
        eventually(lambda: total.services.protection.connections.slots.open == 3)
        with opened(total) as one_too_many:
            assert " 503 " in ask(one_too_many)


def test_connections_of_one_address_come_no_faster_than_their_rate(serve):
    server = serve(limits=Limits(opened="5+0.01/s"))
    codes = []
    for _ in range(7):
        with opened(server) as connection:
            codes.append(ask(connection)[9:12])
    assert codes == ["200"] * 5 + ["503"] * 2


def test_connections_that_are_refused_leave_no_debt(serve):
    """Twenty are refused, and the next comes as soon as it may: after half a second, not after ten."""
    server = serve(limits=Limits(opened="3+2/s"))
    with ExitStack() as stack:
        connections = [stack.enter_context(opened(server)) for _ in range(23)]
        codes = [ask(each)[9:12] for each in connections]
    assert codes[:3] == ["200"] * 3
    assert codes.count("503") >= 15
    time.sleep(1)
    with opened(server) as connection:
        assert ask(connection)[9:12] == "200"


def test_whoever_is_refused_waits_and_asks_no_sooner_again(serve):
    """So a client that opens connection after connection opens few a second however fast it asks."""
    server = serve(limits=Limits(opened="1+0.01/s"))
    waits_s = []
    for _ in range(3):
        began = time.monotonic()
        with opened(server) as connection:
            status = ask(connection)[9:12]
        waits_s.append((status, time.monotonic() - began))
    assert [status for status, _ in waits_s] == ["200", "503", "503"]
    assert min(wait_s for _, wait_s in waits_s[1:]) >= 0.25


def test_refused_connections_that_ask_for_nothing_hold_few_files(spawn):
    """A thousand in one moment; each was an open file for a second, more of them than are left for that."""
    server, most = spawn(limits={"opened": "1+0.01/s"}), 0
    files = Path(f"/proc/{server.process.pid}/fd")
    before = len(list(files.iterdir()))
    with ExitStack() as stack:
        for number in range(1000):
            stack.enter_context(opened(server))
            if number % 20 == 0:
                most = max(most, len(list(files.iterdir())))
    assert most - before < OTHER_FILES
    eventually(lambda: len(list(files.iterdir())) <= before)
    time.sleep(1)
    with opened(server) as connection:
        assert "The playground is full" in ask(connection), "who comes later is told"


def test_a_connection_without_a_request_is_closed(serve):
    server = serve(limits=Limits(headers_s=0.1))
    with opened(server) as silent:
        assert silent.recv(1) == b""
    assert server.services.protection.refusals["no_request"] == 1


def test_sockets_beyond_the_cap_are_refused_and_their_places_are_given_back(serve):
    server = serve(limits=Limits(sockets_per_address=3))
    client = server.client()
    begun = client.post("/api/sessions", json={"size": 9}).json()
    with ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(server.socket(begun["session"], client)).receive("frame")
        with pytest.raises(InvalidStatus) as refused, server.socket(begun["session"], client):
            pass
        assert refused.value.response.status_code == 503
        assert refused.value.response.headers["Retry-After"] == "30"
        assert b"too many sockets are open" in refused.value.response.body
    eventually(lambda: server.services.protection.sockets.open == 0)
    with server.socket(begun["session"], client) as socket:
        socket.receive("frame")


def test_boards_and_episodes_have_a_rate_for_each_player_and_for_each_address(serve):
    server = serve(
        limits=Limits(
            sessions_per_player="2/minute",
            sessions_per_address="5/minute",
            episodes_per_player="1/hour",
        )
    )
    first, second = server.client(), server.client()

    def begin(client):
        return client.post("/api/sessions", json={"size": 9})

    session = begin(first).json()["session"]  # without a cookie yet
    assert [begin(first).status_code for _ in range(3)] == [201, 201, 429]
    refused = begin(first)
    assert 1 <= int(refused.headers["retry-after"]) <= 61
    assert (
        "too many new boards from this browser (2 per 1 minute at most): try again in"
        in refused.json()["detail"]
    )
    codes = [begin(second).status_code for _ in range(3)]
    assert codes == [201, 201, 429]
    assert "from this network" in begin(second).json()["detail"]
    codes = [first.post(f"/api/sessions/{session}/episodes").status_code for _ in range(2)]
    assert codes == [201, 429]
    assert server.services.protection.refusals == {"rate_session": 4, "rate_episode": 1}


def test_joins_have_a_rate_and_whoever_has_the_token_has_none(serve, tmp_path):
    freeze(tmp_path / "studies")
    server = serve(limits=Limits(joins_per_address="3/hour", token=TOKEN))
    codes = [server.client().post("/api/studies/small/join").status_code for _ in range(4)]
    assert codes == [201, 201, 201, 429]
    assert (
        server.client(headers={"X-Mars-Token": TOKEN + "x"})
        .post("/api/studies/small/join")
        .status_code
        == 429
    )
    codes = [
        server.client(headers={"X-Mars-Token": TOKEN}).post("/api/studies/small/join").status_code
        for _ in range(3)
    ]
    assert codes == [201] * 3


def test_addresses_are_distinguished_behind_a_named_proxy_alone(serve):
    def codes(server):
        found = []
        for number in range(4):
            client = server.client(headers={"X-Forwarded-For": f"203.0.113.{number}"})
            found.append(client.post("/api/sessions", json={"size": 9}).status_code)
        return found

    limits = Limits(sessions_per_address="2/hour", connections_per_address=1)
    behind = serve(limits=limits, trusted_proxies=("127.0.0.1",))
    assert codes(behind) == [201] * 4
    behind.stop()
    assert codes(serve(limits=Limits(sessions_per_address="2/hour"))) == [201, 201, 429, 429]


def test_the_addresses_of_one_ipv6_network_are_one(serve):
    """A home has the 2**64 addresses of its network; an IPv4 address that is written as IPv6 is the same address."""
    server = serve(limits=Limits(sessions_per_address="2/hour"), trusted_proxies=("127.0.0.1",))

    def begin(address):
        return (
            server.client(headers={"X-Forwarded-For": address})
            .post("/api/sessions", json={"size": 9})
            .status_code
        )

    assert [begin(f"2001:db8:1:2:{each}::7") for each in ("1", "2", "ffff")] == [201, 201, 429]
    assert begin("2001:db8:1:3::7") == 201
    assert [begin(each) for each in ("203.0.113.9", "::ffff:203.0.113.9", "203.0.113.9")] == [
        201,
        201,
        429,
    ]
    keys = [
        server.services.protection.connections.key_of(f"2001:db8:1:{each}::7%eth0")
        for each in ("2", "2:9", "3")
    ]
    assert keys == ["2001:db8:1:2::/64", "2001:db8:1:2::/64", "2001:db8:1:3::/64"]


def test_rates_of_players_who_have_done_nothing_of_late_are_dropped():
    rates = Rates(Limits(sessions_per_player="60/second", sessions_per_address="1000000/second"))

    def begin(players):
        for player in players:
            assert (
                rates.refusal("session", {"address": "192.0.2.1", "player": f"player {player}"})
                is None
            )

    begin(range(2 * MAX_IDLE))
    assert len(rates) > MAX_IDLE, "they are kept as long as they count"
    time.sleep(1.1)
    begin(["last"])  # the storage walks over them in a thread that each hit starts
    eventually(lambda: sum(bool(done) for done in list(rates._storage.events.values())) <= 2)
    begin(range(2 * MAX_IDLE, 4 * MAX_IDLE))
    assert len(rates) <= 2 * MAX_IDLE + 2


def test_long_cookies_are_not_kept(server):
    """A rate remembers a player by a digest: a hundred cookies of 15 kB take less than one megabyte."""
    client = server.client()

    def join(number):
        cookie = f"mars_player={number:05d}{'x' * 15_000}"
        assert client.post("/api/studies/none/join", headers={"Cookie": cookie}).status_code == 404

    join(0)
    tracemalloc.start()
    try:
        for number in range(1, 101):
            join(number)
        gc.collect()
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 1_000_000


def answers_at_once(server, count):
    """Ask for what is not there, over as many connections at once; return the answers, and how many seconds they took."""
    began = time.monotonic()
    with ExitStack() as stack:
        asked = [stack.enter_context(opened(server)) for _ in range(count)]
        for each in asked:
            each.sendall(b"GET /nowhere HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        answers = [
            b"".join(iter(lambda each=each: each.recv(65536), b"")).decode() for each in asked
        ]
    return answers, time.monotonic() - began


def test_requests_of_one_address_wait_for_their_turn_and_are_refused_where_that_takes_too_long(
    serve,
):
    server = serve(limits=Limits(requests="5+2.5/s", token=TOKEN))
    answers, seconds = answers_at_once(server, 30)
    codes = [answer[9:12] for answer in answers]
    assert 15 <= codes.count("404") <= 20, (
        "five at once, and ten within the four seconds that one may wait"
    )
    assert codes.count("429") == 30 - codes.count("404")
    assert seconds > 3
    refused = answers[codes.index("429")]
    assert "retry-after: 4\r\n" in refused
    assert "too many requests from this network: try again in 4 s" in refused
    assert server.services.protection.refusals["rate_request"] == codes.count("429")


def test_the_files_of_the_pages_have_a_rate_of_their_own(serve):
    server = serve(limits=Limits(requests="5+2.5/s", files="40+1000/s", token=TOKEN))
    began = time.monotonic()
    with server.client() as client:
        answers = [client.get("/static/play/main.js").status_code for _ in range(30)]
    assert answers == [200] * 30
    assert time.monotonic() - began < 5, "with the rate of the other requests, ten seconds"


def test_one_request_of_an_address_begins_in_a_turn_of_the_event_loop():
    """So ten that come at once keep somebody else waiting for one of them, and not for ten."""
    turn, begun = 0, []

    async def count_turns():
        nonlocal turn
        while True:
            turn += 1
            await asyncio.sleep(0)

    async def answer(scope, receive, send):
        begun.append((scope["client"][0], turn))

    async def ask_eleven_times():
        counting, admission = (
            asyncio.create_task(count_turns()),
            Admission(answer, Protection(Limits()), None),
        )
        scope = {"type": "http", "method": "GET", "path": "/", "headers": []}
        addresses = [*["192.0.2.1"] * 10, "192.0.2.2"]
        await asyncio.gather(
            *(admission({**scope, "client": (each, 1)}, None, None) for each in addresses)
        )
        counting.cancel()

    asyncio.run(ask_eleven_times())
    assert len({at for address, at in begun if address == "192.0.2.1"}) == 10
    assert "192.0.2.2" in [address for address, _ in begun[:2]]


def test_probes_and_whoever_has_the_token_have_no_part_in_that_rate(serve):
    server = serve(limits=Limits(requests="1+0.1/s", token=TOKEN))
    client = server.client()
    assert [client.get("/nowhere").status_code for _ in range(2)] == [404, 429]
    assert [client.get("/healthz").status_code for _ in range(2)] == [200, 429], (
        "they have the same rate for themselves"
    )
    assert client.get("/nowhere", headers={"X-Mars-Token": TOKEN}).status_code == 404


def test_a_request_that_is_refused_closes_its_connection(serve):
    """Whoever asks on needs new connections, which an address opens at a rate; for a foreign host no other rate is counted."""
    client = serve(limits=Limits(requests="2+0.1/s")).client()
    for headers, status in (
        ({"Host": "evil.example"}, 400),
        ({"Origin": "http://["}, 403),
        ({}, 200),
        ({}, 200),
        ({}, 429),
    ):
        answer = client.get("/", headers=headers)
        assert (answer.status_code, answer.headers.get("connection")) == (
            status,
            "close" if status >= 400 else None,
        )


def test_a_class_of_a_hundred_people_behind_one_address_plays_unhindered(server, tmp_path):
    """Each joins, loads what the page asks for and begins a board; the default settings refuse nothing."""
    freeze(tmp_path / "studies")
    with ExitStack() as stack:
        for _ in range(100):
            person = Person(server, client=server.client())
            board = person.client.post("/api/sessions", json={"size": 9}).json()
            socket = stack.enter_context(server.socket(board["session"], person.client))
            frame = socket.receive("frame")
            for step, action in enumerate(("south", "north")):
                socket.act({**frame, "step": step}, action)
        assert not server.services.protection.refusals


async def load_page(port, files, spent):
    """Load files as a browser does, over six connections; return how many were not found there or were refused."""

    async def load(some):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        missed = 0
        for path in some:
            writer.write(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
            head = (await reader.readuntil(b"\r\n\r\n")).decode()
            await reader.readexactly(int(re.search(r"content-length: (\d+)", head)[1]))
            missed += head[9:12] != "200"
        writer.close()
        return missed

    began = time.monotonic()
    missed = sum(await asyncio.gather(*(load(files[first::6]) for first in range(6))))
    spent.append(time.monotonic() - began)
    return missed


@pytest.mark.long
def test_a_class_of_a_hundred_people_loads_the_page_in_one_moment(spawn, tmp_path):
    """With the default rate of requests and with none; each person loads the page and 60 of its files."""
    static = [path for folder in ("common", "play") for path in sorted((STATIC / folder).iterdir())]
    files = [
        "/",
        *(
            f"/static/{path.relative_to(STATIC)}"
            for path in static
            if path.suffix in (".js", ".css")
        ),
    ][:61]

    async def everybody(server, people):
        spent = []
        missed = await asyncio.gather(
            *(load_page(server.port, files, spent) for _ in range(people))
        )
        return sum(missed), spent

    for name, limits in (
        ("without a rate", {"requests": "1000000+1000000/s"}),
        ("with the default rate", {}),
    ):
        server = spawn(database=str(tmp_path / f"{len(limits)}.db"), limits=limits)
        asyncio.run(everybody(server, 1))
        missed, spent = asyncio.run(everybody(server, 100))
        print(
            f"\n{name}: {len(spent)} people have {len(files)} files after {median(spent):.1f} s, the last after",
            end=" ",
        )
        print(f"{max(spent):.1f} s; {missed} refused", end="")
        assert missed == 0
        server.kill()
