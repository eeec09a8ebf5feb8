"""An environment that steps in a process of its own for a policy that decides in the program's.

Observations cross as bytes with their type and shape. What an agent's own wrappers do stays with the agent.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import TypedDict

import numpy as np

from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment
from humanplay.tasks.processes import Work


class Request(TypedDict):
    """The cause of an episode."""

    config: dict[str, object]
    seed: int


class Shown(TypedDict):
    """What a policy is shown.

    allowed  codes of the actions that may be chosen; None if all may, and at the end
    """

    observation: object
    allowed: list[int] | None
    score: float
    outcome: str


def packed(observation: object) -> object:
    """An observation as JSON holds it, with the types and shapes of its arrays."""
    if isinstance(observation, Mapping):
        return {"parts": {str(name): packed(part) for name, part in observation.items()}}
    if isinstance(observation, tuple):
        return {"tuple": [packed(part) for part in observation]}
    if isinstance(observation, str):
        return {"text": observation}
    array = np.asarray(observation)
    content = base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
    return {"type": array.dtype.str, "shape": array.shape, "content": content}


def unpacked(message: Mapping[str, object]) -> object:
    """The observation that was packed; a number is one of NumPy's, as environments return them."""
    parts, members = message.get("parts"), message.get("tuple")
    if isinstance(parts, Mapping):
        return {name: unpacked(part) for name, part in parts.items()}
    if isinstance(members, list):
        return tuple(map(unpacked, members))
    if "text" in message:
        return message["text"]
    content = base64.b64decode(str(message["content"]))
    shape = message["shape"]
    assert isinstance(shape, list)
    array = np.frombuffer(content, np.dtype(str(message["type"]))).reshape(shape)
    return array[()] if not shape else array.copy()


def prepare(task: str) -> None:
    """Import the environment (`humanplay.tasks.processes`)."""
    environment_of(task).prepare()


def work(task: str, request: Request) -> Work:
    """Play one episode: yield what a policy is shown, and be sent its action."""
    environment = environment_of(task)
    assert isinstance(environment, GymnasiumEnvironment)
    run = environment.run(environment.configuration(request["config"]), request["seed"])
    while True:
        codes = run.allowed()[-1] if run.outcome == "running" else None
        action = yield Shown(
            observation=packed(run.observation()),
            allowed=None if codes is None else list(codes),
            score=float(run.scores()[-1]),
            outcome=run.outcome,
        )
        run.step(action)
