"""The pinned packages can be installed with every Python that the project supports."""

import tomllib
from importlib.metadata import distributions
from pathlib import Path

from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]


def test_what_is_pinned_and_installed_takes_the_oldest_python_that_the_project_takes():
    """Debian 12 has Python 3.11.2, and pip refuses a pin that wants a newer one; so 3.11 must do, whatever its last number."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    oldest = project["requires-python"].removeprefix(">=") + ".0"
    installed = {
        each.metadata["Name"]: each.metadata["Requires-Python"] or "" for each in distributions()
    }
    assert len(installed) > 100
    assert {
        name: wants for name, wants in installed.items() if not SpecifierSet(wants).contains(oldest)
    } == {}
