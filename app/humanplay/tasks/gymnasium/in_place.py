"""An environment that its program steps: its one board, and its recordings.

The server asks that program over a connection; nothing else can step the environment. What was told of each move was
written down (`humanplay.task.recordings`), so that a finished episode is shown and exported. It is never verified.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.reduction import send_handle
from threading import Lock

import gymnasium

from humanplay import jobs
from humanplay.board.participation import RefusedError
from humanplay.task import recordings
from humanplay.task.recordings import Moment
from humanplay.tasks.gymnasium.boards import Boards
from humanplay.tasks.gymnasium.configuration import GymnasiumConfig
from humanplay.tasks.gymnasium.run import GymnasiumRun, GymnasiumView
from humanplay.tasks.gymnasium.spaces import from_json
from humanplay.tasks.gymnasium.values import unpacked
from humanplay.tasks.processes import Worker

SPACES = "spaces.json"
"""Beside the recordings of a task: its action space and its observation space."""
THREADS = 4
_programs: list[Connection] = []
jobs.pass_on(recordings.FOLDERS, recordings.looked_in)  # to the processes that show and export them


def connect(descriptor: int) -> None:
    """Let the program at the other end step the environment."""
    _programs[:] = [Connection(descriptor)]


class ProgramBoard(Boards):
    """The one board of a program that steps its environment; who begins last has it."""

    def __init__(self, task: str) -> None:
        self.task, self._beginning = task, Lock()
        self.steps_on = ThreadPoolExecutor(THREADS, "board")

    def check_room(self) -> None:
        """Do nothing: its memory is the program's."""

    def begin(self, request: Mapping[str, object]) -> Worker:
        """Return what asks the program; RefusedError if it does not listen any more."""
        mine, theirs = socket.socketpair()
        with mine, theirs, self._beginning:
            try:
                (program,) = _programs
                program.send_bytes(json.dumps(request).encode())
                send_handle(program, theirs.fileno(), 0)
            except (OSError, ValueError) as error:
                raise RefusedError(
                    "the program that steps the environment has ended; the episode goes on when it plays again"
                ) from error
            return Worker(Connection(mine.detach()), None, 0, 0)

    def close(self) -> None:
        """Take no further step."""
        self.steps_on.shutdown(wait=False)


class RecordedRun(GymnasiumRun):
    """A recorded episode as far as some actions lead; ValueError without a recording.

    Of several on one seed it is the one that had the digest of a stored episode, if that is given.
    """

    def __init__(
        self, config: GymnasiumConfig, seed: int, actions: bytes, digest: str | None = None
    ) -> None:
        self.config, self.seed = config, seed
        self._described = config.description
        self._names = self._described.actions
        self.actions, self._rewards, self._scores = bytearray(), list[float](), list[float]()
        self._allowed = []
        self.outcome, self.total = "running", 0.0
        recorded = recordings.of_seed(config.level, seed)
        candidates = [moments for moments in recorded if recordings.holds(moments, actions)]
        if not candidates:
            raise ValueError(
                f"{self._described.title} was stepped in place, and no recording of this episode is beside the database"
            )
        exact = [moments for moments in candidates if recordings.holds(moments, actions, digest)]
        self._episodes = [
            (recordings.actions_of(moments), moments)
            for moments in exact or candidates  # else `verify` finds that the digests differ
        ]
        self._take(self._episodes[0][1][0])
        for action in actions:
            self.step(action)

    def _take(self, moment: Moment) -> None:
        fields = moment.fields
        self._moment = moment
        self._rewards += fields["rewards"]
        self._scores += fields["scores"]
        self._allowed += [None if codes is None else tuple(codes) for codes in fields["allowed"]]
        self.outcome, self.total = fields["outcome"], fields["total"]

    def step(self, action: int) -> float:
        """Go on by an action and return its reward; ValueError if it was another one."""
        if self.outcome != "running":
            raise RuntimeError(f"the episode has ended ({self.outcome}); begin another one")
        step = len(self.actions)
        self._episodes = [
            episode for episode in self._episodes if episode[0][step : step + 1] == bytes([action])
        ]
        if not self._episodes:
            raise ValueError(f"nothing is recorded of the episode from move {step + 1} on")
        self.actions.append(action)
        self._take(self._episodes[0][1][step + 1])
        return self._rewards[-1]

    def view(self) -> GymnasiumView:
        """Return what was seen of the run as it stands."""
        shown = self._moment.fields["shown"]
        if shown is None:
            raise ValueError(
                "its pictures were not recorded: the recordings had reached keep_mb when it was played"
            )
        return GymnasiumView(self, shown["picture"], shown["text"])

    @property
    def newest_observation(self) -> object:
        """What the environment showed last; ValueError if it was not recorded."""
        if not self._moment.content:
            raise ValueError(
                "its observations were not recorded: the recordings had reached keep_mb when it was played"
            )
        return next(unpacked(self._moment.content))

    def observation(self) -> object:
        """Return what the environment showed last."""
        return self.newest_observation

    @property
    def digest(self) -> str:
        """SHA-256 (hex) as it was told when the episode was played."""
        return str(self._moment.fields["digest"])


class GoneEnvironment(gymnasium.Env[object, object]):
    """The spaces of an environment that is gone; it cannot be stepped."""

    def __init__(self, env_id: str) -> None:
        """Read them beside the recordings; ValueError if they are not there."""
        if (path := recordings.find(env_id, SPACES)) is None:
            raise ValueError(
                f"{env_id} was stepped in place, and its recordings are not beside the database"
            )
        described = json.loads(path.read_text("utf-8"))
        self.action_space = from_json(described["action"])
        if described["observation"] is not None:
            self.observation_space = from_json(described["observation"])
