"""Until a move is recorded, every reader sees what was published last.

Another connection holds the database's lock.
"""

import asyncio
import json
from contextlib import ExitStack

import msgspec
import pytest

from humanplay.tasks.mars.run import View
from humanplay.web.admin import board_messages
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Episode
from tests.support.servers import eventually
from tests.support.viewer3d import View as View3d
from tests.support.write_lock import locked_elsewhere

SIZE = [9, 13]


def first_of(socket_path, *kinds, ask=None):
    """What a socket that joins now is told first, by kind."""

    def read(table):
        with table.server.socket(table.link(socket_path), table.client, path=socket_path) as socket:
            if ask is not None:
                socket.send(ask)
            return [socket.receive(kind) for kind in kinds]

    return read


def get(path):
    return lambda table: table.client.get(path.format(**table.names)).text


def view_of_who_joins(table):
    with ExitStack() as stack:
        seen = View3d(table.server, table.session, stack, table.client).read("/border", "/rover")
    decoded = [msgspec.msgpack.decode(packet) for packet in seen]
    return [message | {"owner": None} for message in decoded if "name" in message]


def operators_stream(table):
    async def first():
        messages = board_messages(table.server.services.store, table.board)
        message = await anext(messages)
        await messages.aclose()
        return json.loads(message)

    return table.server.on_loop(first())


READERS = {
    "a second socket": first_of("/ws/sessions/", "frame", "history"),
    "a history that is asked for": first_of(
        "/ws/sessions/", "history", "history", ask={"kind": "history"}
    ),
    "a spectator's socket": first_of("/ws/watch/", "frame", "history"),
    "a spectator over HTTP": get("/api/watch/{watch}"),
    "the frame over HTTP": get("/api/sessions/{session}"),
    "the history over HTTP": get("/api/sessions/{session}/history"),
    "the board over HTTP": get("/api/sessions/{session}/about"),
    "the 3-D view": view_of_who_joins,
    "the operator": operators_stream,
}


class Table:
    """A paused policy's board, whose next move waits for the lock."""

    def __init__(self, server):
        self.server, self.client = server, server.client()
        wanted = {"size": SIZE, "seed": 5, "player": "frontier-cost"}
        about = self.client.post("/api/sessions", json=wanted).json()
        self.session = about["session"]
        self.names = {"session": self.session, "watch": about["watch"]}
        self.board = server.services.lobby.in_memory(self.session)
        self.agent = server.services.lobby._groups[self.session].agents[self.session]
        self.pace(pause=True)
        self.pace(step=True)
        eventually(self.has_come_to_rest)

    def has_come_to_rest(self):
        """Whether no move is under way and the policy has decided on the newest frame."""
        board = self.board
        is_moving = self.agent._single_moves or board.changing.locked()
        return bool(not is_moving and board.shown.steps and not self.agent._is_undecided())

    def pace(self, **change):
        self.client.post(f"/api/sessions/{self.session}/pace", json=change).raise_for_status()

    def link(self, path):
        return self.names["watch" if "watch" in path else "session"]


@pytest.fixture
def table(serve):
    return Table(serve())


def test_no_reader_is_told_anything_of_a_move_that_is_not_recorded(table, tmp_path):
    store, step = table.server.services.store, table.board.shown.steps
    before = {name: read(table) for name, read in READERS.items()}
    with locked_elsewhere(tmp_path / "playground.db"):
        table.server.on_loop(asyncio.sleep(0, table.agent.move_once()))
        eventually(lambda: table.board.changing.locked() and len(store.writes))
        for name, read in READERS.items():
            assert read(table) == before[name], name
        assert table.board.changing.locked(), "the move is held back still"
    eventually(lambda: table.board.shown.steps == step + 1)
    for name, read in READERS.items():
        assert read(table) != before[name], name


def test_a_rival_neither_decides_nor_moves_before_its_players_move_is_recorded(serve, tmp_path):
    server = serve()
    client, lobby = server.client(), server.services.lobby
    wanted = {"size": SIZE, "seed": 5, "rival": "frontier-cost"}
    about = client.post("/api/sessions", json=wanted).json()
    player, rival = (
        lobby.in_memory(session) for session in (about["session"], about["rival"]["session"])
    )
    agent = lobby._groups[player.id].agents[rival.id]
    eventually(lambda: not agent._is_undecided())
    with server.socket(player.id, client) as socket:
        frame = socket.receive("frame")
        with locked_elsewhere(tmp_path / "playground.db"):
            socket.act(frame, "south")
            eventually(player.changing.locked)
            asked = client.get(f"/api/sessions/{rival.id}").json()["step"]
            assert (asked, rival.changing.locked(), len(server.services.store.writes)) == (
                0,
                False,
                1,
            )
        assert socket.frame_after(0)["step"] == 1
    eventually(lambda: rival.shown.steps == 1)


def test_a_run_whose_move_was_not_recorded_is_made_again_and_goes_on(server):
    """Refused moves leave the board as it was, an ending move and an abandonment too."""
    client = server.client()
    about = client.post("/api/sessions", json={"size": SIZE, "seed": 5}).json()
    path, episode = f"/api/sessions/{about['session']}", about["frame"]["episode"]

    def act(step, action):
        body = {"episode": episode, "step": step, "action": action}
        return client.post(f"{path}/act", json=body)

    twin = Episode.begin(EnvConfig.of("random", SIZE), seed=5)
    for step, action in enumerate((2, 0)):
        twin.step(action)
        assert act(step, ACTIONS[action]).text == View(twin).frame(episode)
    frame = client.get(path).text
    server.execute("PRAGMA query_only = ON")
    assert [act(2, action).status_code for action in ("south", "north")] == [503, 503]
    assert client.post(f"{path}/episodes", json={}).status_code == 503
    assert client.get(path).text == frame
    server.execute("PRAGMA query_only = OFF")
    for step, action in enumerate((2, 0, 0), 2):
        twin.step(action)
        assert act(step, ACTIONS[action]).text == View(twin).frame(episode)
    assert twin.outcome == "out_of_bounds"
    record = server.services.store.load_record(episode)
    assert record.trajectory_hash == twin.record().trajectory_hash
