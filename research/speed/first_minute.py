"""The first minute on a machine that has compiled nothing.

`python -m research.speed.first_minute`

It prints what each kernel takes to compile, and what a server and the processes beside it take
until the first page, the first board and the first move of `ppo`, each beside what is wanted. Linux
only.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import click
import httpx

from humanplay.command.console import print_table
from research.speed.start import FIRST_STEP, seconds
from tests.support.fresh_machine import children, fresh_server, processor_s, resident_mb

MOST_S = 600.0
WANTED = {
    "first page, nothing compiled": 2.5,
    "first board, nothing compiled": 8.0,
    "first page, all compiled": 1.5,
    "first step of gymnasium.make, nothing compiled": 6.0,
    "resident before anybody plays": 225.0,
    "resident after ppo has played": 300.0,
}
"""At most: processor seconds of the server and what it starts, and MB."""
LIST_KERNELS = """
import json, time
from pathlib import Path
from numba.core import event
from marsexplorer.compiled import FunctionCache
from marsexplorer.warmup import warmups

class Listener(event.Listener):
    running, took = [], {}

    def on_start(self, event):
        self.running.append([time.process_time(), 0.0])

    def on_end(self, event):
        began, nested = self.running.pop()
        took = time.process_time() - began
        if self.running:
            self.running[-1][1] += took
        function = event.data["dispatcher"].py_func
        entry = self.took.setdefault(f"{function.__module__}.{function.__qualname__}", [0, 0.0])
        entry[0] += 1
        entry[1] += took - nested

event.register("numba:compile", Listener())
for warmup in warmups():
    warmup()
print(json.dumps(Listener.took))
"""


class Measurement(NamedTuple):
    """A figure of WANTED, with its unit."""

    name: str
    value: float
    unit: str


def list_kernels(cache: Path) -> list[tuple[str, str, str, str]]:
    """Name, compilations, processor seconds and kB of each kernel, the slowest first."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", LIST_KERNELS],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    took: dict[str, tuple[int, float]] = json.loads(done.stdout)
    rows = []
    for name, (count, cpu_s) in sorted(took.items(), key=lambda kernel: -kernel[1][1]):
        stem = ".".join(name.split(".")[-2:])
        size = sum(path.stat().st_size for path in cache.rglob(f"{stem}-*.nbc"))
        rows.append((name, str(count), f"{cpu_s:.2f}", f"{size / 1000:.0f}" if size else ""))
    return rows


def taken_s(process: int) -> float:
    """Return the processor seconds of a server and of what it has started."""
    return float(processor_s(process, *children(process)))


def measure_server(cache: Path, state: str) -> list[Measurement]:
    """What a server takes until its first page, first board, and first `ppo` move."""
    with (
        tempfile.TemporaryDirectory() as folder,
        fresh_server(cache, Path(folder) / "moves.db") as (process, port),
        httpx.Client(
            base_url=f"http://127.0.0.1:{port}", timeout=MOST_S, trust_env=False
        ) as client,
    ):
        client.get("/").raise_for_status()
        figures = [Measurement(f"first page, {state}", taken_s(process), "CPU s")]
        if state == "all compiled":
            resident, anonymous = resident_mb(process)
            figures.append(Measurement("resident before anybody plays", resident, "MB"))
            figures.append(Measurement("of it anonymous", anonymous, "MB"))
        client.post("/api/sessions", json={}).raise_for_status()
        figures.append(Measurement(f"first board, {state}", taken_s(process), "CPU s"))
        if state == "all compiled":
            wait_for_move(client, client.post("/api/sessions", json={"player": "ppo"}).json())
            resident, anonymous = resident_mb(process)
            figures.append(Measurement("resident after ppo has played", resident, "MB"))
            figures.append(Measurement("then anonymous", anonymous, "MB"))
    return figures


def wait_for_move(client: httpx.Client, board: dict[str, Any]) -> None:
    """Wait until a policy's board has moved."""
    while client.get(f"/api/sessions/{board['session']}").json()["step"] == 0:
        time.sleep(0.2)


@click.command()
def main() -> None:
    """Measure what a machine that has compiled nothing takes.

    That is each kernel, a server's first page and board, and memory.
    """
    with tempfile.TemporaryDirectory() as folder:
        cold, full = Path(folder) / "cold", Path(folder) / "full"
        kernels = list_kernels(full)
        measures = measure_server(cold, "nothing compiled")
        measures += measure_server(full, "all compiled")
        first_step, _ = seconds(FIRST_STEP, str(Path(folder) / "step"))
    measures.append(
        Measurement("first step of gymnasium.make, nothing compiled", first_step, "CPU s")
    )
    print_table("Kernels", ("kernel", "versions", "CPU s", "kB"), kernels)
    click.echo(f"{sum(float(row[2]) for row in kernels):.1f} CPU s in all")
    rows = [
        (
            name,
            f"{number:.2f} {unit}" if unit == "CPU s" else f"{number:.0f} {unit}",
            f"{WANTED[name]:g}" if name in WANTED else "",
        )
        for name, number, unit in measures
    ]
    print_table("The first minute", ("what", "measured", "at most"), rows)


if __name__ == "__main__":
    main()
