"""Servers, programs and workers of jobs, forked from a process with the app.

A second such process has no more than a `Preparer` imports, and its few variables: it forks those of
boards and of their policies, and most that `doctor` compares, unless a test takes
`executed_preparers`.

That process is one for a whole run of pytest, however many processes test. `python -m
tests.support.forked_server FD` is it: it answers at the listening socket FD, imports the app with
the first request, and ends with its standard input, hence with the run. A fork runs
`humanplay.web.server.run` with its own settings, database and port, `humanplay.jobs.work`, the
server of a `play`, or a script; it can be stopped, killed and waited for. A process that has to
import what it needs costs seconds of processor.
"""

import atexit
import fcntl
import gc
import json
import os
import runpy
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
from contextlib import contextmanager, suppress
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from pathlib import Path

import numpy
import pytest

from humanplay import jobs
from humanplay.cli.pilot import running
from humanplay.tasks import processes
from humanplay.tasks.gymnasium import doctor
from tests.support.servers import PATIENCE_S

ADDRESS, OF_PREPARERS = "TESTS_FORK_AT", "TESTS_PREPARE_AT"
"""Environment variables that say where both processes listen; processes that test inherit them."""
LOADED = {
    ADDRESS: "tests.support.loaded_app",
    OF_PREPARERS: "humanplay.tasks.gymnasium.boards",
}
"""What each imports with its first request."""
START_PREPARER, RUN_FRESH = processes.start_process, doctor.run_fresh
"""How users' preparers start, and the processes that `doctor` compares."""
EXECUTED = "TESTS_EXECUTE_PREPARERS"
"""The environment variable that has those of tests start so."""


def pytest_configure(config):
    """Start the processes that fork, once for a run and not in those of xdist."""
    if hasattr(config, "workerinput"):
        return
    folder = tempfile.mkdtemp()
    variables = {ADDRESS: dict(os.environ), OF_PREPARERS: processes.variables()}
    for name, environment in variables.items():
        os.environ[name] = f"{folder}/{name}"
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(os.environ[name])
            listener.listen()
            number = listener.fileno()
            process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(number), LOADED[name]],
                stdin=subprocess.PIPE,
                pass_fds=[number],
                cwd=config.rootpath,
                env=environment,
            )
        for end in (process.wait, process.terminate, process.stdin.close):
            config.add_cleanup(end)
    config.add_cleanup(lambda: shutil.rmtree(folder))


def main(listener, loaded):
    """Fork a server for each request until the run has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the run, and the run ends this
    # nobody waits for the forks that wait for servers
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while sys.stdin not in select.select([listener, sys.stdin], [], [])[0]:
        answers = Connection(listener.accept()[0].detach())
        try:
            task, arguments, count = answers.recv()
            handles = [recv_handle(answers) for _ in range(count)]
        except (EOFError, OSError, RuntimeError):  # whoever asked was killed meanwhile
            answers.close()
            continue
        if loaded not in sys.modules:
            import_module(loaded)
            gc.collect()
            gc.freeze()  # or a collection in each fork would walk, and so copy, all of it
        if os.fork() == 0:
            listener.close()
            run_and_wait(answers, TASKS[task], (*arguments, *handles))
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
        if run in (work, open_page):
            # where nobody asks any more a worker kills its group at once, which is not to be the run's
            os.setpgid(0, 0)
        try:
            run(*arguments)
        except SystemExit as left:
            if isinstance(left.code, str):
                print(left.code, file=sys.stderr)
            os._exit(left.code if isinstance(left.code, int) else int(left.code is not None))
        except BaseException:  # it ends here, and not as the process from which it was forked
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    if run in (work, open_page):
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
    _become(environment, search, folder)
    jobs.work(Connection(connection))


def open_page(environment, search, folder, number, stderr, connection, board):
    """Be the server of a program's `play`, which logs to the descriptor `stderr`.

    number  of the descriptor `board` in the program
    """
    from humanplay.cli.pilot.server import serve

    _become(environment, search, folder)
    stderr, connection, board = (
        fcntl.fcntl(fd, fcntl.F_DUPFD, 1000) for fd in (stderr, connection, board)
    )
    os.dup2(board, number)
    os.dup2(os.open(os.devnull, os.O_RDWR), 0)
    os.dup2(0, 1)
    os.dup2(stderr, 2)
    serve(Connection(connection))


def run_program(environment, folder, words, output):
    """Be `python SCRIPT.py` or `humanplay ARGUMENTS` in a folder.

    What it prints goes to the descriptor `output`.
    """
    from humanplay.cli.main import main

    program, *arguments = words
    is_script = program.endswith(".py")
    atexit._clear()
    _become(environment, [str(folder), *sys.path] if is_script else sys.path, folder)
    os.dup2(output, 1)
    os.dup2(output, 2)
    sys.argv[:] = words
    try:
        if is_script:
            runpy.run_path(program, run_name="__main__")
        else:
            main(arguments)
    finally:
        threading._shutdown()  # as at the end of a program: its threads are waited for
        atexit._run_exitfuncs()
        sys.stdout.flush()


def _become(environment, search, folder):
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:] = search
    os.chdir(folder)


def prepare(words, environment, folder, connection):
    """Be the process of a `Preparer`, over a connection's descriptor.

    words  its module, its argument, and its settings as JSON
    """
    os.setsid()
    _become_fresh(environment, folder)
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in range(3):
        os.dup2(nothing, number)
    processes.serve(*words, connection)


def hash_episodes(request, environment, folder, output, errors):
    """Be a process that `doctor` runs; what it prints goes to two descriptors.

    request  as JSON
    """
    from humanplay.tasks.gymnasium import hashed_episodes

    _become_fresh(environment, folder)
    time.tzset()
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(output, 1)
    os.dup2(errors, 2)
    hashed_episodes.main(hashed_episodes.Request(**json.loads(request)))


def _become_fresh(environment, folder):
    """Be as a process is that is executed with these variables in a folder."""
    search = [folder, *environment["PYTHONPATH"].split(os.pathsep)]
    _become(environment, list(dict.fromkeys([*search, *sys.path])), folder)
    tempfile.tempdir = None  # of this process's own folder
    numpy.random.seed()  # as if numpy had been imported here; Python's own numbers are by themselves


TASKS = {
    "serve": serve,
    "work": work,
    "open_page": open_page,
    "run_program": run_program,
    "prepare": prepare,
    "hash_episodes": hash_episodes,
}


class ForkedProcess:
    """A forked process, with the members of `subprocess.Popen` that are used of it."""

    def __init__(self, task, *arguments, handles=(), address=ADDRESS):
        self.returncode, self._lock = None, threading.Lock()
        sock = socket.socket(socket.AF_UNIX)
        sock.connect(os.environ[address])
        self._answers = Connection(sock.detach())
        self._answers.send((task, arguments, len(handles)))
        for handle in handles:
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

    def send_signal(self, number):
        os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)

    def terminate(self):
        self.send_signal(signal.SIGTERM)


@contextmanager
def output_pipe():
    """Yield what reads a process's output, and the descriptor to hand to its fork."""
    reading, writing = os.pipe()
    try:
        yield os.fdopen(reading, errors="replace"), writing
    finally:
        os.close(writing)


class Worker(jobs._Process):
    """A worker of jobs that is forked."""

    def __init__(self, nice):
        self._connection, others = Pipe()
        del nice
        environment = {**os.environ, **jobs.ONE_THREAD}
        self._process = ForkedProcess(
            "work", environment, sys.path, str(Path.cwd()), handles=[others.fileno()]
        )
        others.close()


class PageProcess(ForkedProcess):
    """The server of a program's `play`, which is forked."""

    def __init__(self, connection, board):
        process = dict(os.environ), sys.path, str(Path.cwd()), board
        with output_pipe() as (self.stderr, writing):
            super().__init__("open_page", *process, handles=[writing, connection, board])

    def wait(self, seconds=None):
        if self.poll(seconds) is None:
            raise subprocess.TimeoutExpired("the server of a page", seconds)
        return self.returncode


class PreparerProcess(ForkedProcess):
    """The process of a `Preparer`."""

    def __init__(self, words, connection, environ, folder):
        started = words, dict(environ), str(folder)
        super().__init__("prepare", *started, handles=[connection], address=OF_PREPARERS)

    def send_signal(self, number):
        if self.poll() is None:
            with suppress(ProcessLookupError):
                super().send_signal(number)


def start_preparer(words, connection, environ, folder):
    """Start the process of a `Preparer`: by a fork, unless `EXECUTED` is set."""
    start = START_PREPARER if EXECUTED in os.environ else PreparerProcess
    return start(words, connection, environ, folder)


def run_fresh(request, environ, folder):
    """Run a process of `doctor`: by a fork if its hash seed is that of preparers."""
    if EXECUTED in os.environ or environ["PYTHONHASHSEED"] != processes.FIXED["PYTHONHASHSEED"]:
        return RUN_FRESH(request, environ, folder)
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        handles = [output.fileno(), errors.fileno()]
        started = request, dict(environ), folder
        process = ForkedProcess("hash_episodes", *started, handles=handles, address=OF_PREPARERS)
        code = process.wait(doctor.TIMEOUT_S)
        printed = []
        for file in (output, errors):
            file.seek(0)
            printed.append(file.read().decode(errors="replace"))
    return subprocess.CompletedProcess([], code, *printed)


class Program(ForkedProcess):
    """A script or `humanplay` in a folder; `stdout` reads what it prints."""

    def __init__(self, folder, *words):
        program = dict(os.environ), str(folder), [*map(str, words)]
        with output_pipe() as (self.stdout, writing):
            super().__init__("run_program", *program, handles=[writing])

    def printed(self):
        """Wait for its end, and return all that it printed; kill one that hangs."""
        limit = threading.Timer(PATIENCE_S, self.kill)
        limit.start()
        try:
            with self.stdout:
                text = self.stdout.read()
            self.wait()
        finally:
            limit.cancel()
        return text


@pytest.fixture(scope="session", autouse=True)
def forked_processes():
    """Fork workers of jobs, servers of `play` and preparers; some tests have others."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jobs, "_Process", Worker)
        patch.setattr(running, "start_process", PageProcess)
        patch.setattr(processes, "start_process", start_preparer)
        patch.setattr(doctor, "run_fresh", run_fresh)
        yield


@pytest.fixture
def executed_preparers(monkeypatch):
    """Preparers and processes of `doctor` are executed anew, as those of users."""
    monkeypatch.setenv(EXECUTED, "1")


class ServerProcess(ForkedProcess):
    """A server's process; `stdout` reads what it printed."""

    def __init__(self, settings, log, listening=None):
        log.touch()
        self.stdout = log.open()
        passed_on = {} if listening is None else {"LISTEN_FDS": "1"}
        handles = [] if listening is None else [listening.fileno()]
        super().__init__("serve", settings, str(log), dict(os.environ) | passed_on, handles=handles)

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


if __name__ == "__main__":
    main(socket.socket(fileno=int(sys.argv[1])), sys.argv[2])
