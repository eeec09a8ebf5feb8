"""Servers in processes of their own that start at once: forked from one process that has imported the app already.

Each runs `app.server.run` with its own settings, database and port; it can be stopped, killed and waited for.
"""

import multiprocessing
import os
import signal
import sys
import time
from pathlib import Path

from app.settings import Settings

_forks = multiprocessing.get_context("forkserver")
_forks.set_forkserver_preload([__name__, "tests.support.loaded_app"])


def serve(settings, log, environment):
    """Run a server whose output goes to the file `log`."""
    from tests.support.loaded_app import run

    os.environ.clear()
    os.environ.update(environment)
    with Path(log).open("ab") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    run(Settings(**settings))
    sys.stdout.flush()


class ServerProcess:
    """A server's process, with the members of `subprocess.Popen` that the tests use; `stdout` reads what it printed."""

    def __init__(self, settings, log):
        log.touch()
        self.stdout = log.open()
        self._process = _forks.Process(target=serve, args=(settings, str(log), dict(os.environ)))
        self._process.start()
        self.pid = self._process.pid

    def lines(self):
        """Yield the lines it prints, as they come, until it has ended."""
        line = ""
        while True:
            has_ended = self.poll() is not None
            if part := self.stdout.readline():
                line += part
                if line.endswith("\n"):
                    yield line
                    line = ""
            elif has_ended:
                return
            else:
                time.sleep(0.01)

    def send_signal(self, number):
        os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)

    def terminate(self):
        self.send_signal(signal.SIGTERM)

    @property
    def returncode(self):
        return self._process.exitcode

    def poll(self):
        return self.returncode

    def wait(self, seconds=None):
        """Return the exit code once it has ended; fail after `seconds`."""
        self._process.join(seconds)
        assert self.returncode is not None, f"the server did not end within {seconds} s"
        return self.returncode
