"""Policies that play the instances that people played."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from humanplay.cli.pilot.errors import PilotError
from humanplay.task import Configuration
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.values import unpacked
from humanplay.tasks.policies import chooser
from humanplay.tasks.processes import LostError, Preparer

MEMORY_MB = 2048
Decide = Callable[[object, NDArray[np.bool_]], int]
"""Returns an action for an observation and which actions are allowed, from the start of an episode to its end."""


@runtime_checkable
class Predicting(Protocol):
    """A model as Stable-Baselines3 has them, recurrent ones too."""

    def predict(self, observation: object) -> object:
        """An action, alone or with the state that the next call is given."""


@dataclass(frozen=True)
class Played:
    """What an episode of a policy came to."""

    score: float
    outcome: str


class Stepper:
    """Plays episodes of a task: the environment steps in a process of its own, policies decide in this one."""

    def __init__(self, task: str) -> None:
        self._task, self._environment = task, environment_of(task)
        self._preparer = Preparer("humanplay.cli.pilot.stepping", task, MEMORY_MB, confined=False)

    def play(self, policy: object, config: Configuration, seed: int) -> Played:
        """Play an episode on the instance of a seed; PilotError if policy or environment fails."""
        decide = self._decider(policy, config, seed)
        try:
            worker = self._preparer.begin({"config": config.to_dict(), "seed": seed})
            with closing(worker):
                shown, content = worker.answer()
                while shown["outcome"] == "running":
                    mask = np.ones(len(self._environment.actions), bool)
                    if shown["allowed"] is not None:
                        mask[:] = False
                        mask[shown["allowed"]] = True
                    (observation,) = unpacked(content)
                    shown, content = worker.ask(decide(observation, mask))
        except (LostError, ValueError) as error:
            raise PilotError(f"a policy's episode on seed {seed} failed: {error}") from error
        return Played(shown["score"], shown["outcome"])

    def _decider(self, policy: object, config: Configuration, seed: int) -> Decide:
        """What decides in one episode."""
        code_of = partial(self._environment.code_of, config)
        if isinstance(policy, str | Path):
            if str(policy).endswith(".onnx") and not Path(policy).is_file():
                raise PilotError(f"there is no file {policy}")
            return chooser(str(policy), seed, code_of)
        if isinstance(policy, Predicting):
            return _predicting(policy, code_of)
        if callable(policy):
            return lambda observation, mask: code_of(policy(observation))
        raise PilotError(
            f"expected a policy's file, a function of the observation, or an object with predict; got {type(policy).__name__}"
        )

    def close(self) -> None:
        """End the processes."""
        self._preparer.close()


def _predicting(model: Predicting, code_of: Callable[[object], int]) -> Decide:
    """What a model decides, which remembers by the state that it returns."""
    parameters = inspect.signature(model.predict).parameters
    state: object = None
    is_start = True

    def decide(observation: object, mask: NDArray[np.bool_]) -> int:
        nonlocal state, is_start
        known: dict[str, object] = {
            "state": state, "episode_start": np.array([is_start]), "deterministic": True,
            "action_masks": mask,
        }  # fmt: skip
        given = {name: known[name] for name in known if name in parameters}
        answer = model.predict(observation, **given)
        action, state = answer if isinstance(answer, tuple) else (answer, None)
        is_start = False
        return code_of(action)

    return decide
