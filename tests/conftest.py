"""The fixtures that every folder of tests may use."""

import gc
import os
import shutil
import signal
import sys
import tempfile
from contextlib import closing, suppress

import pytest
from hypothesis import HealthCheck, settings

pytest_plugins = ["tests.support.servers", "tests.support.forked_server", "tests.support.nginx"]

IN_MEMORY, ROOM = "/dev/shm", 4 * 2**30
"""Where tests keep their files, unless TMPDIR says where, if so many bytes are free: each move waits for the disk otherwise."""

if "TMPDIR" not in os.environ:
    with suppress(OSError):
        if shutil.disk_usage(IN_MEMORY).free >= ROOM:
            os.environ["TMPDIR"] = tempfile.tempdir = IN_MEMORY

# what mlcroissant imports closes the stderr that it met whenever logging is configured anew, pytest's capture
# among them; never that of the process
with suppress(ImportError):
    from absl import logging as absl_logging

    absl_logging.get_absl_handler().python_handler.setStream(sys.__stderr__)

# whoever starts the tests in the background of a shell has them ignore Ctrl-C, which some of them press
signal.signal(signal.SIGINT, signal.default_int_handler)

# how fast a machine is while much else runs on it says nothing of the code
settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")

gc.disable()  # the libraries that the tests import make half a million objects, and none of them is garbage


def pytest_collection_finish():
    """Collect garbage from here on, but do not look again at what has been imported."""
    gc.freeze()
    gc.enable()


@pytest.fixture
def briefly_examined(monkeypatch):
    """A study's environment is examined over a few moves; `test_doctor.py` does more."""
    monkeypatch.setattr("humanplay.tasks.gymnasium.lock.EXAMINED", 20)


@pytest.fixture
def store(tmp_path):
    """An empty database of a server, `play.db`."""
    from humanplay.db.store import Store

    with closing(Store(tmp_path / "play.db")) as database:
        yield database
