"""A server that is killed in the middle of a write, a program of its own."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager

from humanplay.cli.main import cli
from humanplay.db import database
from humanplay.db.series import StudyStore
from tests.support.servers import RunningServer

WRITES = ("INSERT", "UPDATE", "DELETE", "COMMIT", "RELEASE")
"""How statements begin that write."""


@contextmanager
def dying(path, **last):
    """A server of a database that dies after so many moves, or before a write.

    Args:
        last: `moves`: which of its moves to a stage is the last: it is written then, and neither
            committed nor followed by what belongs to it. Or `writes`: which write is not made any
            more, from the first on that is of somebody's way.
    """
    ((counted, number),) = last.items()
    command = [sys.executable, "-m", __name__, str(path), counted, str(number)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        line = next(line for line in process.stdout if "is open at" in line)
        server = RunningServer(int(line.split("http://127.0.0.1:")[1].split()[0]))
        try:
            yield server
            assert process.wait(60) == -signal.SIGKILL
        finally:
            process.kill()
            server.close()


def die():
    os.kill(os.getpid(), signal.SIGKILL)


def die_after_moves(number):
    """Die with the move to a stage that has this number."""
    original, done = StudyStore.set_stage, []

    def set_stage(*args, **columns):
        original(*args, **columns)
        done.append(args)
        if len(done) == number:
            die()

    StudyStore.set_stage = set_stage


def die_before_write(number):
    """Die before the write that has this number, from somebody's first on."""
    original, writes = database._connect, []

    def note(statement):
        is_write = statement.lstrip().startswith(WRITES)
        if is_write and (writes or statement.startswith("INSERT INTO stage_events")):
            writes.append(statement)
            if len(writes) == number:
                die()

    def connect(*args, **options):
        connection = original(*args, **options)
        connection.set_trace_callback(note)
        return connection

    database._connect = connect


if __name__ == "__main__":
    {"moves": die_after_moves, "writes": die_before_write}[sys.argv[2]](int(sys.argv[3]))
    cli(["serve", "--port", "0", "--database", sys.argv[1]])
