"""The first minute on a machine that has compiled nothing.

    python -m research.speed.first_minute [--against COMMIT] [--python PATH]

It prints what each kernel takes to compile, and what a server and the processes beside it take
until the first page, the first board and the first move of `ppo`, each beside what is wanted. With
`--against` the checkout and a commit are measured in turns, PAIRS times, and the medians of both
stand beside the median of their differences, pair by pair. With `--python` what is measured has the
packages of another environment: SciPy, say, takes memory where it is installed. Linux only.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import click
import httpx

from humanplay.command.console import print_table
from research.speed.start import FIRST_STEP, seconds
from tests.support.fresh_machine import children, fresh_server, processor_s, resident_mb

ROOT = Path(__file__).parents[2]
PAIRS = 4
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


def list_kernels(cache: Path, python: str) -> list[tuple[str, str, str, str]]:
    """Name, compilations, processor seconds and kB of each kernel, the slowest first."""
    done = subprocess.run(
        [python, "-W", "ignore", "-c", LIST_KERNELS],
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


def measure_server(cache: Path, state: str, python: str) -> list[Measurement]:
    """What a server takes until its first page, first board, and first `ppo` move."""
    with (
        tempfile.TemporaryDirectory() as folder,
        fresh_server(cache, Path(folder) / "moves.db", python) as (process, port),
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


def unpack(commit: str, folder: Path) -> None:
    """Write the files of a commit into a folder; UsageError if there is none."""
    archive = folder.with_suffix(".tar")
    command = ["git", "archive", "--output", str(archive), commit]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise click.UsageError(f"{commit} cannot be read: {done.stderr.strip()}")
    with tarfile.open(archive) as files:
        files.extractall(folder, filter="data")


@contextmanager
def importing_from(tree: Path) -> Iterator[None]:
    """Let processes that begin meanwhile import the packages of a checkout."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(tree), str(tree / "app")])
    try:
        with chdir(tree):
            yield
    finally:
        if before is None:
            del os.environ["PYTHONPATH"]
        else:
            os.environ["PYTHONPATH"] = before


class Tree:
    """A checkout that is measured, with folders for what it compiles.

    kernels  the rows of `list_kernels`
    """

    def __init__(self, tree: Path, folder: Path, python: str) -> None:
        self._tree, self._folder, self._python = tree, folder, python
        with importing_from(tree):
            self.kernels = list_kernels(folder / "full", python)

    def measure(self) -> list[Measurement]:
        """Measure a first page, board, move and step."""
        cold = Path(tempfile.mkdtemp(dir=self._folder))
        with importing_from(self._tree):
            measures = measure_server(cold / "server", "nothing compiled", self._python)
            measures += measure_server(self._folder / "full", "all compiled", self._python)
            first_step, _ = seconds(FIRST_STEP, str(cold / "step"), self._python)
        name = "first step of gymnasium.make, nothing compiled"
        return [*measures, Measurement(name, first_step, "CPU s")]


def print_measures(measures: list[Measurement]) -> None:
    """Print figures beside what is wanted."""
    rows = [(name, with_unit(number, unit), limit_of(name)) for name, number, unit in measures]
    print_table("The first minute", ("what", "measured", "at most"), rows)


def measure_pair(
    here: Tree, there: Tree, begins_here: bool
) -> tuple[list[Measurement], list[Measurement]]:
    """Measure both; they take turns to begin, so that neither has the warmer machine."""
    if begins_here:
        first = here.measure()
        return first, there.measure()
    second = there.measure()
    return here.measure(), second


def print_pairs(commit: str, pairs: list[tuple[list[Measurement], list[Measurement]]]) -> None:
    """Print the medians of the checkout and of a commit, and of their differences."""
    rows = []
    for measures in zip(*(zip(*pair, strict=True) for pair in pairs), strict=True):
        name, _, unit = measures[0][0]
        here, before = ([pair[side].value for pair in measures] for side in (0, 1))
        differences = [one - other for one, other in zip(here, before, strict=True)]
        figures = (with_unit(median(here), unit), with_unit(median(before), unit))
        rows.append((name, *figures, f"{median(differences):+.2f}", limit_of(name)))
    title = f"The first minute, medians of {len(pairs)} pairs"
    print_table(title, ("what", "here", commit, "difference", "at most"), rows)


def with_unit(number: float, unit: str) -> str:
    """A figure with its unit."""
    return f"{number:.2f} {unit}" if unit == "CPU s" else f"{number:.0f} {unit}"


def limit_of(name: str) -> str:
    """The most that is wanted of a figure; empty if nothing is."""
    return f"{WANTED[name]:g}" if name in WANTED else ""


@click.command()
@click.option("--against", metavar="COMMIT", help="Measure this commit too, in turns.")
@click.option(
    "--python",
    default=sys.executable,
    type=click.Path(exists=True, dir_okay=False),
    help="The interpreter of the environment to measure; this one's by default.",
)
def main(against: str | None, python: str) -> None:
    """Measure what a machine that has compiled nothing takes.

    That is each kernel, a server's first page and board, and memory.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if against:
            unpack(against, folder / "commit")
        python = str(Path.cwd() / python)  # processes begin in another folder
        here = Tree(ROOT, folder / "here", python)
        print_table("Kernels", ("kernel", "versions", "CPU s", "kB"), here.kernels)
        click.echo(f"{sum(float(row[2]) for row in here.kernels):.1f} CPU s in all")
        if against is None:
            print_measures(here.measure())
            return
        there = Tree(folder / "commit", folder / "there", python)
        print_pairs(
            against, [measure_pair(here, there, number % 2 == 0) for number in range(PAIRS)]
        )


if __name__ == "__main__":
    main()
