"""An environment that a program steps in its calling thread, for one board."""

from __future__ import annotations

import hashlib
import json
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import recv_handle
from pathlib import Path
from types import FrameType
from typing import TypedDict, cast

from humanplay.cli.pilot.recreation import Env, layers_of
from humanplay.db.file import recordings_beside
from humanplay.task import counted, recordings
from humanplay.task.recordings import Moment, MomentFields, Recording
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.boards import answer_to, moment_since
from humanplay.tasks.gymnasium.configuration import own_config
from humanplay.tasks.gymnasium.description import (
    DEFAULT_LIMIT,
    IN_PLACE,
    MAX_LIMIT,
    Description,
    actions_of,
    keys_of,
)
from humanplay.tasks.gymnasium.in_place import SPACES
from humanplay.tasks.gymnasium.modules import source_hash
from humanplay.tasks.gymnasium.run import GymnasiumRun
from humanplay.tasks.gymnasium.spaces import to_json
from humanplay.tasks.gymnasium.values import packed
from humanplay.tasks.processes import send_answer, send_failure

FULL = (
    "The recordings have reached keep_mb: what is played from now on is scored, and has no replay and no observations. "
    "Pass a larger keep_mb, or another database."
)


def in_place_task(env: Env) -> str:
    """The task of an environment that this program steps; ValueError if it cannot."""
    classes = [type(layer) for layer in layers_of(env)]
    names = [f"{layer.__module__}:{layer.__qualname__} {_source_of(layer)}" for layer in classes]
    inner = type(env.unwrapped).__name__
    parts = [*names, repr(env.action_space), repr(env.observation_space)]
    hash = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:8]
    bare = Description(id=f"{IN_PLACE}:{inner}-{hash}")
    actions = actions_of(bare, env)
    keys = keys_of(bare, env, actions)
    described = Description.model_validate({
        "id": bare.id,
        "title": inner,
        "actions": actions,
        "keys": {key: name for name, pressed in keys.items() for key in pressed},
        "max_steps": _limit_of(env),
    })  # fmt: skip
    task = f"gymnasium:{described.told}"
    run = GymnasiumRun(own_config(environment_of(task).configuration({})), 0, env)
    run.check_reward()
    run.view()
    packed(run.newest_observation)
    return task


def _source_of(layer: type) -> str:
    try:
        return source_hash(layer.__module__)
    except (ImportError, ValueError):  # of a notebook or a script nothing can be found again
        return ""


def _limit_of(env: Env) -> int:
    """The environment's own limit of moves, else a thousand."""
    candidates = [None if env.spec is None else env.spec.max_episode_steps]
    candidates.append(getattr(env.unwrapped, "max_steps", None))
    limits = [limit for limit in candidates if isinstance(limit, int) and 0 < limit <= MAX_LIMIT]
    return limits[0] if limits else DEFAULT_LIMIT


class BoardRequest(TypedDict):
    """What a server asks for: an episode after some moves."""

    config: dict[str, object]
    seed: int
    actions: list[int]


class Recordings:
    """The recordings of one task, while there is room for them."""

    def __init__(self, folder: Path, env: Env, level: str, most_bytes: int) -> None:
        self._folder, self._most_bytes = recordings.folder_of(folder, level), most_bytes
        self._folder.mkdir(parents=True, exist_ok=True)
        self._bytes, self._is_full = recordings.size_of(folder), False
        spaces = {"action": to_json(env.action_space), "observation": None}
        with suppress(ValueError):  # of a package's own kind
            spaces["observation"] = to_json(env.observation_space)
        (self._folder / SPACES).write_text(json.dumps(spaces), "utf-8")
        recordings.look_in(folder)

    def begin(self, seed: int) -> Recording:
        """Begin the file of an episode."""
        return recordings.new(self._folder, seed)

    def add(self, recording: Recording, fields: MomentFields, observation: object) -> None:
        """Add a moment; without picture and observation once there is no room for them."""
        content = packed(observation)
        if self._bytes + len(content) + len(json.dumps(fields["shown"])) > self._most_bytes:
            fields, content = {**fields, "shown": None}, b""
            if not self._is_full:
                print(FULL, flush=True)
            self._is_full = True
        self._bytes += recording.add(Moment(fields, content))


class Interruption:
    """Ctrl-C: the first one waits for the end of a step, a second one does not."""

    def __init__(self) -> None:
        self._is_stepping = self._is_wanted = False

    @contextmanager
    def heeded(self) -> Iterator[None]:
        """Heed it during the block, on the thread that has it."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = signal.signal(signal.SIGINT, self._interrupt)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)

    @contextmanager
    def after_step(self) -> Iterator[None]:
        """Let a step in the block end first."""
        self._is_stepping = True
        try:
            yield
        finally:
            self._is_stepping = False
        if self._is_wanted:
            raise KeyboardInterrupt

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if not self._is_stepping or self._is_wanted:
            raise KeyboardInterrupt
        self._is_wanted = True
        print("Ending after this step; Ctrl-C again ends it at once.", flush=True)


class Stepper:
    """Steps an environment for whoever asks: of the episode that was begun last."""

    def __init__(self, env: Env, task: str, database: Path, most_bytes: int) -> None:
        self._env, self._environment = env, environment_of(task)
        level = self._environment.configuration({}).level
        self._recordings = Recordings(recordings_beside(database), env, level, most_bytes)
        self._board: Connection | None = None
        self._run: GymnasiumRun
        self._recording: Recording | None = None

    def serve(self, asked: Connection) -> None:
        """Step what is asked for until nobody asks any more; KeyboardInterrupt at Ctrl-C."""
        interruption = Interruption()
        with interruption.heeded():
            try:
                while self._answer_next(asked, interruption):
                    pass
            finally:
                asked.close()  # first: an episode that is left here goes on another time
                self._leave()

    def _answer_next(self, asked: Connection, interruption: Interruption) -> bool:
        """Wait for a board or a question, and answer it; False once nobody asks any more."""
        ready = wait([asked] if self._board is None else [asked, self._board])
        with interruption.after_step():
            try:
                request = asked.recv_bytes() if asked in ready else b""
                handle = recv_handle(asked) if request else 0
            except (EOFError, OSError):
                return False
            try:
                if request:
                    self._begin(json.loads(request), Connection(handle))
                elif self._board is not None:
                    self._answer(self._board)
            except (EOFError, OSError):  # nobody asks for this board any more
                self._leave()
        return True

    def _leave(self) -> None:
        """Leave the episode as it stands."""
        if self._board is not None:
            self._board.close()
        if self._recording is not None:
            self._recording.close()
        self._board = self._recording = None

    def _begin(self, request: BoardRequest, board: Connection) -> None:
        """Take the next board, and make the moves that its episode has."""
        self._leave()
        self._board = board
        actions = bytes(request["actions"])
        try:
            config = own_config(self._environment.configuration(request["config"]))
            earlier = _recorded(config.level, request["seed"], actions)
            if actions and not earlier:
                raise ValueError(
                    "the episode cannot go on: no recording of it is beside the database"
                )
            self._recording = self._recordings.begin(request["seed"])
            self._run = GymnasiumRun(config, request["seed"], self._env)
            self._run.is_live = True
            self._record(moment_since(self._run, -1), None)
            for step, action in enumerate(actions, 1):
                self._record(answer_to(self._run, action), action)
                self._check(step, earlier)
            answer = moment_since(self._run, -1)
        except Exception as error:  # whatever the environment raises
            self._fail(board, error)
        else:
            send_answer(board, answer)

    def _check(self, step: int, earlier: list[list[Moment]]) -> None:
        """Raise ValueError if an episode that goes on does not lead where it led."""
        if self._run.digest not in {moments[step].fields["digest"] for moments in earlier}:
            raise ValueError(
                f"the episode cannot go on: played again, it is another one after {counted(step, 'move')}"
            )

    def _answer(self, board: Connection) -> None:
        question = json.loads(board.recv_bytes())
        try:
            answer = answer_to(self._run, question)
            if isinstance(question, int):
                self._record(answer, question)
        except Exception as error:  # whatever the environment raises
            self._fail(board, error)
        else:
            send_answer(board, answer)

    def _record(self, answer: object, action: int | None) -> None:
        """Record what is told of a moment, before it is."""
        assert self._recording is not None
        fields = cast("MomentFields", answer[0] if isinstance(answer, tuple) else answer)
        fields = {**fields, "action": action}
        self._recordings.add(self._recording, fields, self._run.newest_observation)

    def _fail(self, board: Connection, error: Exception) -> None:
        send_failure(board, error)
        self._leave()


def _recorded(level: str, seed: int, actions: bytes) -> list[list[Moment]]:
    """What is recorded of episodes that began with some moves."""
    return [
        moments for moments in recordings.of_seed(level, seed) if recordings.holds(moments, actions)
    ]
