"""Floods over one socket: each is slowed down or ends with close code 1008, and nobody else notices."""

import json
import struct
import time
from asyncio.selector_events import _SelectorSocketTransport
from contextlib import ExitStack, suppress

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from app.protection.buckets import BucketSize, TokenBucket
from app.protection.connections import PENALTY, PENALTY_DEBT
from app.protection.protocols import READ_BYTES, WAITING_MESSAGES, LimitedWebSocket
from app.protection.socket_budget import PATIENCE, SocketBudget, TooManyMessagesError
from app.settings import Limits
from tests.support.servers import eventually


def masked(opcode, payload):
    """A final frame of a client, masked with zeros."""
    length = (
        bytes([128 | len(payload)])
        if len(payload) < 126
        else bytes([128 | 126]) + struct.pack("!H", len(payload))
    )
    return bytes([128 | opcode]) + length + bytes(4) + payload


PING, PONG, FRAGMENT = masked(9, b""), masked(10, b""), bytes([0, 128]) + bytes(4)

CLOSED_WITHIN_S = 10
"""How long a socket may stay open after a flood: the server closes it at once."""


def text(message):
    return masked(1, message.encode() if isinstance(message, str) else json.dumps(message).encode())


def begin(server):
    client = server.client()
    return client, client.post("/api/sessions", json={"size": [9, 13], "seed": 5}).json()


def flood(server, begun, data, times):
    """Send bytes over a new socket, many times at once, and return the code and the words that it is closed with."""
    with server.socket(begun["session"]) as socket:
        socket.receive("frame")
        try:
            for _ in range(times):
                socket.connection.socket.sendall(data)
        except OSError:
            pass  # it is closed already
        return why_closed(socket)


def why_closed(socket):
    """Read until a socket is closed, and return the code and the words; fail where it stays open."""
    until = time.monotonic() + CLOSED_WITHIN_S
    try:
        while (left_s := until - time.monotonic()) > 0:
            socket.receive(seconds=left_s)
    except ConnectionClosed as closed:
        return closed.rcvd.code, closed.rcvd.reason
    except TimeoutError:
        pass
    pytest.fail(f"the socket is still open after {CLOSED_WITHIN_S} s")


def test_a_bucket_gives_its_burst_at_once_and_its_rate_after_that():
    now = [0.0]
    bucket = TokenBucket(BucketSize.parse("3+2/s"), lambda: now[0])
    assert [bucket.take() for _ in range(5)] == [0, 0, 0, 0.5, 1.0]
    now[0] = 1.0
    assert bucket.take() == 0.5
    now[0] = 60.0
    assert bucket.is_full
    assert [bucket.take() for _ in range(4)] == [0, 0, 0, 0.5]


@pytest.mark.parametrize(
    "written",
    ["", "20", "20+/s", "0+1/s", "20+0/s", "20+0.0/s", "-1+2/s", "20+2/minute", "a+b/s", "1e3+1/s"],
)
def test_a_size_that_is_none_is_refused_in_words(written):
    with pytest.raises(ValueError, match="expected BURST"):
        BucketSize.parse(written)
    with pytest.raises(ValueError, match="pings"):
        Limits(pings=written)


def test_pings_never_reach_the_application_and_too_many_close_the_socket(server):
    _, begun = begin(server)
    assert flood(server, begun, PING * 500, 20) == (1008, "too many pings")
    assert server.services.protection.refusals["socket_pings"] == 1


@pytest.mark.parametrize(
    ("frame", "kind", "times"), [(PONG, "pings", 500), (FRAGMENT, "messages", 12_000)]
)
def test_frames_that_are_no_message_close_the_socket_too(server, frame, kind, times):
    _, begun = begin(server)
    beginning = bytes([1, 128]) + bytes(4)  # of a message in fragments; none of them is the last
    assert flood(server, begun, (beginning if frame is FRAGMENT else b"") + frame * times, 1) == (
        1008,
        f"too many {kind}",
    )


def test_a_page_that_pings_as_browsers_and_libraries_do_stays(server):
    _, begun = begin(server)
    with server.socket(begun["session"]) as socket:
        for _ in range(15):
            assert socket.connection.ping().wait(20)
        socket.act(socket.receive("frame"), "south")
        assert socket.frame_after(0)["step"] == 1


@pytest.mark.parametrize(
    ("message", "kind"),
    [
        ("nonsense", "bad"),
        ({"kind": "act", "episode": "other", "step": 0, "action": "north"}, "refused"),
    ],
)
def test_messages_that_nobody_needs_close_the_socket(server, message, kind):
    _, begun = begin(server)
    code, reason = flood(server, begun, text(message) * 20, 20)
    assert (code, f"({kind})" in reason) == (1008, True)
    assert server.services.protection.refusals[f"messages_{kind}"] == 1


def test_binary_messages_close_the_socket(server):
    _, begun = begin(server)
    assert flood(server, begun, masked(2, b"x") * 50, 2)[0] == 1008


@pytest.mark.parametrize("kind", ["history", "expected"])
def test_requests_are_slowed_down_and_a_flood_of_them_closes_the_socket(serve, kind, monkeypatch):
    monkeypatch.setattr("app.protection.socket_budget.PATIENCE", 10)
    server = serve(limits=Limits(histories="5+20/s", expectations="5+20/s"))
    _, begun = begin(server)
    code, reason = flood(server, begun, text({"kind": kind}), PATIENCE)
    assert (code, f"({kind})" in reason) == (1008, True)


def test_a_socket_is_closed_after_a_hundred_slowed_messages_of_one_kind_in_a_row_and_for_acts_never():
    sizes = dict.fromkeys(("act", "history"), BucketSize.parse("1+0.001/s"))
    refusals = []
    budget = SocketBudget(sizes, {}, refusals.append)
    for _ in range(1 + PATIENCE):
        budget.spend("history")
        budget.spend("act")
    budget.spend("act")
    assert (PATIENCE, refusals) == (100, [])
    with pytest.raises(TooManyMessagesError, match=r"\(history\)"):
        budget.spend("history")
    assert refusals == ["messages_history"]


@pytest.mark.parametrize(("kind", "patience"), [("bad", 0), ("refused", 15)])
def test_a_socket_is_closed_sooner_after_messages_that_nobody_needs(kind, patience):
    budget = SocketBudget({kind: BucketSize.parse("5+0.001/s")}, {}, [].append)
    for _ in range(5 + patience):
        budget.spend(kind)
    with pytest.raises(TooManyMessagesError, match=rf"\({kind}\)"):
        budget.spend(kind)


def test_acts_that_are_refused_are_slowed_down_before_they_close_the_socket(serve):
    server = serve(limits=Limits(refused_acts="2+5/s"))
    _, begun = begin(server)
    with server.socket(begun["session"]) as socket:
        began = time.monotonic()
        for _ in range(6):
            socket.send({"kind": "act", "episode": "other", "step": 0, "action": "north"})
        for _ in range(6):
            socket.receive("refused")
        assert time.monotonic() - began >= 0.6


def test_messages_of_any_kind_have_a_limit_on_every_socket(serve):
    server = serve(limits=Limits(messages="50+1/s"))
    client, begun = begin(server)
    watch = begun["watch"]
    with server.socket(watch, client, path="/ws/watch/") as socket:
        socket.receive("frame")
        socket.connection.socket.sendall(text("ignored") * 60)
        assert why_closed(socket) == (1008, "too many messages")


def test_a_script_that_waits_for_each_frame_is_slowed_down_and_never_closed(serve):
    server = serve(limits=Limits(acts="1+1000/s"))
    client, begun = begin(server)
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        for move in range(2 * PATIENCE):
            socket.act(frame, "east" if move % 2 == 0 else "west")
            frame = socket.frame_after(frame["step"])
            if frame["outcome"]:
                begun = client.post(
                    f"/api/sessions/{begun['session']}/episodes", json={"seed": 5}
                ).json()
                frame = socket.receive("frame")
                while frame["step"] or frame["outcome"]:
                    frame = socket.receive("frame")


def test_the_sockets_of_one_address_share_limits_and_those_of_another_do_not(serve):
    server = serve(
        limits=Limits(histories="5+0.1/s", busy_sockets=2), trusted_proxies=("127.0.0.1",)
    )
    _, begun = begin(server)

    def answers(address, sockets):
        """How many of five requests over each of some sockets are answered at once."""
        count = 0
        for _ in range(sockets):
            with server.socket(begun["session"], **{"X-Forwarded-For": address}) as socket:
                socket.receive("history")  # on joining
                for _ in range(5):
                    socket.send({"kind": "history"})
                with suppress(TimeoutError):
                    for _ in range(5):
                        socket.receive("history", seconds=1)
                        count += 1
        return count

    assert answers("203.0.113.1", 3) == 11, (
        "ten of two sockets, and the one that is answered before it waits"
    )
    assert answers("203.0.113.2", 1) == 5


def test_messages_of_any_kind_have_a_limit_over_all_sockets_of_an_address(serve):
    server = serve(limits=Limits(messages_per_address="30+0.1/s"))
    client, begun = begin(server)
    with ExitStack() as stack:
        first, second = (
            stack.enter_context(server.socket(begun["watch"], client, path="/ws/watch/"))
            for _ in range(2)
        )
        for socket in (first, second):
            socket.receive("frame")
        first.connection.socket.sendall(text("ignored") * 20)
        assert first.connection.ping().wait(20)
        second.connection.socket.sendall(text("ignored") * 20)
        assert why_closed(second) == (1008, "too many messages")


def test_a_socket_that_is_closed_for_too_much_costs_its_address_connections(serve):
    server = serve(limits=Limits(opened="150+0.1/s"))
    _, begun = begin(server)
    codes = []
    for _ in range(2):
        codes.append(flood(server, begun, PING * 500, 1)[0])
    assert codes == [1008, 1008]
    with pytest.raises(InvalidStatus) as refused, server.socket(begun["session"]):
        pass
    assert refused.value.response.status_code == 503


def test_an_address_whose_sockets_were_closed_owes_a_few_connections_and_no_more():
    now = [0.0]
    bucket = TokenBucket(BucketSize.parse("150+1/s"), lambda: now[0])
    for _ in range(20):
        bucket.take_away(PENALTY, PENALTY_DEBT)
    now[0] = PENALTY_DEBT + 0.5
    assert not bucket.take_if_there()
    now[0] = PENALTY_DEBT + 1.5
    assert bucket.take_if_there()


def test_connections_are_served_in_turn(serve):
    server = serve(limits=Limits(served="1+4/s"))
    began = time.monotonic()
    for _ in range(3):
        assert server.client().get("/healthz").status_code == 200
    assert time.monotonic() - began >= 0.4


def test_a_flood_leaves_the_board_as_it_was_and_the_player_comes_back(server):
    client, begun = begin(server)
    assert flood(server, begun, text("nonsense") * 100, 1)[0] == 1008
    with server.socket(begun["session"], client) as socket:
        assert socket.receive("frame") == begun["frame"]
        socket.act(begun["frame"], "south")
        assert socket.frame_after(0)["step"] == 1
    eventually(lambda: server.services.protection.sockets.open == 0)


def test_reading_pauses_only_where_messages_wait(serve, monkeypatch):
    server = serve(limits=Limits(histories="1000+1000/s"))
    pauses, waited = [], []
    pause, receive = _SelectorSocketTransport.pause_reading, LimitedWebSocket.receive

    async def watched(self):
        waited.append(self.queue.qsize())
        return await receive(self)

    monkeypatch.setattr(
        _SelectorSocketTransport, "pause_reading", lambda self: (pauses.append(self), pause(self))
    )
    monkeypatch.setattr(LimitedWebSocket, "receive", watched)
    client, begun = begin(server)
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        pauses.clear()
        for number in range(20):
            socket.act(frame, ("east", "west")[number % 2])
            frame = socket.frame_after(frame["step"])
        assert frame["outcome"] is None
        assert pauses == [], "each would be two calls of the system"
        message = text({"kind": "history"})
        for _ in range(200):
            socket.connection.socket.sendall(message)
        for _ in range(200):
            socket.receive("history")
    assert pauses
    assert max(waited) <= WAITING_MESSAGES + READ_BYTES // len(message)
