"""Servers and workers of jobs, forked from a process that has imported the app.

That process is one for a whole run of pytest, however many processes test. `python -m
tests.support.forked_server FD` is it: it answers at the listening socket FD, imports the app with
the first request, and ends with its standard input, hence with the run. A fork runs
`humanplay.web.server.run` with its own settings, database and port, or `humanplay.jobs.work`; it
can be stopped, killed and waited for. A worker that has to import what its jobs need costs more
than a second of processor.
"""

import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from pathlib import Path

import pytest

from humanplay import jobs

ADDRESS = "TESTS_FORK_AT"
"""The environment variable that says where the process listens; processes that test inherit it."""


def pytest_configure(config):
    """Start the process that forks, once for a run and not in those of xdist."""
    if hasattr(config, "workerinput"):
        return
    folder = tempfile.mkdtemp()
    os.environ[ADDRESS] = f"{folder}/forks"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(os.environ[ADDRESS])
        listener.listen()
        number = listener.fileno()
        command = [sys.executable, "-m", __name__, str(number)]
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, pass_fds=[number], cwd=config.rootpath
        )
    config.add_cleanup(
        lambda: (process.stdin.close(), process.terminate(), process.wait(), shutil.rmtree(folder))
    )


def main(listener):
    """Fork a server for each request until the run has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the run, and the run ends this
    # nobody waits for the forks that wait for servers
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while sys.stdin not in select.select([listener, sys.stdin], [], [])[0]:
        answers = Connection(listener.accept()[0].detach())
        try:
            task, arguments, has_handle = answers.recv()
            handles = [recv_handle(answers)] if has_handle else []
        except (EOFError, OSError, RuntimeError):  # whoever asked was killed meanwhile
            answers.close()
            continue
        import tests.support.loaded_app  # noqa: F401

        if os.fork() == 0:
            listener.close()
            run_and_wait(answers, {"serve": serve, "work": work}[task], (*arguments, *handles))
        answers.close()
        for handle in handles:
            os.close(handle)


def run_and_wait(answers, run, arguments):
    """Fork a process and answer with its id, and with its exit code once it has ended."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    pid = os.fork()
    if pid == 0:
        answers.close()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if run is work:
            # where nobody asks any more it kills its group at once, which is not to be the run's
            os.setpgid(0, 0)
        try:
            run(*arguments)
        except BaseException:  # it ends here, and not as the process from which it was forked
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    if run is work:
        with suppress(ProcessLookupError):
            os.setpgid(pid, pid)  # it is ended with what it began
    with suppress(ConnectionError):  # a test that failed asks no more
        answers.send(pid)
        answers.send(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
    os._exit(0)


def serve(settings, log, environment, listening=None):
    """Run a server whose output goes to the file `log`.

    listening  a socket's descriptor that it inherits
    """
    from humanplay.web.settings import Settings
    from tests.support.loaded_app import run

    os.environ.clear()
    os.environ.update(environment)
    sys.dont_write_bytecode = True  # a test may limit its files, and cut off modules would be kept
    if listening is not None:
        os.dup2(listening, 3)
        os.environ["LISTEN_PID"] = str(os.getpid())
    with Path(log).open("ab") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    run(Settings(**settings))
    sys.stdout.flush()


def work(environment, search, folder, connection):
    """Be a worker of jobs over a connection's descriptor, as nice as any process.

    Else it is `python -m humanplay.jobs`; a nicer one would wait for ever beside other tests.
    """
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:] = search
    os.chdir(folder)
    jobs.work(Connection(connection))


class ForkedProcess:
    """A forked process, with the members of `subprocess.Popen` that are used of it."""

    def __init__(self, task, *arguments, handle=None):
        self.returncode, self._lock = None, threading.Lock()
        sock = socket.socket(socket.AF_UNIX)
        sock.connect(os.environ[ADDRESS])
        self._answers = Connection(sock.detach())
        self._answers.send((task, arguments, handle is not None))
        if handle is not None:
            send_handle(self._answers, handle, None)
        self.pid = self._answers.recv()

    def poll(self, seconds=0.0):
        """The exit code, None while it runs.

        Wait for it for `seconds`; None waits without end.
        """
        with self._lock:
            if self.returncode is None and self._answers.poll(seconds):
                self.returncode = self._answers.recv()
                self._answers.close()
            return self.returncode

    def wait(self, seconds=None):
        """Return the exit code once it has ended; fail after `seconds`."""
        assert self.poll(seconds) is not None, f"the process did not end within {seconds} s"
        return self.returncode


class Worker(jobs._Process):
    """A worker of jobs that is forked."""

    def __init__(self, nice):
        self._connection, others = Pipe()
        del nice
        environment = {**os.environ, **jobs.ONE_THREAD}
        self._process = ForkedProcess(
            "work", environment, sys.path, str(Path.cwd()), handle=others.fileno()
        )
        others.close()


@pytest.fixture(scope="session", autouse=True)
def forked_workers():
    """Fork workers of jobs, of servers and commands alike; `test_jobs.py` has others."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jobs, "_Process", Worker)
        yield


class ServerProcess(ForkedProcess):
    """A server's process; `stdout` reads what it printed."""

    def __init__(self, settings, log, listening=None):
        log.touch()
        self.stdout = log.open()
        passed_on = {} if listening is None else {"LISTEN_FDS": "1"}
        handle = None if listening is None else listening.fileno()
        super().__init__("serve", settings, str(log), dict(os.environ) | passed_on, handle=handle)

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


if __name__ == "__main__":
    main(socket.socket(fileno=int(sys.argv[1])))
