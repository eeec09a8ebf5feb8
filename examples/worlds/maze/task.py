"""The maze as a server offers it."""

from maze.environment import MazeEnvironment, environment

from humanplay.task.registration import Start
from humanplay.tasks.base import BaseTask


class Maze(BaseTask, MazeEnvironment):
    """The maze on the playground (`humanplay.task.Task`)."""


def serve(variant: str, start: Start) -> Maze:
    """The task of a server."""
    environment(variant)
    return Maze()
