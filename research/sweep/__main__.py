"""`python -m research.sweep` is the command of `research.sweep.sweep`.

Worker processes find there what they run.
"""

from research.sweep.sweep import sweep

sweep(prog_name="python -m research.sweep")
