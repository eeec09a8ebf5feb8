"""The environment of research: every package it asks for is pinned in its range."""

import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[3]


def requirements(extra, project):
    """Yield what an extra asks for, what the project does, and the extras within it."""
    yield from map(Requirement, project["dependencies"])
    for requirement in map(Requirement, project["optional-dependencies"][extra]):
        if requirement.name != project["name"]:
            yield requirement
        for inner in requirement.extras if requirement.name == project["name"] else ():
            yield from requirements(inner, project)


def test_every_requirement_is_pinned_within_its_range():
    lines = (ROOT / "research" / "constraints.txt").read_text().split()
    pinned = {
        canonicalize_name(name): version for name, version in (line.split("==") for line in lines)
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = (ROOT / "research" / "requirements.txt").read_text().splitlines()
    wanted = [Requirement(line) for line in asked if not line.startswith("#")]
    assert {"tianshou", "pandas"} <= {requirement.name for requirement in wanted}
    for requirement in (*wanted, *requirements("study", project), *requirements("train", project)):
        assert requirement.specifier.contains(pinned[canonicalize_name(requirement.name)]), str(
            requirement
        )


def test_the_ordinary_environment_does_not_pin_tianshou():
    assert "tianshou" not in (ROOT / "constraints.txt").read_text()
