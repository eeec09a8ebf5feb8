"""A server whose system calls fail, by strace, or whose clock libfaketime sets."""

import os
import shutil
import signal
import subprocess
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.servers import eventually

needs_strace = pytest.mark.skipif(
    shutil.which("strace") is None, reason="NO STRACE: without it no system call fails"
)
CALLS = {"write": "pwrite64", "sync": "fsync,fdatasync"}
LIBRARY = next(Path("/usr/lib").glob("*/faketime/libfaketime.so.1"), None)
needs_faketime = pytest.mark.skipif(
    LIBRARY is None, reason="NO LIBFAKETIME: without it no server's clock is set"
)


@contextmanager
def failing(server, path, error, call="write", first=1):
    """Let calls of a server's process on one file fail.

    error  as the system names it: ENOSPC
    call   one of CALLS
    first  of the calls of a thread that fails; all after it do
    """
    wanted = ["-P", path, "-e", f"trace={CALLS[call]}"]
    wanted += ["-e", f"inject={CALLS[call]}:error={error}:when={first}+"]
    command = ["strace", "-f", "-qq", "-o", os.devnull, *wanted, "-p", str(server.process.pid)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            eventually(lambda: process.poll() is not None or is_traced(server.process.pid))
            if process.poll() is not None:
                pytest.skip(f"NO TRACING: {process.stderr.read()}")
            yield
        finally:
            process.send_signal(signal.SIGINT)


def is_traced(pid):
    """Whether every thread of a process is traced."""
    states = [task / "status" for task in Path(f"/proc/{pid}/task").iterdir()]
    return not any("TracerPid:\t0\n" in state.read_text() for state in states)


class FakeClock:
    """The wall clock of a server that is started with `environment`.

    Only that clock, as when a person sets it.
    """

    def __init__(self, file):
        self._file = file
        self.environment = {
            "LD_PRELOAD": str(LIBRARY),
            "FAKETIME_TIMESTAMP_FILE": str(file),
            "FAKETIME_NO_CACHE": "1",
            "FAKETIME_DONT_FAKE_MONOTONIC": "1",
            "NO_FAKE_STAT": "1",
        }

    def set(self, offset):
        """Set it a time difference off the true time."""
        self._file.write_text(f"{offset.total_seconds():+.0f}")
