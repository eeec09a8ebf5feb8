"""The fixtures that every folder of tests may use."""

import gc

import pytest

pytest_plugins = ["tests.support.servers", "tests.support.forked_server", "tests.support.nginx"]

gc.disable()  # the libraries that the tests import make half a million objects, and none of them is garbage


def pytest_collection_finish():
    """Collect garbage from here on, but do not look again at what has been imported."""
    gc.freeze()
    gc.enable()


@pytest.fixture
def briefly_examined(monkeypatch):
    """A study's environment is examined over a few moves alone; `test_doctor.py` is about more."""
    monkeypatch.setattr("app.tasks.gymnasium.rules.EXAMINED", 20)
