"""Another process that holds the lock for writing on a database."""

import subprocess
import sys
from contextlib import contextmanager

HOLD = """import sqlite3, sys
db = sqlite3.connect(sys.argv[1], isolation_level=None)
db.execute("BEGIN IMMEDIATE")
print("locked", flush=True)
sys.stdin.read()
db.execute("ROLLBACK")
db.close()
print("free", flush=True)
"""


@contextmanager
def locked_elsewhere(path):
    """Let another process hold the lock for writing during the block."""
    command = [sys.executable, "-c", HOLD, str(path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "locked\n"
        try:
            yield
        finally:
            process.stdin.close()
            assert process.stdout.readline() == "free\n"
