"""The maze as a server offers it."""

from maze.rules import MazeRules, rules

from humanplay.task.registration import Start
from humanplay.tasks.base import BaseTask


class Maze(BaseTask, MazeRules):
    """The maze on the playground (`humanplay.task.Task`)."""


def serve(variant: str, start: Start) -> Maze:
    """The task of a server."""
    rules(variant)
    return Maze()
