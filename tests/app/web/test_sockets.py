"""Playing over the socket: joining, playing, refusals, bad messages, leaving."""

import json
from contextlib import suppress

import pytest
from websockets.exceptions import ConnectionClosed

from humanplay.tasks.mars.run import View
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load


@pytest.fixture
def board(server):
    """A client, and the session it has begun."""
    client = server.client()
    return client, client.post("/api/sessions", json={"size": [9, 13], "seed": 5}).json()


def rest_until_closed(socket):
    """Return what still comes until the socket is closed, and the code of the closing."""
    messages = []
    try:
        while True:
            messages.append(socket.receive())
    except ConnectionClosed as closed:
        return messages, closed.rcvd and closed.rcvd.code


def test_an_episode_over_the_socket_is_the_cores_frame_by_frame(server, board):
    client, begun = board
    episode = Episode.begin(EnvConfig("random", 9, 13), seed=5)
    policy = load("frontier-utility")
    policy.reset(0)
    with (
        server.socket(begun["session"], client) as socket,
        server.socket(begun["session"]) as watcher,
    ):
        frame = socket.receive("frame")
        while frame["outcome"] is None:
            action = policy.act(episode.codes.copy())
            socket.act(frame, ACTIONS[action], input="key")
            frame = socket.frame_after(frame["step"])
            episode.step(action)
            assert frame == json.loads(View(episode).frame(frame["episode"]))
        while (seen := watcher.receive("frame"))["outcome"] is None:
            pass
        assert seen == frame
        socket.send({"kind": "history"})
        assert tuple(socket.receive("history")["positions"][-1]) == episode.path[-1]
        client.post(f"/api/sessions/{begun['session']}/episodes")
        assert watcher.receive()["step"] == 0
        assert watcher.receive()["kind"] == "history"


def test_a_stale_act_is_refused_with_the_current_frame(server, board):
    client, begun = board
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        socket.act(frame, "south")
        now = socket.frame_after(0)
        for stale in (frame, {**now, "episode": "another"}, {**now, "step": 7}):
            socket.act(stale, "south")
            refused = socket.receive("refused")
            assert refused["frame"] == now
            assert "is not the current one" in refused["reason"]
    assert client.get(f"/api/sessions/{begun['session']}").json() == now


def test_a_bad_message_gets_an_error_and_the_socket_stays_open(server, board):
    client, begun = board
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        socket.receive("history")
        wrong = {"kind": "act", "episode": frame["episode"], "step": 0, "action": 1}
        for message, problem in (
            ("{", "must be JSON"),
            ("north", "must be JSON"),
            (b"\x00\x01\x02", "JSON in a text frame, got 3 binary bytes"),
            (json.dumps({"kind": "act"}).encode(), "binary"),
            ({"kind": "fly"}, "kind must be"),
            (wrong, "action must be"),
            ("x" * 65_537, "at most 65536 bytes, got 65537"),
        ):
            socket.send(message)
            error = socket.receive()
            assert error["kind"] == "error"
            assert problem in error["detail"]
        socket.act(frame, "south")
        assert socket.frame_after(0)["step"] == 1


def test_a_message_that_is_far_too_long_closes_that_socket_alone(server, board):
    client, begun = board
    with (
        server.socket(begun["session"], client) as socket,
        server.socket(begun["session"], client) as other,
    ):
        with suppress(ConnectionClosed):  # perhaps before all of it was sent
            socket.send("x" * 2**24)
        rest_until_closed(socket)
        assert other.receive("frame") == begun["frame"]


@pytest.mark.parametrize("path", ["/ws/sessions/", "/viewer/"])
def test_an_unknown_session_closes_with_4404(server, path):
    with server.socket("nobody", path=path) as socket:
        messages, code = rest_until_closed(socket)
    assert code == 4404
    assert all("no session 'nobody'" in message["detail"] for message in messages)


def test_a_server_that_stops_closes_its_sockets_with_a_code_that_says_it(server, board):
    client, begun = board
    with server.socket(begun["session"], client) as socket:
        socket.receive("history")
        server.stop()
        with pytest.raises(ConnectionClosed) as caught:
            socket.receive()
    assert caught.value.rcvd.code in (1001, 1012)


def test_a_subscriber_that_does_not_read_skips_to_the_newest_frame(server):
    client = server.client()
    begun = client.post("/api/sessions", json={"size": 128, "seed": 5}).json()
    with (
        server.socket(begun["session"], max_queue=16) as slow,
        server.socket(begun["session"], client) as socket,
    ):
        frame = socket.receive("frame")
        for number in range(600):
            socket.act(frame, ("south", "north")[number % 2])
            frame = socket.frame_after(frame["step"])
        seen = [slow.receive("frame")["step"]]
        while seen[-1] < 600:
            seen.append(slow.receive("frame")["step"])
    assert seen == sorted(set(seen))
    assert len(seen) < 601
