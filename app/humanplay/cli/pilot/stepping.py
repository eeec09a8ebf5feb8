"""An environment that steps in a process of its own for a policy that decides in the program's.

Observations cross as bytes with their type and shape. What an agent's own wrappers do stays with the agent.
"""

from __future__ import annotations

from typing import TypedDict

from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.run import GymnasiumRun, draw_once
from humanplay.tasks.gymnasium.values import packed
from humanplay.tasks.processes import Work


class Request(TypedDict):
    """The cause of an episode."""

    config: dict[str, object]
    seed: int


class Shown(TypedDict):
    """What a policy is shown beside the observation.

    allowed  codes of the actions that may be chosen; None if all may, and at the end
    """

    allowed: list[int] | None
    score: float
    outcome: str


def prepare(task: str) -> None:
    """Import the environment (`humanplay.tasks.processes`)."""
    draw_once(environment_of(task).configuration({}))


def work(task: str, request: Request) -> Work:
    """Play one episode: yield what a policy is shown, and be sent its action."""
    run = GymnasiumRun(environment_of(task).configuration(request["config"]), request["seed"])
    while True:
        codes = run.allowed()[-1] if run.outcome == "running" else None
        shown = Shown(
            allowed=None if codes is None else list(codes),
            score=float(run.scores()[-1]),
            outcome=run.outcome,
        )
        action = yield shown, packed(run.newest_observation)
        run.step(action)
