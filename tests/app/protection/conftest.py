"""Servers of these tests have the limits that people's have."""

import pytest

from app.settings import Limits


@pytest.fixture
def limits():
    """The defaults."""
    return Limits()
