"""Evaluation: `evaluate` plays policies on the same terrains and returns a table.

docs/evaluation.md defines every measure. `intervals` has the t interval, and `plots` the figures.
"""

from marsexplorer.evaluation.episodes import EpisodeTrace, Result, horizon
from marsexplorer.evaluation.table import (
    RULES,
    Comparison,
    EvaluationRow,
    EvaluationTable,
    evaluate,
)

__all__ = [
    "RULES",
    "Comparison",
    "EpisodeTrace",
    "EvaluationRow",
    "EvaluationTable",
    "Result",
    "evaluate",
    "horizon",
]
