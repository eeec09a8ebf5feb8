"""Servers of these tests have the limits that people's have."""

import pytest

from app.web.settings import Limits


@pytest.fixture
def limits():
    """The defaults."""
    return Limits()
