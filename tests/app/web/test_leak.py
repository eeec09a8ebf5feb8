"""Nothing hidden leaks: equal sights give equal streams, byte for byte.

Two servers with the same ids, clock and secret play the same moves on two terrains. Up to the first move that shows a
difference, all that leaves them must be equal: the play socket, HTTP, and the 3-D socket once it is decompressed.
"""

import functools
import itertools
import secrets
import shutil
import struct
from contextlib import ExitStack
from dataclasses import dataclass, field
from types import SimpleNamespace
from uuid import UUID

import pytest

from humanplay.board.sources import Sources
from humanplay.db.store import Store
from humanplay.study.folder import Study
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load
from tests.support.page_loads import LOAD
from tests.support.servers import PATIENCE_S, eventually
from tests.support.study import Person, freeze
from tests.support.viewer3d import View

FIRST_SEED = 7_000_000_000_000_001
"""Large enough that its digits and bytes come up in no stream by chance."""
POLICY_SEED = 5
RIVAL = "frontier-cost"
PATH = [1, 2] * 6


def sights(config, seed, rival, moves=None):
    """What a player and a rival know after 0, 1, 2, ... moves along PATH.

    Both end with the first end.
    """
    player, beside = Episode.begin(config, seed=seed), Episode.begin(config, seed=seed)
    policy = load(RIVAL)
    policy.reset(POLICY_SEED)
    seen = [(player.codes.tobytes(), beside.codes.tobytes())]
    for action in PATH[:moves]:
        player.step(action)
        if rival:
            beside.step(policy.act(beside.codes.copy()))
        if player.ended or beside.ended:
            break
        seen.append((player.codes.tobytes(), beside.codes.tobytes()))
    return seen


def agreement(one, other):
    """For how many entries two lists agree from their beginnings."""
    differ = (n for n, (a, b) in enumerate(zip(one, other, strict=False)) if a != b)
    return next(differ, min(len(one), len(other)))


@functools.cache
def twins(config, rival, at_least=4):
    """Two seeds whose terrains look the same for the first moves.

    With the number of the first move that tells them apart.
    """
    first_seeds = {}
    for seed in range(FIRST_SEED, FIRST_SEED + 5000):
        earlier = first_seeds.setdefault(tuple(sights(config, seed, rival, at_least - 1)), seed)
        if earlier != seed:
            one, other = (sights(config, twin_seed, rival) for twin_seed in (earlier, seed))
            moves = agreement(one, other)
            if at_least <= moves < min(len(one), len(other)):
                return earlier, seed, moves
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


class Recorder:
    """Plays PATH on a seed's terrain, and records what every route answers.

    The seed is the server's own draw.
    """

    more = ()

    def __init__(self, server, stack, body):
        self.server, self.tape = server, Tape([[]])
        self.client = server.client()
        begun = self.begin(body)
        self.ids = [begun["session"], *([begun["rival"]["session"]] if begun["rival"] else [])]
        self.frame, self.watch = begun["frame"], begun["watch"]
        self.sockets = [
            stack.enter_context(server.socket(id_, self.client)).connection for id_ in self.ids
        ]
        self.views = [View(server, id_, stack, self.client) for id_ in self.ids]
        for number, (socket, view) in enumerate(zip(self.sockets, self.views, strict=True)):
            count = 3 if number else 2  # frame, history, a rival's pace
            self.tape.add(*(socket.recv(PATIENCE_S).encode() for _ in range(count)))
            self.tape.add(*view.read("/border", "ReplayDone"))
        self.ask_everything()

    def begin(self, body):
        """Begin a board and return what it answers."""
        return self.answer("POST", "/api/sessions", json=body).json()

    def send(self, action):
        """Make a move and return its frame."""
        return self.answer("POST", f"/api/sessions/{self.ids[0]}/act", json=self.act(action)).json()

    def act(self, action):
        answers = {name: self.frame[name] for name in ("episode", "step")}
        return {**answers, "action": ACTIONS[action]}

    def answer(self, method, url, **rest):
        response = self.client.request(method, url, **rest)
        varying = ("date", "x-request-id")
        headers = sorted(header for header in response.headers.items() if header[0] not in varying)
        self.tape.add(f"{response.status_code} {headers}".encode(), response.content)
        return response

    def ask_everything(self):
        """Ask every route that has anything to do with the sessions."""
        for id_ in self.ids:
            for more in ("", "/about", "/history"):
                self.answer("GET", f"/api/sessions/{id_}{more}")
        lists = (
            "episodes?limit=9",
            "human-level",
            "health",
            "export/episodes.csv",
            "export/steps.csv",
        )
        episode = self.frame["episode"]
        of_episode = (f"episodes/{episode}", f"watch/{episode}", f"watch/{self.watch}")
        for url in (*lists, *of_episode, *self.more):
            self.answer("GET", f"/api/{url}")

    def move(self, action):
        """Make one move and keep what it sets off, a stale repeat of it included."""
        self.tape.moments.append([])
        act = self.act(action)
        self.frame = self.send(action)
        if len(self.ids) > 1:
            rival = f"/api/sessions/{self.ids[1]}"
            eventually(lambda: self.client.get(rival).json()["step"] == self.frame["step"])
        for socket, view in zip(self.sockets, self.views, strict=True):
            self.tape.add(socket.recv(PATIENCE_S).encode())
            self.tape.add(*view.read("/trail/"))
        assert self.answer("POST", f"/api/sessions/{self.ids[0]}/act", json=act).status_code == 409
        self.ask_everything()


class ParticipantRecorder(Recorder):
    """Plays PATH in a phase of a study, over the participant's socket.

    It asks the study's routes, and a stranger's as well.
    """

    more = ("studies", "studies/twins", "studies/twins/me", "studies/twins/debrief/0")

    def begin(self, phase):
        person = Person(self.server, "twins", self.client)
        person.to_warm_up()
        while (state := person.me())["stage"] != phase:
            person.call("next")
            person.call("give-up", {name: person.frame[name] for name in ("episode", "step")})
        self.tape.add(str(state).encode(), str(person.call("next")).encode())
        return person.where["about"]

    def send(self, action):
        with self.server.socket(self.ids[0], self.client) as socket:
            before = socket.receive("frame")
            socket.send({"kind": "act", **self.act(action), "input": "key", "client_ms": 1.0})
            frame = socket.frame_after(before["step"])
            event = {"kind": "keydown", "code": "KeyW", "client_ms": 1.0, "step": frame["step"]}
            batch = {"batch": secrets.token_hex(8), "episode": frame["episode"]}
            socket.send({"kind": "events", **batch, **LOAD, "events": [event]})
            socket.send({"kind": "history"})
            self.tape.add(str(frame).encode(), str(socket.receive("history")).encode())
        return frame

    def ask_everything(self):
        super().ask_everything()
        participant, self.client = self.client, self.server.client()
        super().ask_everything()
        self.client = participant


def sources(seed):
    """IDs that count, a clock that stands, and a draw that gives the seed first."""
    numbers, draws = itertools.count(), itertools.chain([seed], itertools.repeat(POLICY_SEED))

    def name():
        return f"id-{next(numbers):04}"

    return Sources(name, name, name, lambda: next(draws), lambda: 1_700_000_000_000, name, name)


@pytest.fixture
def recorded(serve, tmp_path, monkeypatch):
    """`recorded(seed, body, moves, recorder)` returns the recorder with its tape."""
    monkeypatch.setattr(Store, "secret", lambda self: "the same for all")

    def run(seed, body, moves, recorder=Recorder):
        numbers = itertools.count(1)  # viser's names for its panels
        names = SimpleNamespace(uuid4=lambda: UUID(int=next(numbers) << 96))
        monkeypatch.setattr("viser._gui_api.uuid", names)
        folder = tmp_path / str(seed)
        folder.mkdir(exist_ok=True)
        server = serve(sources(seed), database=folder / "playground.db")
        with ExitStack() as stack:
            played = recorder(server, stack, body)
            for action in PATH[:moves]:
                played.move(action)
        return played

    return run


def writings(seed):
    """The ways in which a number may stand in a stream."""
    numbers = [struct.pack(order + kind, seed) for order in "<>" for kind in "Qd"]
    return [str(seed).encode(), f"{seed:x}".encode(), *numbers]


def check_twins(recorders, seeds, moves):
    """The tapes are equal up to the first move with a difference, and hold no seed."""
    first, second = (recorder.tape for recorder in recorders)
    for number in range(moves):
        assert len(first.moments[number]) > 20
        assert first.moments[number] == second.moments[number], f"after {number} moves"
    assert first.moments[moves] != second.moments[moves], "tapes show the first difference"
    for tape, seed in zip((first, second), seeds, strict=True):
        assert not [text for text in writings(seed) if text in tape.bytes]


@pytest.mark.parametrize(("size", "rival"), [((9, 14), None), ((24, 17), RIVAL)])
def test_what_nobody_has_seen_leaves_no_trace_in_any_stream(recorded, size, rival):
    config = EnvConfig.of("random", size)
    one, other, moves = twins(config, rival is not None)
    terrains = [Episode.begin(config, seed=seed).terrain for seed in (one, other)]
    assert (terrains[0] != terrains[1]).any()
    body = {"size": list(size), "rival": rival}
    check_twins([recorded(seed, body, moves) for seed in (one, other)], (one, other), moves)


@pytest.fixture
def studied(recorded, tmp_path, monkeypatch):
    """`studied(seed, phase, moves, size)` returns a participant's recorder."""
    frozen = []

    def run(seed, phase, moves, size):
        if not frozen:
            freeze(tmp_path / "first", "twins", warm_up=1, ranked=1, size=size)
            frozen.append(tmp_path / "first")
        # the same files: protocol, hash, commitment
        studies = tmp_path / str(seed) / "playground.db-studies"
        shutil.copytree(frozen[0], studies)
        label = {"warm_up": "warm-up", "ranked": "ranked"}[phase]
        seeds = {label: seed}
        monkeypatch.setattr(Study, "seed", lambda self, asked, i: seeds.get(asked, FIRST_SEED - 1))
        return recorded(seed, phase, moves, ParticipantRecorder)

    return run


@pytest.mark.parametrize(("size", "phase"), [((9, 14), "ranked"), ((17, 12), "warm_up")])
def test_what_a_participant_has_not_seen_leaves_no_trace_in_a_studys_streams(studied, size, phase):
    one, other, moves = twins(EnvConfig.of("random", size), False)
    check_twins([studied(seed, phase, moves, size) for seed in (one, other)], (one, other), moves)


def test_the_seed_is_published_once_the_episode_is_over_and_not_before(recorded):
    """The search does find a seed: in what a finished episode publishes."""
    recorder = recorded(FIRST_SEED, {"size": [9, 14]}, 2)
    assert str(FIRST_SEED).encode() not in recorder.tape.bytes
    recorder.client.post(f"/api/sessions/{recorder.ids[0]}/episodes")
    ended = recorder.client.get(f"/api/episodes/{recorder.frame['episode']}").json()
    assert ended["seed"] == FIRST_SEED
