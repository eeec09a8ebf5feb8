"""How hard a level's terrains are, measured without training: the moves of the rules, and of a search that is shown the map.

The moves of the informed search say how much there is to do on the terrains of a level, and those of the better rule how much
it costs to find that out on the way. A result has `steps_to_99`: mean, low and high over terrains (95 % t interval).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from marsexplorer.evaluation import INFORMED, RULES, Result
from marsexplorer.evaluation.intervals import t_interval
from marsexplorer.paper.episodes.play import Line, Play
from marsexplorer.paper.job import Job

TERRAINS = {
    "1-1": "1-1-1",
    "1-2": "1-2-1",
    "2-1": "2-1-1",
    "2-2": "2-2-1",
    "3-1": "3-1-1",
    "3-2": "3-2-1",
}
"""d_t and d_m -> a level with such terrains; d_b changes the rewards alone."""
EPISODES = {"small": 20, "full": 100}
"""Budget -> terrains of each level."""


@dataclass(frozen=True)
class Difficulty(Play):
    """The episodes of a rule or of the informed search on one level, beside figure 5."""

    figure: ClassVar[int] = 5
    kind: ClassVar[str] = "difficulty"

    def measure(self, results: Sequence[Result]) -> Line:
        """Return the moves to 99 %, JSON-ready."""
        steps = np.array([result.steps_to_99 for result in results], np.float64)
        low, high = (float(end) for end in t_interval(steps))
        return {"steps_to_99": {"mean": float(steps.mean()), "low": low, "high": high}}


def jobs(budget: str, size: int) -> list[Job]:
    """Return the jobs that measure the six kinds of terrain."""
    return [
        Difficulty(policy, level, size, EPISODES[budget])
        for level in TERRAINS.values()
        for policy in (INFORMED, *RULES)
    ]
