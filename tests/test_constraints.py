"""What is installed: for every supported Python, by hashes, with its licence."""

import re
import tomllib
from importlib.metadata import PackageNotFoundError, distribution, distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
HASHED = sorted(path.stem for path in (ROOT / "requirements").glob("*.txt"))
PINS = {
    canonicalize_name(name): version
    for name, _, version in (
        line.partition("==") for line in (ROOT / "constraints.txt").read_text().split()
    )
}
OUR_NAME = PROJECT["name"]
OF_PYTHON = {"pip"}
"""Every environment has it."""


def test_what_is_pinned_and_installed_takes_the_oldest_python_that_the_project_takes():
    """Pins take every Python 3.11: Debian 12 has 3.11.2.

    pip refuses a pin that wants a newer one.
    """
    oldest = PROJECT["requires-python"].removeprefix(">=") + ".0"
    installed = {
        distribution.metadata["Name"]: distribution.metadata["Requires-Python"] or ""
        for distribution in distributions()
    }
    assert len(installed) > 100
    assert {
        name: wants for name, wants in installed.items() if not SpecifierSet(wants).contains(oldest)
    } == {}


def needed(requirements):
    """The packages that requirements install on this machine.

    By the project's metadata, and by that of installed packages.
    """
    names, seen = set(), set()
    waiting = [Requirement(line) for line in requirements]
    while waiting:
        requirement = waiting.pop()
        name, extras = canonicalize_name(requirement.name), frozenset(requirement.extras)
        if (name, extras) in seen:
            continue
        seen.add((name, extras))
        if name == OUR_NAME:
            lines = [line for extra in extras for line in EXTRAS[extra]]
        else:
            names.add(name)
            lines = distribution(name).requires or []
        for dependency in map(Requirement, lines):
            if dependency.marker is None or any(
                dependency.marker.evaluate({"extra": extra}) for extra in ("", *extras)
            ):
                waiting.append(dependency)
    return names - OF_PYTHON


def hashed(extra):
    """The packages of an extra's file, with hashes, and those that this machine needs."""
    text = (ROOT / "requirements" / f"{extra}.txt").read_text().replace("\\\n", " ")
    packages, here = {}, set()
    for line in text.splitlines():
        words, *hashes = line.split("--hash=")
        requirement = Requirement(words.strip())
        name = canonicalize_name(requirement.name)
        packages[name] = str(requirement.specifier), [digest.strip() for digest in hashes]
        if requirement.marker is None or requirement.marker.evaluate():
            here.add(name)
    return packages, here


def test_every_extra_without_pytorch_is_installed_by_hashes():
    """PyTorch's packages differ by machine; what agents are made of is not pinned."""
    assert set(EXTRAS) - set(HASHED) == {"agents", "dev", "ray", "train"}


@pytest.mark.parametrize("extra", HASHED)
def test_a_file_of_hashes_has_the_pins_of_its_extra_and_no_others(extra):
    packages, here = hashed(extra)
    assert {name: version for name, (version, _) in packages.items()} == {
        name: f"=={PINS[name]}" for name in packages
    }
    for name, (_, hashes) in packages.items():
        assert hashes, name
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", digest) for digest in hashes), name
    try:
        expected = needed([*PROJECT["dependencies"], f"{OUR_NAME}[{extra}]"])
    except PackageNotFoundError as error:
        pytest.skip(f"NOT INSTALLED: {error}")
    assert here == expected, "make requirements"


def licence(package):
    """The licence that a package states: an expression, a class, a word or a file."""
    metadata = package.metadata
    if expression := metadata["License-Expression"]:
        return expression
    lines = metadata.get_all("Classifier") or []
    classes = [line.rpartition(" :: ")[2] for line in lines if line.startswith("License :: ")]
    text = " AND ".join(classes) or (metadata["License"] or "").partition("\n")[0]
    if text.strip() not in ("", "UNKNOWN", "OSI Approved"):
        return text
    files = [file for file in package.files or [] if "/licenses/" in str(file)]
    return " AND ".join(file.locate().read_text().strip().partition("\n")[0] for file in files)


UNSTATED = {"mlcroissant"}
"""Its repository has the Apache licence, which the package does not name."""
GPL_IN_TESTS = {"ale-py"}
"""What tests play alone: no extra but `dev` brings it."""


def test_every_package_states_its_licence_and_the_gpl_is_in_tests_alone():
    names = needed([f"{OUR_NAME}[dev]"])
    licences = {name: licence(distribution(name)) for name in names}
    assert {name for name, text in licences.items() if not text} == UNSTATED
    assert {name for name, text in licences.items() if re.search(r"\bA?GPL", text)} == GPL_IN_TESTS
    for extra in HASHED:
        assert not GPL_IN_TESTS & set(hashed(extra)[0]), extra
