"""What the documents show in Python runs, block after block, and the environment's page keeps Gymnasium's headings."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HEADINGS = [
    "Description",
    "Action Space",
    "Observation Space",
    "Rewards",
    "Starting State",
    "Episode End",
    "Information",
    "Arguments",
    "Version History",
]


def blocks(path):
    return re.findall(r"^```python\n(.*?)^```", (ROOT / path).read_text(), re.M | re.S)


@pytest.mark.parametrize("path", ["docs/environment.md", "docs/policies.md"])
def test_every_block_of_python_runs(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for number, code in enumerate(blocks(path)):
        exec(compile(code, f"{path}, block {number + 1}", "exec"), names)
    assert names


def test_the_environments_page_has_gymnasiums_headings_in_their_order():
    found = re.findall(r"^## (.*)$", (ROOT / "docs/environment.md").read_text(), re.M)
    assert [heading for heading in found if heading in HEADINGS] == HEADINGS


def test_the_page_tells_the_spaces_the_environment_has():
    import gymnasium

    import marsexplorer  # noqa: F401

    env = gymnasium.make("MarsExplorer-v0")
    text = (ROOT / "docs/environment.md").read_text()
    assert f"| Observation Space | `{env.observation_space}` |" in text
    assert f"| Action Space | `{env.action_space}` |" in text
