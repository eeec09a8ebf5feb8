"""A server that its command starts, in the test's own environment and folder."""

import re
import subprocess
from contextlib import contextmanager

from tests.support.servers import PATIENCE_S


def address_in(stdout):
    """The address at which a server is open, read from what it prints to `stdout`."""
    printed = []
    for line in stdout:
        printed.append(line)
        if "is open at" in line:
            break
    address = re.search(r"http://\S+", "".join(printed))
    assert address, "".join(printed)
    return address[0]


@contextmanager
def command_server(command, **options):
    """Yield the process of a command that serves, and its address.

    Whoever reads `process.stdout` has what it prints after that.
    """
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen([*map(str, command)], **pipes, **options) as process:
        try:
            yield process, address_in(process.stdout)
        finally:
            process.terminate()
            try:
                process.communicate(timeout=PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
