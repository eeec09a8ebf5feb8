"""Answers about how an episode went, move by move.

They are its replay, a policy beside it, and what its moves cost.
"""

from __future__ import annotations

from pydantic import Field

from humanplay.web.answers.base import Answer, Course, Frame, Mistake
from humanplay.web.answers.server import Task


class FrameCourse(Answer):
    """The course of an episode as the frames that were seen."""

    name: str = Field(description="who drove")
    actions: list[str] = Field(description="one a move")
    outcome: str | None
    score: float | None
    sentence: str = Field(description="what it came to, in words that follow the name")
    frames: list[Frame] = Field(
        description="from the start to the end; of long episodes some are left out"
    )


class Replay(Answer):
    """An ended episode as its replay draws it.

    No seed, no player and no session is in it.
    """

    episode: str
    place: str = Field(description="where it was played, in words")
    task: Task
    run: Course = Field(description="the episode's own course")
    ghosts: list[str] = Field(description="policies that can be shown beside it")
    preferred: str | None = Field(description="the policy that is shown where none is named")


class Advice(Answer):
    """What the expert would have done instead of a move."""

    shares: list[float] | None = Field(
        description="of the actions in their order, 0..1, as a network finds them; null without one"
    )
    action: str
    after: list[int | None] | None = Field(
        description="moves to the end after each action, if the expert plays on; "
        "null where it does not get there, or is not asked"
    )
    needs: int | None = Field(
        description="moves from there to the end; null where it does not get there"
    )
    cost: int = Field(
        description="moves by which the move made lengthened the episode; below 0: a gain"
    )


class PlainMistake(Answer):
    """Moves that together cost something."""

    first: int = Field(description="its first move, from 0")
    last: int = Field(description="its last move")
    step: int = Field(description="its costliest move")
    cost: int = Field(description="moves")
    action: str = Field(description="made there")
    expert_action: str
    kind: str
    previous: str | None = Field(description="the action before it; null at the start")


class Costs(Answer):
    """An episode beside the expert's, and what its moves cost.

    Every length is in moves.
    """

    policy: str = Field(description="the expert's name")
    reason: str | None = Field(description="why no move is judged; null where they are")
    counts: int = Field(description="length of the episode: the limit where it did not succeed")
    expert_moves: int | None = Field(
        description="length of the expert's; null where its file is missing"
    )
    total: int | None = Field(description="moves more than the expert's")
    given_up: int | None = Field(description="part of `total` that ending without success cost")
    gained: int | None = Field(
        description="moves that were better than the expert's saved, 0 or below"
    )
    by_kind: dict[str, int] = Field(description="cost of the mistakes of each kind")
    mistakes: list[Mistake] = Field(description="the costliest first")
    expert: list[Advice] = Field(description="for each move; empty where none is judged")


class EpisodeCosts(Costs):
    """What the moves of an ended episode cost."""

    episode: str


class PolicyRun(Answer):
    """A policy's episode on a terrain of a study."""

    name: str
    frames: list[Frame]


class DebriefRuns(Answer):
    """A participant's own episode, and the policy's on the same terrain."""

    own: list[Frame]
    policy: PolicyRun
