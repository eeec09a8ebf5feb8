"""Boards of an environment in processes of their own, so that one that crashes, hangs or takes all memory ends itself alone.

`Boards` starts one process for each task, which imports the environment and forks another for each board. It is executed
anew, with few variables of the environment and none of the server's descriptors. Messages are JSON of limited length. This
guards against faults, not against malice: the processes belong to the server's user and reach the network as it does.

`python -m app.tasks.gymnasium.boards TASK` is that process.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from pathlib import Path
from typing import Any, NoReturn
from weakref import WeakSet

from app.task import RunEndedError, TaskFullError, rules_of
from app.tasks.gymnasium.description import described
from app.tasks.gymnasium.rules import FAILED, GymnasiumConfig, GymnasiumRun, GymnasiumView

STEP_CPU_S = 2.0
"""Seconds of processor that a step, a reset or a picture may take."""
START_S = 120.0
"""Seconds in which a task's process must have imported the environment and drawn it once."""
WAIT_S = 30.0
"""Seconds until the server no longer waits for an answer."""
ALL_OF_MEMORY = 0.5
"""Share of the machine's memory that all boards may take before no further one begins."""
MESSAGE_BYTES = 32 * 2**20
LOOK_S = 0.05
"""How often the memory of a board that has not answered is looked at."""
THREADS = 64
"""Steps that can be waited for at once."""
STEPS_AN_ANSWER = 1000
"""While an episode is replayed, the process says after so many steps that it goes on."""
KEPT = ("PATH", "HOME", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "VIRTUAL_ENV")
FIXED = {
    "PYTHONHASHSEED": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "SDL_VIDEODRIVER": "dummy",
    "SDL_AUDIODRIVER": "dummy",
}


class _LostError(Exception):
    """A board's process is gone or gave no answer; the text says what it did."""


class Boards:
    """The processes of one task's boards.

    steps_on  threads to wait for their answers on
    """

    def __init__(self, task: str) -> None:
        self.steps_on = ThreadPoolExecutor(THREADS, "boards")
        self.task, self._changing = task, threading.Lock()
        self._open = WeakSet[_Board]()
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        self._most = int(ALL_OF_MEMORY * memory)
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection

    def check_room(self) -> None:
        """Check that an episode may begin; TaskFullError where all boards take too much memory."""
        if (taken := sum(map(_Board.resident, self._open))) > self._most:
            raise TaskFullError(
                f"the boards take {taken >> 20} MB of memory, of at most {self._most >> 20} MB: try again in a minute"
            )

    def begin(self, request: Mapping[str, Any]) -> _Board:
        """Return a new process that plays what is requested; ValueError, saying why, where there is none."""
        mine, theirs = socket.socketpair()
        with self._changing, theirs:
            for attempt in (0, 1):
                try:
                    process = self._started()
                    self._connection.send_bytes(json.dumps(request).encode())
                    send_handle(self._connection, theirs.fileno(), process.pid)
                    if not self._connection.poll(START_S):
                        raise OSError(f"no answer in {START_S:g} s")
                    told = json.loads(self._connection.recv_bytes(MESSAGE_BYTES))
                    break
                except (OSError, EOFError) as error:
                    self._end()
                    if attempt:
                        mine.close()
                        raise ValueError(
                            f"the process of {self.task} has ended and does not start again"
                        ) from error
        allowed = described(self.task.partition(":")[2]).memory_mb << 20
        board = _Board(Connection(mine.detach()), told["pid"], told["resident"], allowed)
        self._open.add(board)
        return board

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is not None:
            return self._process
        mine, theirs = socket.socketpair()
        with theirs:
            paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path)
            environ = {name: os.environ[name] for name in KEPT if name in os.environ}
            self._process = subprocess.Popen(
                [sys.executable, "-m", "app.tasks.gymnasium.boards", self.task, str(theirs.fileno())],
                env={**environ, **FIXED, "PYTHONPATH": paths}, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip
        self._connection = Connection(mine.detach())
        return self._process

    def close(self) -> None:
        """End the process, and with it those of all boards."""
        self.steps_on.shutdown(wait=False)
        self._end()

    __del__ = close

    def _end(self) -> None:
        if self._process is not None:
            self._connection.close()
            self._process.kill()
            self._process.wait()
            self._process = None


class _Board:
    """The server's end of a board's process.

    shared   bytes of resident memory that the task's process has, which are counted once
    allowed  bytes that it may take beyond them
    """

    def __init__(self, connection: Connection, pid: int, shared: int, allowed: int) -> None:
        self._connection, self.pid, self._shared, self._allowed = connection, pid, shared, allowed

    def resident(self) -> int:
        """Return the resident memory that it takes by itself, in bytes."""
        return 0 if self._connection.closed else max(0, _resident(self.pid) - self._shared)

    def ask(self, action: int) -> dict[str, Any]:
        """Return what an action led to; `_LostError` where there is no answer."""
        try:
            self._connection.send_bytes(str(action).encode())
        except OSError as error:
            raise _LostError("its process had ended") from error
        return self.answer()

    def answer(self) -> dict[str, Any]:
        """Return the next answer; `_LostError` where none comes, after which the process is ended."""
        try:
            told = self._waited_for()
        except _LostError:
            self.close(kills=True)
            raise
        if "error" in told:
            self.close(kills=True)
            raise _LostError(told["error"])
        return told

    def _waited_for(self) -> dict[str, Any]:
        due = time.monotonic() + WAIT_S
        while True:
            try:
                if self._connection.poll(LOOK_S):
                    told: dict[str, Any] = json.loads(self._connection.recv_bytes(MESSAGE_BYTES))
                    if "goes_on" not in told:
                        return told
                    due = time.monotonic() + WAIT_S
                    continue
            except (EOFError, OSError) as error:
                raise _LostError(
                    f"its process ended by itself, by a crash or after {STEP_CPU_S:g} s of processor"
                ) from error
            if (taken := self.resident()) > self._allowed:
                raise _LostError(
                    f"it took {taken >> 20} MB of memory, of at most {self._allowed >> 20} MB"
                )
            if time.monotonic() > due:
                raise _LostError(f"it gave no answer in {WAIT_S:g} s")

    def close(self, kills: bool = False) -> None:
        """Let the process end; it reads that nobody listens any more."""
        self._connection.close()
        if kills and _resident(self.pid):
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)


def _resident(pid: int) -> int:
    """Return the resident memory of a process in bytes, 0 where there is none or the system does not say."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize()
    except (OSError, IndexError):
        return 0


class BoardRun(GymnasiumRun):
    """A run whose environment is in a process of its own, made again by replay once where that process is lost.

    ValueError where it cannot be made.
    """

    def __init__(self, boards: Boards, config: GymnasiumConfig, seed: int, actions: bytes) -> None:
        self.config, self.seed, self._boards = config, seed, boards
        self._described = config.description
        self.actions, self._rewards, self._scores = bytearray(), list[float](), list[float]()
        self.outcome, self.total = "running", 0.0
        try:
            self._board = self._begun(actions)
        except _LostError as error:
            raise ValueError(f"{config.level} could not be begun: {error}") from error
        self.actions += actions

    def _begun(self, actions: bytes) -> _Board:
        request = {"config": self.config.to_dict(), "seed": self.seed, "actions": list(actions)}
        board = self._boards.begin(request)
        told = board.answer()
        self._rewards, self._scores = [], []
        self._take(told)
        return board

    def _take(self, told: Mapping[str, Any]) -> None:
        self._rewards += told["rewards"]
        self._scores += told["scores"]
        self.outcome, self.total, self._digest = told["outcome"], told["total"], told["digest"]
        self._picture, self._text = told["picture"], told["text"]

    def step(self, action: int) -> float:
        """Make one move and return its reward; RuntimeError once the episode has ended, ValueError for no action.

        RunEndedError where the environment fails at this move twice: the run has ended with the moves before it.
        """
        if self.outcome != "running":
            raise RuntimeError(f"the episode has ended ({self.outcome}); begin another one")
        if not 0 <= action < len(rules_of(self._boards.task).actions):
            raise ValueError(f"expected an action of {self.config.level}, got {action}")
        try:
            told = self._board.ask(action)
        except _LostError:
            try:
                self._board = self._begun(bytes(self.actions))
                told = self._board.ask(action)
            except (_LostError, ValueError) as error:
                self._board.close()
                self.outcome = FAILED
                raise RunEndedError(
                    f"{self.config.level} failed at this move, and again after it was made anew: {error}; the episode is over"
                ) from error
        self.actions.append(action)
        self._take(told)
        if self.outcome != "running":
            self._board.close()
        return self._rewards[-1]

    def abandon(self) -> None:
        """Give up: the episode ends as one that was left, with the score so far."""
        super().abandon()
        self._board.close()

    def view(self) -> GymnasiumView:
        """Return what may be seen of the run as it stands."""
        return GymnasiumView(self, self._picture, self._text)

    def observation(self) -> Any:
        """Raise LookupError: what the environment shows a policy does not leave its process."""
        raise LookupError("the observation of a board stays in the environment's process")

    @property
    def digest(self) -> str:
        """SHA-256 (hex) over configuration, seed, moves, rewards and observations."""
        return str(self._digest)


def _serve(task: str, descriptor: int) -> None:
    """Fork a board for each request, until nobody asks any more."""
    connection = Connection(descriptor)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.nice(5)  # a board that takes all it can get gives way to the server
    rules_of(task).prepare()
    while True:
        try:
            request = json.loads(connection.recv_bytes(MESSAGE_BYTES))
            board = recv_handle(connection)
        except EOFError:
            return
        if (pid := os.fork()) == 0:
            connection.close()
            _play(task, request, Connection(board))
        os.close(board)
        told = {"pid": pid, "resident": _resident(os.getpid())}
        connection.send_bytes(json.dumps(told).encode())


def _play(task: str, request: Mapping[str, Any], connection: Connection) -> NoReturn:
    """Play one board in a process forked for it: answer each action until nobody asks any more."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: it ends with what forked it
    try:
        _timed()
        run = GymnasiumRun(rules_of(task).configuration(request["config"]), request["seed"])
        for step, action in enumerate(request["actions"]):
            _timed()
            run.step(action)
            if step % STEPS_AN_ANSWER == STEPS_AN_ANSWER - 1:
                connection.send_bytes(json.dumps({"goes_on": step}).encode())
        since = -1
        while True:
            connection.send_bytes(json.dumps(_told(run, since)).encode())
            since = len(run.actions)
            signal.setitimer(signal.ITIMER_PROF, 0)
            action = int(connection.recv_bytes(100))
            _timed()
            run.step(action)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        os._exit(0)
    except BaseException as error:
        said = f"{type(error).__name__}: {error}"[:500]
        connection.send_bytes(json.dumps({"error": said}).encode())
        os._exit(1)


def _timed() -> None:
    """Let the system end this process by SIGPROF after so much of the processor."""
    signal.setitimer(signal.ITIMER_PROF, STEP_CPU_S)


def _told(run: GymnasiumRun, since: int) -> dict[str, Any]:
    """Return what is told of a run: its figures, those since so many moves (-1: all), and its picture."""
    shown = run.view()
    return {
        "rewards": list(run.rewards()[max(since, 0) :]),
        "scores": list(run.scores()[since + 1 :]),
        "outcome": run.outcome,
        "total": run.total,
        "digest": run.digest,
        "picture": shown.picture,
        "text": shown.text,
    }


if __name__ == "__main__":
    _serve(sys.argv[1], int(sys.argv[2]))
