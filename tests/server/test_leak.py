"""Nothing hidden leaks: terrains that agree on all that was seen give the same streams, byte for byte.

Two servers with the same ids, clock and secret play the same moves on two terrains. Up to the first move that shows a
difference, all that leaves them must be equal: the play socket, HTTP, and the 3-D socket once it is decompressed.
"""

import itertools
import struct
from contextlib import ExitStack
from dataclasses import dataclass, field
from types import SimpleNamespace
from uuid import UUID

import msgspec
import pytest
import zstandard
from conftest import eventually
from tools3d import CAMERA
from websockets.sync.client import connect

from app.agents import Policies
from app.lobby import Sources
from app.store import Store
from app.viewer import PROTOCOL
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load

FIRST_SEED = 7_000_000_000_000_001
"""Large enough that its digits and bytes come up in no stream by chance."""
POLICY_SEED = 5
RIVAL = "frontier-cost"
PATH = [1, 2] * 6


@pytest.fixture(scope="module")
def policies():
    return Policies()


def sights(config, seed):
    """What the player knows after 0, 1, 2, ... moves along PATH, and the rival beside it; both end with the first end."""
    player, rival = Episode.begin(config, seed=seed), Episode.begin(config, seed=seed)
    policy = load(RIVAL)
    policy.reset(POLICY_SEED)
    seen = [(player.codes.tobytes(), rival.codes.tobytes())]
    for action in PATH:
        player.step(action)
        rival.step(policy.act(rival.codes.copy()))
        if player.ended or rival.ended:
            break
        seen.append((player.codes.tobytes(), rival.codes.tobytes()))
    return seen


def agreement(one, other):
    """For how many entries two lists agree from their beginnings."""
    return next((n for n, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))


def twins(config, rival, at_least=4):
    """Two seeds whose terrains look the same for the first moves, and the number of the first that tells them apart."""
    known = {}
    for seed in range(FIRST_SEED, FIRST_SEED + 5000):
        seen = [sight if rival else sight[0] for sight in sights(config, seed)]
        other_seed, other = known.setdefault(tuple(seen[:at_least]), (seed, seen))
        moves = agreement(seen, other)
        if at_least <= moves < min(len(seen), len(other)):
            return other_seed, seed, moves
    raise AssertionError(f"no twins among the seeds for {config.rows}x{config.cols}")


@dataclass
class Tape:
    """All bytes that left a server, by the number of moves made when they were read."""

    moments: list[list[bytes]] = field(default_factory=list)

    def add(self, *data):
        self.moments[-1] += data

    @property
    def bytes(self):
        return b"\n".join(itertools.chain.from_iterable(self.moments))


class View:
    """A 3-D socket: its messages decompressed, their arrays put back where they belong."""

    def __init__(self, server, session, stack):
        url = f"ws://127.0.0.1:{server.port}/viewer/{session}"
        view = connect(url, subprotocols=[PROTOCOL], origin=server.url, proxy=None, compression=None, max_size=None)
        self.socket = stack.enter_context(view)
        self.socket.send(CAMERA)

    def read(self, *awaited):
        """Every message, encoded, until one has come whose name or type begins with each of the words, and what follows."""
        messages = []
        while not all(any(is_called(message, word) for message in messages) for word in awaited):
            messages += unpack(self.socket.recv(timeout=20))
        try:
            while True:
                messages += unpack(self.socket.recv(timeout=0.1))
        except TimeoutError:
            return sorted(map(msgspec.msgpack.encode, messages))


def is_called(message, word):
    return message["type"].startswith(word) or str(message.get("name")).startswith(word)


def unpack(data):
    """The messages of one batch in viser's wire format: sizes, packed messages, then the arrays on 8-byte bounds."""
    packed_length = int.from_bytes(data[8:16], "little")
    offset = 16 + packed_length
    batch = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data[16:offset]))
    arrays = []
    for length in batch["binaryBufferLengths"]:
        offset += -offset % 8
        arrays.append(bytes(data[offset : offset + length]))
        offset += length
    return [whole(message, arrays) for message in batch["messages"]]


def whole(value, arrays):
    if isinstance(value, dict) and "__binary_index" in value:
        return [value["dtype"], arrays[value["__binary_index"]]]
    if isinstance(value, dict):
        return {key: whole(each, arrays) for key, each in value.items()}
    return [whole(each, arrays) for each in value] if isinstance(value, list | tuple) else value


class Recorder:
    """Plays PATH on the terrain of a seed, the server's own draw, and keeps what every door of the server gives away."""

    def __init__(self, server, stack, body):
        self.server, self.tape = server, Tape([[]])
        self.client = server.client()
        begun = self.answer("POST", "/api/sessions", json=body).json()
        self.ids = [begun["session"], *([begun["rival"]["session"]] if begun["rival"] else [])]
        self.frame = begun["frame"]
        self.sockets = [stack.enter_context(server.socket(id_, self.client)).connection for id_ in self.ids]
        self.views = [View(server, id_, stack) for id_ in self.ids]
        for number, (socket, view) in enumerate(zip(self.sockets, self.views, strict=True)):
            self.tape.add(*(socket.recv(20).encode() for _ in range(3 if number else 2)))  # frame, history, a rival's pace
            self.tape.add(*view.read("/border", "ReplayDone"))
        self.ask_everything()

    def answer(self, method, url, **rest):
        response = self.client.request(method, url, **rest)
        headers = sorted((name, value) for name, value in response.headers.items() if name != "date")
        self.tape.add(f"{response.status_code} {headers}".encode(), response.content)
        return response

    def ask_everything(self):
        """Ask every door that has anything to do with the sessions."""
        for id_ in self.ids:
            for more in ("", "/about", "/history"):
                self.answer("GET", f"/api/sessions/{id_}{more}")
        lists = ("episodes?limit=9", "human-level", "health", *(f"export/{table}.jsonl" for table in ("episodes", "steps")))
        for url in (*lists, f"episodes/{self.frame['episode']}"):
            self.answer("GET", f"/api/{url}")

    def move(self, action):
        """Make one move and keep what it sets off, a stale repeat of it included."""
        self.tape.moments.append([])
        act = {"episode": self.frame["episode"], "step": self.frame["step"], "action": ACTIONS[action]}
        self.frame = self.answer("POST", f"/api/sessions/{self.ids[0]}/act", json=act).json()
        if len(self.ids) > 1:
            rival = f"/api/sessions/{self.ids[1]}"
            eventually(lambda: self.client.get(rival).json()["step"] == self.frame["step"])
        for socket, view in zip(self.sockets, self.views, strict=True):
            self.tape.add(socket.recv(20).encode())
            self.tape.add(*view.read("/trail/"))
        assert self.answer("POST", f"/api/sessions/{self.ids[0]}/act", json=act).status_code == 409
        self.ask_everything()


def sources(seed):
    """Ids that count, one clock reading, and a draw that gives the terrain's seed first."""
    numbers, draws = itertools.count(), itertools.chain([seed], itertools.repeat(POLICY_SEED))

    def name():
        return f"id-{next(numbers):04}"

    return Sources(name, name, name, lambda: next(draws), lambda: 1_700_000_000_000)


@pytest.fixture
def recorded(serve, tmp_path, policies, monkeypatch):
    """`recorded(seed, body, moves)` -> the tape of a server of its own, and its recorder."""
    monkeypatch.setattr(Store, "secret", lambda self: "the same for all")

    def run(seed, body, moves):
        numbers = itertools.count(1)  # viser's names for its panels
        monkeypatch.setattr("viser._gui_api.uuid", SimpleNamespace(uuid4=lambda: UUID(int=next(numbers) << 96)))
        folder = tmp_path / str(seed)
        folder.mkdir()
        server = serve(sources(seed), policies, database=folder / "playground.db")
        with ExitStack() as stack:
            recorder = Recorder(server, stack, body)
            for action in PATH[:moves]:
                recorder.move(action)
        return recorder

    return run


def writings(seed):
    """The ways in which a number may stand in a stream."""
    numbers = [struct.pack(order + kind, seed) for order in "<>" for kind in "Qd"]
    return [str(seed).encode(), f"{seed:x}".encode(), *numbers]


@pytest.mark.parametrize("rival", [None, RIVAL])
@pytest.mark.parametrize("size", [(9, 14), (24, 17)])
def test_what_nobody_has_seen_leaves_no_trace_in_any_stream(recorded, size, rival):
    config = EnvConfig.of("random", size)
    one, other, moves = twins(config, rival is not None)
    assert (Episode.begin(config, seed=one).terrain != Episode.begin(config, seed=other).terrain).any()
    body = {"size": list(size), "rival": rival}
    first, second = (recorded(seed, body, moves) for seed in (one, other))
    for number in range(moves):
        assert len(first.tape.moments[number]) > 20
        assert first.tape.moments[number] == second.tape.moments[number], f"after {number} moves"
    assert first.tape.moments[moves] != second.tape.moments[moves], "the first difference is seen, so the tapes can tell"
    for recorder, seed in ((first, one), (second, other)):
        assert not [text for text in writings(seed) if text in recorder.tape.bytes]


def test_the_seed_is_told_once_the_episode_is_over_and_not_before(recorded):
    """The search for a seed finds one where there is one: in what is told of a finished episode."""
    recorder = recorded(FIRST_SEED, {"size": [9, 14]}, 2)
    assert str(FIRST_SEED).encode() not in recorder.tape.bytes
    recorder.client.post(f"/api/sessions/{recorder.ids[0]}/episodes")
    assert recorder.client.get(f"/api/episodes/{recorder.frame['episode']}").json()["seed"] == FIRST_SEED
