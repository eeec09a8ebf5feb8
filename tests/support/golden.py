"""The golden study (`tests/fixtures/README.md`), copied so that tests may open it."""

import shutil
from pathlib import Path

FIXTURES = Path(__file__).parents[1] / "fixtures"


def studies(folder):
    """Return the path of a copy of the studies, their database, their bundle and their export."""
    return Path(shutil.copytree(FIXTURES / "studies", folder / "studies"))
