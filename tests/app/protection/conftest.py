"""Servers of these tests have the limits that people's have."""

import pytest

from humanplay.web.settings import Limits


@pytest.fixture
def limits():
    """The defaults."""
    return Limits()
