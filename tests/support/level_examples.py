"""The terrains that stand for the levels in the page's dialog.

`python -m tests.support.level_examples` writes them beside the code; a test compares the file with what is drawn here.
"""

import json

import numpy as np

from humanplay.tasks.mars.messages import DRAWN_LEVELS
from humanplay.tasks.mars.task import EXAMPLES, SIDE
from marsexplorer.config import EnvConfig
from marsexplorer.terrain import generate


def examples():
    """A terrain of each level by its name: rocks as bits of rows."""
    bits = 1 << np.arange(SIDE)
    return {name: (generate(EnvConfig.of(name, SIDE), 0) @ bits).tolist() for name in DRAWN_LEVELS}


if __name__ == "__main__":
    EXAMPLES.write_text(json.dumps(examples(), separators=(",", ":")) + "\n")
