"""The settings of the limits: documented as they are, and read from the environment."""

import re
from pathlib import Path

import pytest

from app.settings import Limits, Settings

PAGE = Path(__file__).parents[3] / "docs/reliability.md"


def test_the_page_lists_every_limit_with_its_default():
    listed = dict(re.findall(r"^\| `(\w+)` \| `?([^|`]+?)`? \|", PAGE.read_text(), re.M))
    defaults = {name: field.default for name, field in Limits.model_fields.items()}
    assert listed == {
        name: "none" if default is None else str(default) for name, default in defaults.items()
    }


def test_a_limit_is_read_from_the_environment(monkeypatch):
    monkeypatch.setenv("MARS_LIMITS__ACTS", "50+10/s")
    monkeypatch.setenv("MARS_LIMITS__SOCKETS", "7")
    assert (Settings().limits.acts, Settings().limits.sockets) == ("50+10/s", 7)
    monkeypatch.setenv("MARS_LIMITS__ACTS", "quick")
    with pytest.raises(ValueError, match="expected BURST"):
        Settings()
    with pytest.raises(ValueError, match="expected how many in which time"):
        Limits(joins_per_player="often")
