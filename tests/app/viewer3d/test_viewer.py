"""The 3-D view over a real socket: it follows the board and shows nothing else."""

import asyncio
import gc
import io
from contextlib import suppress
from itertools import pairwise, product
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
import zstandard
from PIL import Image
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from humanplay.tasks.mars.run import View
from humanplay.tasks.mars.viewer3d.models import dashes
from humanplay.tasks.mars.viewer3d.scene import (
    CLIFF,
    DAY,
    NEAR,
    NIGHT,
    SHADOW,
    Scene,
    ViewOptions,
    fog,
)
from humanplay.tasks.mars.viewer3d.viewer import FOV, TILT, Viewer, camera_for
from humanplay.tasks.mars.viewer3d.viser_transport import PROTOCOL
from marsexplorer.config import FREE, UNKNOWN, EnvConfig
from marsexplorer.episode import Episode
from tests.support.servers import PATIENCE_S, eventually
from tests.support.viewer3d import CAMERA


def open_view(server, session, subprotocol=PROTOCOL):
    url = f"ws://127.0.0.1:{server.port}/viewer/{session}"
    plain = {"proxy": None, "compression": None, "max_size": None, "open_timeout": PATIENCE_S}
    return connect(url, subprotocols=[subprotocol], origin=server.url, **plain)


def messages(data):
    """The messages of one batch in viser's wire format."""
    packed = data[16 : 16 + int.from_bytes(data[8:16], "little")]
    return msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(packed))["messages"]


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


def is_rover_at(place):
    return lambda message: (
        message.get("name") == "/rover" and list(message.get("position", ())) == place
    )


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
            seen = []
            while not any(map(is_named("/rover"), seen)):
                data = view.recv(timeout=PATIENCE_S)
                seen, sent = messages(data), sent + len(data)
        assert sent < 3 * 4000


def test_the_page_is_viser_s_client_of_the_same_version(server, board):
    client, about = board
    page = client.get(f"/viewer/{about['session']}/")
    assert page.status_code == 200
    assert "hasFocus" in page.text
    again = {"If-None-Match": page.headers["etag"]}
    assert client.get(f"/viewer/{about['session']}/", headers=again).status_code == 304
    assert "frame-ancestors 'self'" in page.headers["content-security-policy"]
    assert client.get("/viewer/none/").status_code == 404


def test_one_page_serves_all_boards_and_is_kept_by_the_browser(server):
    client = server.client()
    sent = client.get("/viewer/client/?software-canvas", follow_redirects=False)
    assert (sent.status_code, sent.headers["cache-control"]) == (307, "no-cache")
    assert sent.headers["location"].endswith("/?software-canvas")
    page = client.get(f"/viewer/client/{sent.headers['location']}")
    assert page.status_code == 200
    assert "immutable" in page.headers["cache-control"]
    assert "showBoard" in page.text
    other = client.get("/viewer/client/viser-v0.0.0-00000000/", follow_redirects=False)
    assert other.status_code == 307


def test_another_version_and_garbage_are_refused_and_the_server_goes_on(server, board, caplog):
    client, about = board
    with (
        open_view(server, about["session"], "viser-v0.0.0") as view,
        pytest.raises(ConnectionClosed) as closed,
    ):
        view.recv(timeout=PATIENCE_S)
    assert PROTOCOL in closed.value.rcvd.reason
    camera = msgspec.msgpack.decode(CAMERA)
    for invalid, code in (
        (b"\x00\x01garbage", 1007),
        (b"", 1007),
        (msgspec.msgpack.encode(7), 1007),
        (msgspec.msgpack.encode({"type": "NoSuchMessage"}), 1007),
        (msgspec.msgpack.encode({**camera, "wxyz": "north"}), 1007),
        (msgspec.msgpack.encode({**camera, "image_width": "wide"}), 1007),
        (msgspec.msgpack.encode({**camera, "position": [0.0, 0.0, 1e308]}), 1007),
        (msgspec.msgpack.encode({**camera, "look_at": [float("nan"), 0.0, 0.0]}), 1007),
        (msgspec.msgpack.encode({**camera, "fov": float("inf")}), 1007),
        (msgspec.msgpack.encode({**camera, "image_height": 2**63}), 1007),
        (msgspec.msgpack.encode({**camera, "position": [0.0, 1.0]}), 1007),
        ("text", 1003),
        (b"x" * 100_000, 1009),
    ):
        with open_view(server, about["session"]) as view:
            view.send(CAMERA)
            read_until(view, is_named("/border"))
            view.send(invalid)
            with pytest.raises(ConnectionClosed) as closed:
                read_until(view, lambda _: False)
            assert closed.value.rcvd.code == code, invalid[:40]
            assert "expected" in closed.value.rcvd.reason
    assert [record.getMessage() for record in caplog.records if record.levelname == "ERROR"] == []
    assert client.get("/api/health").status_code == 200


def test_a_viewer_cannot_ask_for_a_public_tunnel(server, board, monkeypatch):
    asked = []
    share = "viser._viser.ViserServer.request_share_url"
    monkeypatch.setattr(share, lambda *_, **__: asked.append(1))
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
    viewer, lobby = server.services.viewer, server.services.lobby
    eventually(lambda: viewer.clients == 0)
    gc.collect()
    eventually(lambda: not viewer._tasks)
    assert lobby.in_memory(about["session"]).channel.subscribers == 0


def twins():
    """Two running episodes whose terrains differ in the far corner, behind a wall."""
    wall = np.zeros((9, 12), bool)
    wall[:8, 5] = True
    other = wall.copy()
    other[0:3, 9:] = True
    config = EnvConfig(rows=9, cols=12)
    return [Episode.begin(config, terrain=terrain) for terrain in (wall, other)]


def encode(message):
    """One message as it goes over the wire, its arrays with it."""
    blobs = []
    body = msgspec.msgpack.encode(message.as_serializable_dict(blobs))
    return body + b"".join(bytes(blob) for blob in blobs)


def record(episode, actions=(), options=None):
    """Every message, encoded, of a scene that shows an episode and its moves."""

    async def run():
        viewer, sent = Viewer(), []
        transport = viewer._server._websock_server
        transport.queue_message = lambda message: sent.append(encode(message))
        shown = View(episode) if isinstance(episode, Episode) else episode
        picture = Scene(viewer._server.scene, shown, False, options or ViewOptions())
        for action in actions:
            episode.step(action)
            picture.show(View(episode))
            picture.glide(0.5)
            picture.glide(1.0)
        viewer.close()
        return sent

    return asyncio.run(run())


@pytest.mark.parametrize("has_effects", [False, True])
def test_the_scene_shows_nothing_of_what_is_hidden(has_effects):
    """Terrains that agree on every seen cell give the same messages, byte for byte."""
    one, other = twins()
    actions = (2, 1, 1, 2, 0, 3)
    options = ViewOptions(has_effects=has_effects)
    first, second = record(one, actions, options), record(other, actions, options)
    assert (one.terrain != other.terrain).any()
    assert (one.codes == other.codes).all()
    assert len(first) > 30
    assert first == second


def luminance(colour):
    """Of sRGB 0..255, as contrast is reckoned with it."""
    share = np.asarray(colour) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722)) + 0.05


@pytest.mark.parametrize("colours", [NIGHT, DAY])
def test_unknown_ground_lies_lower_than_known_and_the_lidar_s_range_stands_out_from_it(colours):
    codes = np.full((9, 12), UNKNOWN, np.uint8)
    codes[2:5, 3:6] = FREE
    picture = np.asarray(Image.open(io.BytesIO(fog(codes, colours))))
    scale = picture.shape[0] // 9
    south, east, west = (
        picture[row * scale :, col * scale :] for row, col in ((5, 4), (3, 6), (3, 2))
    )
    assert [south[0, 1], south[scale - 1, 1]] == [CLIFF, NEAR], "the camera looks at that cliff"
    assert [east[1, 0], east[1, scale - 1]] == [SHADOW, NEAR], "the sun stands in the west"
    assert (west[:scale, :scale] == NEAR).all()
    deepest = luminance(list(colours.fog[-3:]))
    for accent in (colours.player, colours.rival):
        ratio = luminance(colours.line * np.array(accent)) / deepest
        assert max(ratio, 1 / ratio) > 3


def test_the_lidar_sweeps_in_each_move_where_effects_are_wished_for():
    def about_sweep(options):
        return [message for message in record(twins()[0], (2, 1), options) if b"/sweep" in message]

    assert about_sweep(ViewOptions()) == []
    messages = about_sweep(ViewOptions(has_effects=True))
    shown = [
        b"visible\xc3" in message for message in messages if b"SetSceneNodeVisibility" in message
    ]
    changes = [now for before, now in pairwise(shown) if now != before]
    assert changes == [True, False] * 2, "once a move"
    assert len({message for message in messages if b"wxyz" in message}) > 2, "it turns"


def test_the_scene_never_asks_for_the_terrain():
    episode, _ = twins()
    seen = ("config", "codes", "position", "heading", "path", "steps", "outcome")
    blind = SimpleNamespace(**{name: getattr(episode, name) for name in seen})
    assert record(blind) == record(twins()[0])


def test_a_new_episode_puts_the_rover_back_and_takes_old_rocks_and_trail_away(server, board):
    client, about = board
    with open_view(server, about["session"]) as view:
        view.send(CAMERA)
        read_until(view, is_named("/border"))
        assert move(client, about["session"], "east")["position"] == [0, 1]
        read_until(view, is_rover_at([1.0, 0.0, 0.0]))
        client.post(f"/api/sessions/{about['session']}/episodes", json={"size": [9, 12], "seed": 4})
        seen = read_until(view, is_rover_at([0.0, 0.0, 0.0]))
    assert any(m["type"].startswith("Remove") and m["name"].startswith("/trail/") for m in seen)


AMBER, TEAL = [255, 179, 71], [95, 208, 197]


def move(client, session, action):
    frame = client.get(f"/api/sessions/{session}").json()
    act = {"episode": frame["episode"], "step": frame["step"], "action": action}
    return client.post(f"/api/sessions/{session}/act", json=act).json()


def read_all(view, name):
    """Every message up to one about a node of that name, and all until silence."""
    seen = []
    with suppress(TimeoutError):
        while True:
            patience_s = 0.5 if any(map(is_named(name), seen)) else PATIENCE_S
            seen += messages(view.recv(timeout=patience_s))
    return seen


def is_about_paired_path(message):
    return str(message.get("name")).startswith("/paired_path/")


def is_paired_path(message):
    return is_about_paired_path(message) and not message["type"].startswith("Remove")


def begin_race(client):
    """A board and its rival's on the same terrain; their sessions."""
    body = {"size": [9, 12], "seed": 3, "rival": "frontier-cost"}
    about = client.post("/api/sessions", json=body).json()
    return about["session"], about["rival"]["session"]


def colour_of(message):
    return list(message["props"]["color"])


def test_each_view_shows_the_other_path_when_the_player_has_ended_and_not_before(server):
    client = server.client()
    mine, other = begin_race(client)
    with open_view(server, mine) as view, open_view(server, other) as other_view:
        for socket in (view, other_view):
            socket.send(CAMERA)
            read_until(socket, is_named("/border"))
        for number, action in enumerate(("east", "west", "east"), 1):
            assert move(client, mine, action)["outcome"] is None
            eventually(lambda: client.get(f"/api/sessions/{other}").json()["step"] == number)  # noqa: B023
        assert move(client, mine, "north")["outcome"] == "out_of_bounds"
        for socket, colour in ((view, TEAL), (other_view, AMBER)):
            seen = read_until(socket, is_paired_path)
            assert colour_of(seen[-1]) == colour
            ended = next(
                number
                for number, message in enumerate(seen)
                if message.get("name") == "/rover" and number > 0
            )
            assert not any(map(is_paired_path, seen[:ended]))
        # the rival goes on alone, and its path with it
        steps = client.get(f"/api/sessions/{other}").json()["step"]
        read_until(view, is_paired_path)
        assert eventually(lambda: client.get(f"/api/sessions/{other}").json()["step"] > steps)
        client.post(f"/api/sessions/{mine}/episodes", json={"size": [9, 12], "seed": 4})
        gone = read_until(
            view, lambda message: is_about_paired_path(message) and not is_paired_path(message)
        )
        # Messages without these move or show a node.
        drawn = [message for message in gone if is_paired_path(message) and "props" in message]
        assert all(colour_of(message) == TEAL for message in drawn)


def test_nothing_of_the_other_s_path_is_sent_while_the_player_is_still_moving(server):
    client = server.client()
    mine, other = begin_race(client)
    with open_view(server, mine) as view:
        view.send(CAMERA)
        client.post(f"/api/sessions/{other}/pace", json={"moves_per_second": 20})
        eventually(lambda: client.get(f"/api/sessions/{other}").json()["step"] > 4)
        move(client, mine, "east")
        seen = read_all(view, "/trail/0")
    assert not any(is_paired_path(message) for message in seen)


def test_a_policy_that_replays_an_ended_episode_has_the_rival_s_colour_and_leaves_its_path_there(
    server,
):
    client = server.client()
    about = client.post("/api/sessions", json={"size": [9, 12], "seed": 3}).json()
    body = {"size": [9, 12], "seed": 3, "player": "frontier-cost", "replays": about["session"]}
    assert client.post("/api/sessions", json=body).status_code == 422, "it has not ended"
    with open_view(server, about["session"]) as view:
        view.send(CAMERA)
        seen = read_until(view, is_named("/border"))
        move(client, about["session"], "east")
        assert move(client, about["session"], "north")["outcome"] == "out_of_bounds"
        assert client.post("/api/sessions", json={**body, "player": "human"}).status_code == 422
        assert client.post("/api/sessions", json={**body, "replays": "none"}).status_code == 404
        replay = client.post("/api/sessions", json=body).json()
        seen += read_until(view, is_paired_path)
        assert colour_of(seen[-1]) == TEAL
    boards = ((about["session"], AMBER, TEAL), (replay["session"], TEAL, AMBER))
    for session, colour, paired in boards:
        with open_view(server, session) as view:
            view.send(CAMERA)
            seen = read_until(view, is_paired_path)
            assert colour_of(next(filter(is_named("/rover/deck"), seen))) == colour
            assert colour_of(seen[-1]) == paired


def test_a_view_is_drawn_as_its_address_wishes(server):
    client = server.client()
    about = client.post("/api/sessions", json={"size": [9, 12], "seed": 3, "rival": "ppo"}).json()
    rival = about["rival"]["session"]
    eventually(lambda: client.get(f"/api/sessions/{rival}").json()["step"] == 0)

    def first_picture(query):
        with open_view(server, f"{rival}{query}") as view:
            view.send(CAMERA)
            return read_all(view, "/border")

    plain, full = first_picture(""), first_picture("?camera=follow&effects=on")
    assert not any(message.get("name") == "/shade" for message in plain)
    assert any(message.get("name") == "/shade" for message in full)
    looks = []
    for seen, hazes in ((plain, 0), (full, 1)):
        assert [message["type"] for message in seen].count("FogMessage") == hazes, (
            "haze is an effect"
        )
        turns = [message for message in seen if message["type"] == "SetCameraLookAtMessage"]
        looks.append(turns[-1]["look_at"])
    assert looks[0][0] == 5.5
    assert looks[1] == [0.0, 0.0, 0.0], "it follows the rover in the north-west"


def test_large_boards_are_followed_unless_the_map_is_wished_for():
    assert not ViewOptions().follows(21, 21)
    assert ViewOptions().follows(12, 22)
    assert not ViewOptions.from_query({"camera": "map"}).follows(84, 84)
    followed = ViewOptions.from_query({"camera": "follow", "effects": "on"})
    assert followed == ViewOptions("follow", True, False)
    assert ViewOptions.from_query({"camera": "no such", "effects": "1"}) == ViewOptions()


def test_a_replay_on_another_terrain_leaves_no_path(server):
    client = server.client()
    about = client.post("/api/sessions", json={"size": [9, 12], "seed": 3}).json()
    move(client, about["session"], "east")
    move(client, about["session"], "north")
    body = {"size": [9, 12], "seed": 4, "player": "frontier-cost", "replays": about["session"]}
    other = client.post("/api/sessions", json=body).json()["session"]
    eventually(lambda: client.get(f"/api/sessions/{other}").json()["step"] > 2)
    with open_view(server, about["session"]) as view:
        view.send(CAMERA)
        seen = read_all(view, "/trail/0")
    assert not any(is_paired_path(message) for message in seen)


def test_a_dash_lies_over_the_middle_of_each_step_once():
    corners, faces = dashes([(0, 0), (0, 1), (0, 0), (0, 0)])
    assert corners.shape == (4, 3)
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    expected = [(0.2, -0.11), (0.2, 0.11), (0.8, -0.11), (0.8, 0.11)]
    assert np.allclose(sorted(map(tuple, corners[:, :2])), expected)
    corners, _ = dashes([(3, 2), (4, 2)])
    middle = corners[:, :2].mean(axis=0)
    assert np.allclose(middle, (2, -3.5)), "x is the column, y the row southward"
    assert np.ptp(corners[:, 1]) > np.ptp(corners[:, 0])


@pytest.mark.parametrize(("rows", "cols"), [(21, 21), (5, 40), (40, 5), (84, 84), (9, 12)])
@pytest.mark.parametrize("aspect", [0.4, 0.83, 1.0, 1.8, 3.0])
def test_the_whole_board_is_in_sight_and_nearly_fills_it(rows, cols, aspect):
    """Projected by hand: the ground's corners are in view, one near its edge."""
    y, distance = camera_for(rows, cols, aspect)
    eye = np.array([(cols - 1) / 2, y - distance * np.cos(TILT), distance * np.sin(TILT)])
    ahead = np.array([0, np.cos(TILT), -np.sin(TILT)])
    up = np.array([0, np.sin(TILT), np.cos(TILT)])
    places = []
    for y, x in product((0.5, 0.5 - rows), (-0.5, cols - 0.5)):
        ray = np.array((x, y, 0)) - eye
        depth = ray @ ahead * np.tan(FOV / 2)
        places.append((ray[0] / depth / aspect, ray @ up / depth))
    assert np.abs(places).max() <= 1
    assert np.abs(places).max() > 0.8
    assert places[0][1] > places[2][1], "north is at the top"
    assert places[0][0] < places[1][0], "west is at the left"


def test_a_scene_that_fails_is_logged_and_closes_its_socket(server, board, monkeypatch, caplog):
    _, about = board

    def fail(*_):
        raise RuntimeError("the scene cannot be drawn")

    monkeypatch.setattr("humanplay.tasks.mars.viewer3d.viewer.Scene.show", fail)
    with open_view(server, about["session"]) as view:
        view.send(CAMERA)
        with pytest.raises(ConnectionClosed):
            read_until(view, lambda _: False)
    assert "the scene cannot be drawn" in caplog.text
    assert eventually(lambda: server.services.viewer.clients == 0)


@pytest.mark.parametrize(("side", "waits"), [(9, False), (84, True)])
def test_a_large_boards_ground_goes_before_its_rover_where_the_processor_draws(side, waits):
    async def run():
        viewer = Viewer()
        episode = Episode.begin(EnvConfig.of("random", side), seed=5)
        picture = Scene(viewer._server.scene, View(episode), False, ViewOptions())
        places = [picture.rover_place]
        for action in (1, 1, 2):  # some moves may have come before the next picture
            if not episode.ended:
                episode.step(action)
        picture.show(View(episode))
        assert picture.rover_waits is waits
        places.append(picture.rover_place)
        picture.glide(1.0)
        places.append(picture.rover_place)
        viewer.close()
        return places

    before, shown, after = asyncio.run(run())
    assert (shown == before) is waits, "the rover stays until its ground has been drawn"
    assert after != before
