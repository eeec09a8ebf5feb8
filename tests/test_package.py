"""The package is imported by its own name."""

import re
from importlib.metadata import version

import pytest

from humanplay import ROOT

FOLDERS = ("app", "marsexplorer", "tests", "research", "examples", "deploy", "docs")


def test_nothing_imports_the_package_by_the_name_of_its_folder():
    """A checkout has its root on the path: `app` would be a second copy of everything."""
    imports = re.compile(r"\bapp\.human" r"play\b|\bfrom app\b|\bimport app\b")
    paths = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*")]
    texts = [path for path in paths if path.suffix in {".py", ".md", ".toml", ".sh", ".json"}]
    assert len(texts) > 500
    assert [str(path) for path in texts if imports.search(path.read_text())] == []


def test_every_format_but_a_policys_has_the_packages_name():
    """A policy's file is MarsExplorer's own."""
    texts = [
        path.read_text() for name in ("app", "marsexplorer") for path in (ROOT / name).rglob("*.py")
    ]
    formats = {name for text in texts for name in re.findall(r'"([a-z]+-[a-z]+-\d+)"', text)}
    assert len(formats) > 5
    assert {name for name in formats if not name.startswith("humanplay-")} == {
        "marsexplorer-policy-1"
    }


def test_documents_name_the_wheel_as_it_is_built():
    texts = [path.read_text() for path in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]]
    wheels = {name for text in texts for name in re.findall(r"dist/(\S+?)-py3-none-any", text)}
    assert wheels == {f"humanplay-{version('humanplay')}"}


@pytest.mark.parametrize(
    ("pattern", "most"),
    [(r"\bAny\b", 217), (r"\bcast\(", 6), ("type: ignore", 18), ("noqa", 6)],
)
def test_what_hides_a_type_or_a_fault_does_not_become_more(pattern, most):
    """A type in its place makes the number smaller: write the new one here."""
    texts = [path.read_text() for path in (ROOT / "app").rglob("*.py")]
    assert sum(len(re.findall(pattern, text)) for text in texts) <= most
