"""Files that earlier code wrote (`tests/fixtures/README.md`), copied so that tests may open them."""

import json
import shutil
from pathlib import Path

FIXTURES = Path(__file__).parents[1] / "fixtures"
SCHEMAS = (1, 2, 3, 4, 5, 6, 7)


def database(schema, folder):
    """Return the path of a copy of the database of an earlier schema, and what is expected of it."""
    source = FIXTURES / "databases" / f"schema-{schema}.db"
    return Path(shutil.copy(source, folder)), json.loads(source.with_suffix(".json").read_text())


def studies(folder):
    """Return the path of a copy of the studies, their database and their bundle."""
    return Path(shutil.copytree(FIXTURES / "studies", folder / "studies"))
