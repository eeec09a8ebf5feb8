"""A server that is killed in the middle of a write, a program of its own."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager

from humanplay.cli.main import cli
from humanplay.db.series import StudyStore
from tests.support.servers import RunningServer


@contextmanager
def dying(path, moves):
    """A server of a database that dies as it moves somebody to a stage.

    Args:
        moves: Which of its moves to a stage is the last: it is written then, and neither committed
            nor followed by what belongs to it.
    """
    command = [sys.executable, "-m", __name__, str(path), str(moves)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        line = next(line for line in process.stdout if "is open at" in line)
        server = RunningServer(int(line.split("http://127.0.0.1:")[1].split()[0]))
        try:
            yield server
            assert process.wait(60) == -signal.SIGKILL
        finally:
            process.kill()
            server.close()


def main(path, moves):
    """Serve, and die with the move to a stage that has this number."""
    whole, done = StudyStore.set_stage, []

    def set_stage(*args, **columns):
        whole(*args, **columns)
        done.append(args)
        if len(done) == moves:
            os.kill(os.getpid(), signal.SIGKILL)

    StudyStore.set_stage = set_stage
    cli(["serve", "--port", "0", "--database", path])


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
