"""A server as it starts on a machine that has compiled nothing, and what its processes take; of Linux's /proc."""

import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

STOP_S = 30.0


@contextmanager
def fresh_server(cache, database):
    """Yield a server by its command, which keeps what is compiled in the folder `cache`: its process, and its port."""
    command = [sys.executable, "-m", "humanplay.cli", "serve", "--port", "0"]
    with subprocess.Popen(
        [*command, "--database", str(database)],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    ) as process:  # fmt: skip
        try:
            line = next(line for line in process.stdout if "http://" in line)
            yield process.pid, int(line.partition("http://127.0.0.1:")[2].split()[0].strip("/"))
        finally:
            process.terminate()
            process.wait(STOP_S)


def stat(pid):
    """The fields of a process from its state on (proc(5))."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()


def children(pid):
    """The processes that a process has started, and that still run."""
    running = (int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit())
    found = []
    for other in running:
        try:
            if int(stat(other)[1]) == pid:
                found.append(other)
        except (FileNotFoundError, ProcessLookupError):  # it has ended meanwhile
            continue
    return found


def processor_s(*pids):
    """Seconds of the processor that processes have had."""
    ticks = sum(int(number) for pid in pids for number in stat(pid)[11:13])
    return ticks / os.sysconf("SC_CLK_TCK")


def resident_mb(pid):
    """Resident memory of a process, and what of it is anonymous, in MB."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    sizes = {line.partition(":")[0]: line.split()[1] for line in lines[1:]}
    return int(sizes["Rss"]) / 1000, int(sizes["Anonymous"]) / 1000
