"""The environment that the authors' code is; docs/from-mars-explorer.md has all.

from marsexplorer.compat import DEFAULT_CONFIG, make

env = make(DEFAULT_CONFIG, returns="gym")
"""

from marsexplorer.compat.config import DEFAULT_CONFIG, PRESETS
from marsexplorer.compat.env import make

__all__ = ["DEFAULT_CONFIG", "PRESETS", "make"]
