"""Evaluation: `evaluate` plays policies on the same terrains and returns an EvaluationTable.

docs/evaluation.md defines every figure. `intervals` has the t interval,
and `plots` the figures.
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
