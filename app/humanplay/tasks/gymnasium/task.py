"""A Gymnasium environment as a task of the playground."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from humanplay.board.messages import NewBoard, NewEpisode
from humanplay.task import Cause, Choice
from humanplay.task.registration import Start
from humanplay.tasks.gymnasium.boards import BoardRun, Boards
from humanplay.tasks.gymnasium.rules import POLICIES, GymnasiumRules
from humanplay.tasks.gymnasium.run import GymnasiumConfig, GymnasiumRun
from humanplay.tasks.policies import ProcessPolicies
from humanplay.tasks.processes import guards_of


class GymnasiumTask(GymnasiumRules):
    """The environment that a description tells of, as a server offers it (`humanplay.task.Task`)."""

    def __init__(
        self, told: str, policies: Iterable[str] = (), hidden: Sequence[Path] = ()
    ) -> None:
        """Begin no process yet; `hidden` are files and folders that neither boards nor policies may read."""
        super().__init__(told)
        self._process_policies = ProcessPolicies(self.name, POLICIES, policies, hidden)
        self.policies = self._process_policies
        self._boards = Boards(self.name, hidden)
        self.steps_on = self._boards.steps_on

    def levels(self) -> list[dict[str, Any]]:
        """Return nothing: the environment is one."""
        return []

    maps = levels

    def first(self, wanted: NewEpisode) -> Choice:
        """Return what a new board is to begin on."""
        return Choice(self.default, wanted.seed)

    def next(self, was: Cause, wanted: NewEpisode) -> Choice:
        """Return what a board's next episode is to begin on."""
        return Choice(was.config, self.first(wanted).seed)

    def again(self, was: Cause) -> Choice:
        """Return what an episode began on, to be played once more."""
        return Choice(was.config, was.seed)

    def wanted_again(self, config: GymnasiumConfig, wanted: NewEpisode, **rest: Any) -> NewBoard:
        """Return what begins an episode that is wanted on a board of its own."""
        return NewBoard(seed=wanted.seed, **rest)

    def describe(self, was: Cause) -> dict[str, Any]:
        """Return `level`, `map` and `size` as a page knows them of every task: the id, and nothing."""
        return {"level": self.level, "map": None, "size": None}

    def begin(self, choice: Choice) -> GymnasiumRun:
        """Return a run at its start, in a process of its own; ValueError before a seed is drawn."""
        if choice.seed is None:
            raise ValueError("an episode begins on a seed")
        self._boards.check_room()
        return self.run(choice.config, choice.seed)

    def run(self, config: GymnasiumConfig, seed: int, actions: bytes = b"") -> GymnasiumRun:
        """Return a run after some actions, in a process of its own."""
        return BoardRun(self._boards, config, seed, actions)

    def viewer(self) -> None:
        """Return None: pages draw the environment's own picture."""

    def is_getting_ready(self) -> bool:
        """Return False: nothing is compiled."""
        return False

    def guards(self) -> str:
        """Return what guards the server; ValueError where a process does not start, PolicyError where a policy cannot play."""
        for offer in self.policies.offers():
            self.policies.load(offer.name, self.default).reset(0)
        return guards_of(self._boards.preparer.confined())

    def close(self) -> None:
        """End the processes of the boards."""
        self._boards.close()
        self._process_policies.close()


def serve(variant: str, start: Start) -> GymnasiumTask:
    """The task of a server; ValueError if it cannot be played here."""
    GymnasiumRules(variant).prepare()
    return GymnasiumTask(variant, map(str, start.policies), start.hidden)
