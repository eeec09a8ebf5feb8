"""`python -m research.sweep` is the command of `research.sweep.sweep`, where worker processes find what they run."""

from research.sweep.sweep import sweep

sweep(prog_name="python -m research.sweep")
