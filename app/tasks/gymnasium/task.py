"""A Gymnasium environment as a task of the playground."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from app.board.messages import NewBoard, NewEpisode
from app.task import Cause, Choice, Configuration, Policy
from app.tasks.gymnasium.boards import BoardRun, Boards
from app.tasks.gymnasium.rules import GymnasiumConfig, GymnasiumRules, GymnasiumRun
from app.tasks.processes import guards_of


class NoPolicies:
    """The policies of an environment that brings none (`app.task.Policies`, `app.task.Decides`)."""

    def offers(self) -> Sequence[Any]:
        """Return nothing."""
        return ()

    def check(self, name: str, *others: str) -> str:
        """Raise ValueError."""
        raise ValueError(f"no policy {name!r}: nobody but people plays this environment here")

    def check_size(self, names: Iterable[str], config: Configuration) -> None:
        """Do nothing: there is no policy that could be too small."""

    def load(self, name: str) -> Policy:
        """Raise ValueError."""
        raise ValueError(f"no policy {name!r}")

    def begin(self, policy: Any, config: Configuration, seed: int) -> None:
        """Reset a policy."""
        policy.reset(seed)

    def thought(self, policy: Any, episode_id: str, step: int) -> str:
        """Return that nothing is said."""
        return ""

    def act_many(
        self, policies: Sequence[Any], observations: Sequence[Any]
    ) -> Sequence[int | Exception]:
        """Return what is said of policies that cannot be loaded."""
        return [ValueError("there is no policy") for _ in policies]

    def shared_net(self, policy: Any) -> object | None:
        """Return None."""
        return None


class GymnasiumTask(GymnasiumRules):
    """The environment that a description tells of, as a server offers it (`app.task.Task`)."""

    def __init__(self, told: str, hidden: Sequence[Path] = ()) -> None:
        """Begin no process yet; `hidden` are files and folders that its boards may not read."""
        super().__init__(told)
        self.policies = self.decides = NoPolicies()
        self._boards = Boards(self.name, hidden)
        self.steps_on = self._boards.steps_on

    def levels(self) -> list[dict[str, Any]]:
        """Return nothing: the environment is one."""
        return []

    maps = levels

    @property
    def daily(self) -> GymnasiumConfig:
        """What the daily instance is played on."""
        return self.default

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

    def guards(self) -> str:
        """Return what guards the server from the environment; ValueError where its process does not start."""
        return guards_of(self._boards.preparer.confined())

    def close(self) -> None:
        """End the processes of the boards."""
        self._boards.close()
