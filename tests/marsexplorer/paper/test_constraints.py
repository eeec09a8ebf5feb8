"""The environment of the paper's experiments: every package that the extra `paper` asks for is pinned, within its range."""

import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[3]
PROJECT = "marsexplorer-playground"


def pins() -> dict[str, str]:
    """Return the pinned version of each package, by its canonical name."""
    lines = (ROOT / "constraints-paper.txt").read_text().split()
    return {
        canonicalize_name(name): version for name, version in (line.split("==") for line in lines)
    }


def requirements_of_extra(name: str) -> list[Requirement]:
    """Return what the extra asks for, and what the project and the extras within it ask for."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    found = [Requirement(line) for line in project["dependencies"]]
    for line in project["optional-dependencies"][name]:
        requirement = Requirement(line)
        own = requirement.name == PROJECT
        found += (
            [each for extra in requirement.extras for each in requirements_of_extra(extra)]
            if own
            else [requirement]
        )
    return found


def test_every_requirement_of_the_extra_is_pinned_within_its_range() -> None:
    pinned = pins()
    requirements = requirements_of_extra("paper")
    assert {"tianshou", "pandas", "torch", "numpy"} <= {each.name for each in requirements}
    for requirement in requirements:
        assert requirement.specifier.contains(pinned[canonicalize_name(requirement.name)]), str(
            requirement
        )


def test_the_ordinary_environment_does_not_pin_tianshou() -> None:
    assert "tianshou" not in (ROOT / "constraints.txt").read_text()


def test_the_installed_environment_is_the_pinned_one() -> None:
    try:
        distribution("tianshou")
    except PackageNotFoundError:
        pytest.skip(
            "tianshou is not installed here: `make test-paper` tests the environment of the paper's experiments"
        )
    pinned = pins()
    waiting, seen = requirements_of_extra("paper"), set()
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        key = (name, frozenset(requirement.extras))
        if key in seen or name.startswith(
            ("nvidia-", "cuda-", "triton")
        ):  # what torch brings along for a GPU
            continue
        seen.add(key)
        installed = distribution(name)
        assert installed.version.split("+")[0] == pinned.get(name), (
            f"{name} {installed.version} is installed"
        )
        for each in map(Requirement, installed.requires or []):
            environments = [{"extra": extra} for extra in requirement.extras] or [{"extra": ""}]
            if each.marker is None or any(
                each.marker.evaluate(environment) for environment in environments
            ):
                waiting.append(each)
