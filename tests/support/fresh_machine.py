"""A server on a machine that has compiled nothing, and its cost, by Linux's /proc."""

import os
import sys
from contextlib import contextmanager
from pathlib import Path

from tests.support.command_server import command_server


@contextmanager
def fresh_server(cache, database, python=sys.executable):
    """Yield a server's process and port; it caches its kernels in the folder `cache`."""
    command = [python, "-m", "humanplay.cli", "serve", "--port", "0"]
    environ = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    with command_server([*command, "--database", database], env=environ) as (process, address):
        yield process.pid, int(address.rpartition(":")[2].strip("/"))


def stat(pid):
    """The fields of a process from its state on (proc(5))."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()


def children(pid):
    """The processes that a process has started, and that still run."""
    running = (int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit())
    pids = []
    for other in running:
        try:
            if int(stat(other)[1]) == pid:
                pids.append(other)
        except (FileNotFoundError, ProcessLookupError):  # it has ended meanwhile
            continue
    return pids


def processor_s(*pids):
    """Seconds of the processor that processes have had."""
    ticks = sum(int(number) for pid in pids for number in stat(pid)[11:13])
    return ticks / os.sysconf("SC_CLK_TCK")


def resident_mb(pid):
    """Resident memory of a process, and what of it is anonymous, in MB."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    sizes = {line.partition(":")[0]: line.split()[1] for line in lines[1:]}
    return int(sizes["Rss"]) / 1000, int(sizes["Anonymous"]) / 1000
