"""A Gymnasium environment as a task of the playground."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from humanplay.task import Cause, Choice, Configuration, Run
from humanplay.task.registration import Start
from humanplay.tasks.base import BaseTask, seed_of
from humanplay.tasks.gymnasium.boards import BoardRun, Boards
from humanplay.tasks.gymnasium.configuration import own_config
from humanplay.tasks.gymnasium.description import described
from humanplay.tasks.gymnasium.environment import (
    POLICIES,
    GymnasiumEnvironment,
    InPlaceEnvironment,
)
from humanplay.tasks.gymnasium.in_place import ProgramBoard
from humanplay.tasks.gymnasium.run import GymnasiumRun
from humanplay.tasks.policies import ProcessPolicies
from humanplay.tasks.processes import guards_of


class GymnasiumTask(BaseTask, GymnasiumEnvironment):
    """A described environment as a server offers it (`humanplay.task.Task`)."""

    def __init__(
        self,
        text: str,
        policies: Sequence[str] = (),
        hidden: Sequence[Path] = (),
        confined: bool = True,
    ) -> None:
        """Take a description's text; no process begins yet.

        Args:
            policies: Sources of those on offer besides `random`.
            hidden: Files and folders that neither boards nor policies may read.
            confined: Whether processes may do no more than they need.
        """
        super().__init__(text)
        self._checked = policies
        self._process_policies = ProcessPolicies(self.name, POLICIES, policies, hidden, confined)
        self.policies = self._process_policies
        self._own_boards = Boards(self.name, hidden, confined)
        self.steps_on = self._boards.steps_on

    def begin(self, choice: Choice) -> Run:
        """A run at its start, in a process of its own; ValueError without a seed."""
        self._boards.check_room()
        return super().begin(choice)

    def run(self, config: Configuration, seed: int, actions: bytes = b"") -> GymnasiumRun:
        """Return a run after some actions, in a process of its own."""
        return BoardRun(self._boards, own_config(config), seed, actions)

    @property
    def _boards(self) -> Boards:
        """The server's own, guarded."""
        return self._own_boards

    def guards(self) -> str:
        """What guards the server, in a sentence.

        Raises:
            ValueError: If a process does not start.
            PolicyError: If a policy cannot play.
        """
        for source in self._checked:  # `random` starts when somebody wants it
            self.policies.load(source, self.default).reset(0)
        return guards_of(self._boards.preparer.guards())

    def close(self) -> None:
        """End the processes of the boards."""
        self._boards.close()
        self._process_policies.close()


class InPlaceTask(BaseTask, InPlaceEnvironment):
    """An environment that the program steps which started the server."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._board = ProgramBoard(self.name)
        self.steps_on = self._board.steps_on

    def begin(self, choice: Choice) -> Run:
        """Return a run at its start, in the program; ValueError before a seed is drawn."""
        if choice.seed is None:
            raise ValueError("an episode begins on a seed")
        return BoardRun(self._board, own_config(choice.config), choice.seed, b"")

    def replay(self, cause: Cause, actions: bytes = b"", ended: bool = False) -> Run:
        """An episode that goes on, in the program, or one that ended, as recorded."""
        if ended:
            return super().replay(cause, actions, ended)
        return BoardRun(self._board, own_config(cause.config), seed_of(cause), actions)

    def guards(self) -> str:
        """Where it steps."""
        return "the board is stepped by the program that called play, which nothing guards"

    def close(self) -> None:
        """Ask for no further step."""
        self._board.close()


def serve(variant: str, start: Start) -> GymnasiumTask | InPlaceTask:
    """The task of a server; ValueError if it cannot be played here."""
    if described(variant).is_in_place:
        return InPlaceTask(variant)
    policies = [str(path) for path in start.policies]
    task = GymnasiumTask(variant, policies, start.hidden, start.confined)
    try:
        task.prepare()
    except ValueError:
        task.close()
        raise
    return task
