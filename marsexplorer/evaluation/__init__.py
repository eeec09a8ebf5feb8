"""Evaluation: `evaluate` plays policies on the same terrains and returns a Table. docs/evaluation.md defines every figure.

`intervals` has the t interval, `informed` the planner that is shown the true map, `plots` the figures, and `cluster` plays on a
Ray cluster.
"""

from marsexplorer.evaluation.episodes import INFORMED, EpisodeTrace, Result, horizon
from marsexplorer.evaluation.run import evaluate
from marsexplorer.evaluation.table import RULES, Comparison, Row, Table

__all__ = ["INFORMED", "RULES", "Comparison", "EpisodeTrace", "Result", "Row", "Table", "evaluate", "horizon"]
