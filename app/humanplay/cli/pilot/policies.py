"""Policies that play the instances that people played."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from humanplay.cli.pilot.errors import PilotError
from humanplay.task import RunEndedError
from humanplay.tasks.gymnasium.configuration import GymnasiumConfig
from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment
from humanplay.tasks.policies import MASKS, Choose, Mask, chooser, masked

TAKE_MASKS = (
    "let the policy take `action_masks`, a truth value for each action: `def policy(observation, action_masks)`, "
    "`predict(self, observation, action_masks)`, or an input of that name in an ONNX file"
)


@runtime_checkable
class Predictor(Protocol):
    """A model as Stable-Baselines3 has them, recurrent ones too."""

    def predict(self, observation: object) -> object:
        """An action, alone or with the state that the next call is given."""


def played_score(
    environment: GymnasiumEnvironment,
    name: str,
    policy: object,
    config: GymnasiumConfig,
    seed: int,
) -> float:
    """The score of a policy on the instance of a seed; PilotError if that fails.

    The environment steps in a process of its own, and the policy decides in this one.
    """
    choose = _chooser(environment, name, policy, seed)
    forbidden = ""
    try:
        run = environment.run(config, seed)
        while not run.ended:
            mask = np.ones(len(environment.actions), bool)
            if (codes := run.allowed()[-1]) is not None:
                mask[:] = False
                mask[list(codes)] = True
            code = _chosen(name, choose, run.newest_observation, mask)
            # many an environment takes such an action all the same
            is_forbidden = 0 <= code < len(mask) and not mask[code]
            forbidden = environment.actions[code] if is_forbidden else ""
            run.step(code)
    except PilotError as error:
        raise PilotError(f"{error}; on seed {seed}") from error
    except (RunEndedError, ValueError) as error:
        remedy = f". {forbidden!r} was not allowed there: {TAKE_MASKS}" if forbidden else ""
        raise PilotError(
            f"the episode of {name!r} on seed {seed} failed: {error}{remedy}"
        ) from error
    return float(run.scores()[-1])


def _chooser(environment: GymnasiumEnvironment, name: str, policy: object, seed: int) -> Choose:
    """What decides in one episode."""
    if isinstance(policy, str | Path):
        if str(policy).endswith(".onnx") and not Path(policy).is_file():
            raise PilotError(f"there is no file {policy}")
        try:
            return chooser(str(policy), seed, environment.code_of)
        except Exception as error:  # whatever reads the file may raise
            raise PilotError(f"the policy {name!r} cannot be loaded: {error}") from error
    if isinstance(policy, Predictor):
        return _predicting(policy, environment.code_of)
    if callable(policy):
        return masked(policy, environment.code_of)
    raise PilotError(
        f"expected a policy's file, a function of the observation, or an object with predict; got {type(policy).__name__}"
    )


def _chosen(name: str, choose: Choose, observation: object, mask: Mask) -> int:
    """The code that a policy decides for; PilotError for what it raises."""
    try:
        return choose(observation, mask)
    except Exception as error:
        raise PilotError(f"the policy {name!r} failed: {type(error).__name__}: {error}") from error


def _predicting(model: Predictor, code_of: Callable[[object], int]) -> Choose:
    """What a model decides, which remembers by the state that it returns."""
    parameters = inspect.signature(model.predict).parameters
    state: object = None
    is_start = True

    def decide(observation: object, mask: Mask) -> int:
        nonlocal state, is_start
        offered: dict[str, object] = {
            "state": state, "episode_start": np.array([is_start]), "deterministic": True,
            **dict.fromkeys(MASKS, mask),
        }  # fmt: skip
        arguments = {name: offered[name] for name in offered if name in parameters}
        answer = model.predict(observation, **arguments)
        action, state = answer if isinstance(answer, tuple) else (answer, None)
        is_start = False
        return code_of(action)

    return decide
