"""Policies measured: `evaluate` plays them on the same terrains and gives a Table. docs/evaluation.md defines every figure."""

from marsexplorer.evaluation.play import INFORMED, Result, Trace, horizon
from marsexplorer.evaluation.run import evaluate
from marsexplorer.evaluation.table import RULES, Comparison, Row, Table

__all__ = ["INFORMED", "RULES", "Comparison", "Result", "Row", "Table", "Trace", "evaluate", "horizon"]
