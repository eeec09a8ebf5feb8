"""The processes in which an environment steps; one that fails ends only itself.

A server's boards and every command that plays, replays or exports use the same kind of process, with
the same environment variables.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any
from weakref import WeakSet

from humanplay.task import AgentObservation, Allowed, RunEndedError, TaskFullError
from humanplay.task.recordings import MomentFields
from humanplay.task.registration import environment_of
from humanplay.tasks.base import FAILED
from humanplay.tasks.gymnasium.configuration import GymnasiumConfig, own_config
from humanplay.tasks.gymnasium.description import described
from humanplay.tasks.gymnasium.run import GymnasiumRun, GymnasiumView, draw_once
from humanplay.tasks.gymnasium.values import packed, unpacked
from humanplay.tasks.processes import LostError, Preparer, Work, Worker

_log = logging.getLogger(__name__)

ALL_OF_MEMORY = 0.5
"""Share of the machine's memory that all boards may take before no further one begins."""
THREADS = 64
"""Steps that can be waited for at once."""
OBSERVATION, PICTURE, MORE = "observation", "picture", "more"
"""What a board's process can be asked for besides a move: `MORE` of an episode's observations."""
OBSERVATIONS_BYTES = 8 * 2**20
"""How much of an episode's observations is sent at once."""


class Boards:
    """The processes of one task's boards.

    Args:
        hidden: Files and folders that no board may read.
        confined: Whether a process may do no more than it needs.

    Attributes:
        steps_on: Threads that wait for the processes' answers.
    """

    _open, _listing = WeakSet[Worker](), Lock()  # of all tasks that this process serves

    def __init__(self, task: str, hidden: Sequence[Path] = (), confined: bool = True) -> None:
        self.steps_on = ThreadPoolExecutor(THREADS, "boards")
        memory_mb = described(task.partition(":")[2]).memory_mb
        self.task = task
        self.preparer = Preparer(__name__, task, memory_mb, hidden=hidden, confined=confined)
        self._most = int(ALL_OF_MEMORY * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))

    def check_room(self) -> None:
        """Raise TaskFullError if all boards take too much memory for another one."""
        with self._listing:
            boards = list(self._open)
        if (taken := sum(map(Worker.resident, boards))) > self._most:
            raise TaskFullError(
                f"the boards take {taken >> 20} MB of memory, of at most {self._most >> 20} MB: try again in a minute"
            )

    def begin(self, request: Mapping[str, object]) -> Worker:
        """A new process that plays a request; ValueError if it cannot be played."""
        board = self.preparer.begin(request)
        with self._listing:
            self._open.add(board)
        return board

    def close(self) -> None:
        """End the process, and with it those of all boards."""
        self.steps_on.shutdown(wait=False)
        self.preparer.close()


@lru_cache(maxsize=64)
def _boards_of(task: str, process: int) -> Boards:
    """The boards of a task in this process, which is no server."""
    return Boards(task, confined=False)


def boards_of(task: str) -> Boards:
    """The boards of a task for a command; they are not confined, and prepared once."""
    return _boards_of(task, os.getpid())


class BoardRun(GymnasiumRun):
    """A run whose environment is in a process of its own.

    If the process is lost, another one replays the moves, once.

    Args:
        is_live: Whether somebody waits for the pictures: then each move brings one. Else a picture is
            drawn when it is asked for.

    Raises:
        ValueError: If it cannot be made.
    """

    def __init__(
        self,
        boards: Boards,
        config: GymnasiumConfig,
        seed: int,
        actions: bytes,
        is_live: bool = True,
    ) -> None:
        self.config, self.seed, self._boards = config, seed, boards
        self.is_live = is_live
        self._shown: AgentObservation | None = None
        self._described = config.description
        self.actions, self._rewards, self._scores = bytearray(), list[float](), list[float]()
        self._names = environment_of(boards.task).actions
        self._allowed = list[Allowed]()
        self.outcome, self.total = "running", 0.0
        self._asked: int | None = None
        self.tell: Callable[[int, int], object] = lambda done, of: None
        try:
            self._board = self._begun(actions)
        except LostError as error:
            raise ValueError(f"{config.level} could not be begun: {error}") from error
        self.actions += actions
        self._let_go()

    def _let_go(self) -> None:
        """End the process of a live run that has ended; any other ends with its run."""
        if self.outcome != "running" and self.is_live:
            self._board.close()

    def _begun(self, actions: bytes) -> Worker:
        request = request_of(self.config, self.seed, actions) | {"live": self.is_live}
        board = self._boards.begin(request)
        moment = board.answer(lambda done: self.tell(done, len(actions)))
        self._rewards, self._scores, self._allowed = [], [], []
        self._take(moment)
        return board

    def _take(self, answer: Any) -> None:
        """Take over what `moment_since` describes."""
        moment, self._last = answer if isinstance(answer, tuple) else (answer, b"")
        self._rewards += moment["rewards"]
        self._scores += moment["scores"]
        self._allowed += [None if codes is None else tuple(codes) for codes in moment["allowed"]]
        self.outcome, self.total, self._digest = (
            moment["outcome"],
            moment["total"],
            moment["digest"],
        )
        self._shown = moment["shown"]

    async def ask(self, action: int) -> bool:
        """Send a move to the process; True if `step` need not wait on a thread for it."""
        if self.outcome != "running" or not self._is_action(action):
            return True  # `step` refuses it
        self._asked = action
        try:
            return await self._board.ask_without_thread(action)
        except LostError:
            self._asked = None
            return False

    def _answer(self, question: int | str, is_asked: bool = False) -> Any:
        """The process's answer; if the process is lost, a new one's.

        Raises:
            LostError, ValueError: If the new one fails too.
        """
        try:
            return self._board.answer() if is_asked else self._board.ask(question)
        except LostError as error:
            self._log_failure(question, error)
            self._board = self._begun(bytes(self.actions))
            return self._board.ask(question)

    def _log_failure(self, action: int | str, error: Exception, then: str = "") -> None:
        """Log for the author what failed at which move of which episode."""
        _log.error(
            "%s failed%s, seed %d, %s: %s",
            self.config.level,
            f" {then}" if then else "",
            self.seed,
            self._place_of(action),
            error,
            exc_info=error.__cause__,
        )

    def _place_of(self, action: int | str) -> str:
        """Which move of the episode is asked for, by which action."""
        name = f"{action} ({self._names[action]})" if isinstance(action, int) else "none"
        return f"step {len(self.actions) + 1}, action {name}"

    def _is_action(self, action: int) -> bool:
        return 0 <= action < len(self._names)

    def step(self, action: int) -> float:
        """Make one move and return its reward.

        Raises:
            RuntimeError: If the episode has ended.
            ValueError: If there is no such action.
            RunEndedError: If the environment fails at this move twice: the run has ended before it.
        """
        if self.outcome != "running":
            raise RuntimeError(f"the episode has ended ({self.outcome}); begin another one")
        if not self._is_action(action):
            raise ValueError(f"expected an action of {self.config.level}, got {action}")
        asked, self._asked = self._asked, None
        try:
            moment = self._answer(action, is_asked=asked is not None)
        except (LostError, ValueError) as error:
            self._board.close()
            self.outcome = FAILED
            self._log_failure(action, error, "again, and the episode is over")
            report = f"{self._place_of(action)}: {error}\n{error.__cause__ or ''}"
            raise RunEndedError(
                f"{self.config.level} failed at this move, and again after it was made anew: {error}; the episode is over",
                report.rstrip(),
            ) from error
        self.actions.append(action)
        self._take(moment)
        self._let_go()
        return self._rewards[-1]

    def abandon(self) -> None:
        """End the episode as an abandoned one, with the score so far."""
        super().abandon()
        self._let_go()

    def view(self) -> GymnasiumView:
        """What may be seen of the run now."""
        if self._shown is None:
            self._shown = self._asked_for(PICTURE)
        return GymnasiumView(self, self._shown["picture"], self._shown["text"])

    @property
    def newest_observation(self) -> object:
        """The environment's last observation; ValueError if its process is lost twice."""
        if not self._last:
            _, self._last = self._asked_for(OBSERVATION)
        (observation,) = unpacked(self._last)
        return observation

    def _asked_for(self, question: str) -> Any:
        try:
            return self._answer(question)
        except LostError as error:
            raise ValueError(f"{self.config.level} cannot be shown: {error}") from error

    def observation(self) -> object:
        """What a policy's process gets: the cause. Observations stay in the process."""
        return self.view().observation()

    @property
    def digest(self) -> str:
        """SHA-256 (hex) over configuration, seed, moves, rewards and observations."""
        return str(self._digest)


def request_of(config: GymnasiumConfig, seed: int, actions: bytes) -> dict[str, object]:
    """The request for a process that has made some moves."""
    return {"config": config.to_dict(), "seed": seed, "actions": list(actions)}


def observations(
    boards: Boards, config: GymnasiumConfig, seed: int, actions: bytes
) -> Iterator[object]:
    """The observations before each move of an episode and after the last.

    Raises:
        ValueError: If the episode cannot be played.
    """
    try:
        board = boards.begin(request_of(config, seed, actions) | {"observations": True})
        _, piece = board.answer()
        while piece:
            yield from unpacked(piece)
            _, piece = board.ask(MORE)
    except LostError as error:
        raise ValueError(f"{config.level} cannot be played again: {error}") from error


def prepare(task: str) -> None:
    """Import the environment and draw it once (`humanplay.tasks.processes`)."""
    environment = environment_of(task)
    _ = environment.actions
    draw_once(own_config(environment.configuration({})))


def work(task: str, request: Mapping[str, Any]) -> Work:
    """Play one board: yield its state after the first moves, then answer questions."""
    config = own_config(environment_of(task).configuration(request["config"]))
    run = GymnasiumRun(config, request["seed"])
    if "observations" in request:
        return _observe(run, request["actions"])
    run.is_live = request["live"]
    return _play(run, request["actions"])


def _play(run: GymnasiumRun, actions: Sequence[int]) -> Work:
    for step, action in enumerate(actions, 1):
        run.step(action)
        yield step
    question = yield moment_since(run, -1)
    while True:
        question = yield answer_to(run, question)


def _observe(run: GymnasiumRun, actions: Sequence[int]) -> Work:
    """Yield the observations of an episode, some megabytes at a time, then nothing."""
    piece = bytearray(packed(run.newest_observation))
    for step, action in enumerate(actions, 1):
        run.step(action)
        piece += packed(run.newest_observation)
        if len(piece) >= OBSERVATIONS_BYTES:
            yield None, bytes(piece)
            piece.clear()
        else:
            yield step
    if piece:
        yield None, bytes(piece)
    yield None, b""


def answer_to(run: GymnasiumRun, question: int | str) -> object:
    """Answer a board's question: an action to step, or what can be seen of the run."""
    if question == OBSERVATION:
        return None, packed(run.newest_observation)
    if question == PICTURE:
        return run.agent_observation(picture=True, observation=False)
    since = len(run.actions)
    run.step(int(question))
    return moment_since(run, since)


def moment_since(run: GymnasiumRun, since: int) -> MomentFields | tuple[MomentFields, bytes]:
    """Describe a run now, with what came since so many moves (-1: all of it).

    The last observation of a live run that has ended is sent along: the process ends, so nobody can
    ask for it later.
    """
    fields: MomentFields = {
        "rewards": list(run.rewards()[max(since, 0) :]),
        "scores": list(run.scores()[since + 1 :]),
        "allowed": list(run.allowed()[since + 1 :]),
        "outcome": run.outcome,
        "total": run.total,
        "digest": run.digest,
        "shown": run.agent_observation(picture=True, observation=False) if run.is_live else None,
    }
    if run.is_live and run.ended:
        return fields, packed(run.newest_observation)
    return fields
