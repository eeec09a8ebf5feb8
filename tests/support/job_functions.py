"""What the tests let worker processes do."""

import os
import signal
import time


def add(one, two):
    return one + two


def sleep(seconds, word="slept"):
    time.sleep(seconds)
    return word


def pid():
    return os.getpid()


def die():
    os.kill(os.getpid(), signal.SIGKILL)


def fail(path):
    """Note in a file that this was tried, and fail."""
    with path.open("a") as file:
        file.write("tried\n")
    raise ValueError("cannot be done")


def count(total, progress):
    for done in range(1, total + 1):
        progress(done, total)
    return total


def begin_another(path):
    """Begin a process that outlives this call, write its id, and wait."""
    import subprocess

    child = subprocess.Popen(["sleep", "600"])
    path.write_text(str(child.pid))
    time.sleep(600)
