"""The 3-D view over a real socket: it follows the board, shows nothing else, and survives what it should refuse."""

import gc
from contextlib import suppress

import msgspec
import numpy as np
import pytest
import zstandard
from conftest import eventually
from tools3d import CAMERA
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.scene import fog, soil
from app.viewer import PROTOCOL
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode


def open_view(server, session, subprotocol=PROTOCOL):
    url = f"ws://127.0.0.1:{server.port}/viewer/{session}"
    return connect(url, subprotocols=[subprotocol], origin=server.url, proxy=None, compression=None, max_size=None)


def messages(data):
    """The messages of one batch in viser's wire format."""
    length = int.from_bytes(data[8:16], "little")
    return msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data[16 : 16 + length]))["messages"]


def drain(view):
    """Read until the server is silent or gone."""
    with suppress(ConnectionClosed, TimeoutError):
        while True:
            view.recv(timeout=1)


def read_until(view, claim, seconds=20):
    """Every message up to the first for which claim(message)."""
    seen = []
    while True:
        for message in messages(view.recv(timeout=seconds)):
            seen.append(message)
            if claim(message):
                return seen


def is_named(name):
    return lambda message: message.get("name") == name


@pytest.fixture
def board(server):
    client = server.client()
    about = client.post("/api/sessions", json={"size": [9, 12], "seed": 3}).json()
    return client, about


def test_a_move_reaches_the_view_and_costs_little(server, board):
    client, about = board
    with open_view(server, about["session"]) as view:
        view.send(CAMERA)
        read_until(view, is_named("/border"))
        sent = 0
        frame = about["frame"]
        for action in ("east", "west", "east"):
            act = {"episode": frame["episode"], "step": frame["step"], "action": action}
            frame = client.post(f"/api/sessions/{about['session']}/act", json=act).json()
            data = b""
            while not any(message.get("name") == "/rover" for message in (messages(data) if data else [])):
                data = view.recv(timeout=20)
                sent += len(data)
        assert sent < 3 * 4000


def test_the_page_is_viser_s_client_of_the_same_version(server, board):
    client, about = board
    page = client.get(f"/viewer/{about['session']}/")
    assert page.status_code == 200
    assert "hasFocus" in page.text
    assert client.get(f"/viewer/{about['session']}/", headers={"If-None-Match": page.headers["etag"]}).status_code == 304
    assert "frame-ancestors 'self'" in page.headers["content-security-policy"]
    assert client.get("/viewer/none/").status_code == 404


def test_another_version_and_garbage_are_refused_and_the_server_goes_on(server, board):
    client, about = board
    with open_view(server, about["session"], "viser-v0.0.0") as view, pytest.raises(ConnectionClosed) as closed:
        view.recv(timeout=20)
    assert PROTOCOL in closed.value.rcvd.reason
    for rubbish in (b"\x00\x01garbage", "text", b"x" * 100_000, msgspec.msgpack.encode({"type": "NoSuchMessage"})):
        with open_view(server, about["session"]) as view:
            view.send(rubbish)
            drain(view)
    assert client.get("/api/health").status_code == 200


def test_a_viewer_cannot_ask_for_a_public_tunnel(server, board, monkeypatch):
    asked = []
    monkeypatch.setattr("viser._viser.ViserServer.request_share_url", lambda *_, **__: asked.append(1))
    _, about = board
    with open_view(server, about["session"]) as view:
        view.send(CAMERA)
        read_until(view, is_named("/border"))
        view.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
        drain(view)
    assert asked == []


def test_nothing_is_left_of_a_viewer_that_went(server, board):
    _, about = board
    for _ in range(5):
        with open_view(server, about["session"]) as view:
            view.send(CAMERA)
            read_until(view, is_named("/border"))
    viewer = server.app.state.viewer
    eventually(lambda: viewer.clients == 0)
    gc.collect()
    eventually(lambda: server.app.state.lobby is not None and not viewer._mirrors)


def test_the_fog_depends_on_what_is_known_alone():
    """Two terrains that agree on every cell seen so far give the same picture, to the byte."""
    one = np.zeros((9, 12), bool)
    other = one.copy()
    other[8, 11] = True
    episodes = [Episode.begin(EnvConfig(rows=9, cols=12), terrain=terrain) for terrain in (one, other)]
    assert fog(episodes[0].codes) == fog(episodes[1].codes)
    assert (episodes[0].codes == episodes[1].codes).all()
    assert soil(9, 12) == soil(9, 12)
