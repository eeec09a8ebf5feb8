"""A server for hours: players, studies, backups, exports, floods; does it grow?

    python -m research.speed.soak [--minutes 360] [--every 60] [--out build/soak] [--participants 5]
                                  [--visitors 10]

Ten participants of two studies play at a person's pace, ten people come, move three times and go,
and watch now and then; a run on a busy machine may have fewer of both. A backup and an export are
made every 30 minutes, or three of each in a short run. Twenty times, or once an hour in a run of
more than twenty, one client floods the server for up to a minute, another way each time, so that
each quarter has had all five. A sample is taken every `--every` seconds. At the end come SIGTERM
and `verify`. What is written: soak.csv, a line a sample; soak.svg, its curves; and pieces.csv, to
which each run adds a line with its moves, p99, disk and slope of memory, so that short runs on
different days are judged together. The exit code is 1 where the server does not end with 0 within
five seconds, `verify` finds something, or the last quarter's median is above that of the second by
more than 15 % of the descriptors or, in a run of 120 minutes or more, 5 % of the memory. A run
takes twelve samples at least.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import logging
import os
import random
import secrets
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from matplotlib.figure import Figure

from humanplay.web.simulate import ParticipantSummary, Plan, RefusedError, ServerAwayError, simulate
from tests.app.protection.test_bare_port import MISBEHAVING
from tests.app.protection.test_memory import come_and_go
from tests.support.others import misbehaving
from tests.support.servers import RunningServer
from tests.support.study import freeze

STUDIES = ("first", "second")
PAUSE_S = (6.0, 10.0)
"""Between two visits of one person: ten of them stay below what one address may begin."""
KINDS = ("pings", "messages", "requests", "head", "silent")
MOST_GROWTH = {"resident_mb": 1.05, "descriptors": 1.15}
FEWEST = 12
"""Samples of a run: the medians of its quarters are compared, of three at least."""
STOP_S = 5.0
MEMORY_MINUTES, STEADY_MINUTES = 120.0, 10.0
"""From how long a run on memory is judged, and after which minute its slope is taken."""
CURVES = {
    "resident_mb": "resident memory, MB",
    "descriptors": "file descriptors",
    "p99_ms": "a participant's move, p99, ms",
    "database_mb": "database and log, MB",
}


class Soak:
    """A server in a process of its own, and everybody who is at it."""

    def __init__(self, folder: Path, minutes: float, participants: int, visitors: int) -> None:
        self._participants, self._visitors = participants, visitors
        self._database, self._summaries = folder / "playground.db", list[list[ParticipantSummary]]()
        self._over, self._token = threading.Event(), secrets.token_hex(16)
        for name in STUDIES:
            freeze(folder / "playground.db-studies", name, players=1000)
        settings = {
            "DATABASE": self._database,
            "PORT": 0,
            "BACKUP_EVERY": min(30.0, minutes / 3),
            "BACKUP_TO": folder / "backups",
            "LIMITS__TOKEN": self._token,
        }
        environment = os.environ | {
            f"HUMANPLAY_{name}": str(setting) for name, setting in settings.items()
        }
        command = [sys.executable, "-m", "humanplay.cli", "serve"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        assert self.process.stdout is not None
        line = next(line for line in self.process.stdout if "is open at" in line)
        self.server = RunningServer(int(line.split("http://127.0.0.1:")[1].split()[0]))

    def begin(self) -> list[threading.Thread]:
        """Let everybody come; the threads end soon after `end`."""
        works: list[Callable[[int], None]] = [self._take_part] * len(STUDIES)
        works += [self._visit] * self._visitors
        threads = [threading.Thread(target=work, args=[n]) for n, work in enumerate(works)]
        for thread in threads:
            thread.start()
        return threads

    def _take_part(self, number: int) -> None:
        for seed in itertools.count():
            summaries: list[ParticipantSummary] = []
            self._summaries.append(summaries)
            plan = Plan(
                self.server.url,
                STUDIES[number],
                self._participants,
                seed,
                leaving=0.2,
                speed=1.0,
                wait_s=2.0,
                token=self._token,
            )
            try:
                simulate(plan, summaries)
            except (ServerAwayError, RefusedError, TimeoutError) as error:
                if not self._over.is_set():
                    print(f"participants of {plan.study} begin anew: {error}", flush=True)
            if self._over.wait(1.0):
                return

    def _visit(self, number: int) -> None:
        pause = random.Random(number)
        for visit in itertools.count(number, self._visitors):
            if self._over.wait(pause.uniform(*PAUSE_S)):
                return
            with suppress(httpx.TransportError, KeyError, OSError, TimeoutError, RefusedError):
                come_and_go(self.server, visit)

    def flood(self, kind: str, seconds: float) -> None:
        """Misbehave from an address of its own."""
        begun = httpx.post(f"{self.server.url}/api/sessions", json={"size": 9}).json()
        path = f"/ws/sessions/{begun['session']}"
        with misbehaving(MISBEHAVING, self.server.port, path, kind):
            self._over.wait(seconds)

    def export(self) -> int:
        """Return the status with which the table of steps is answered, once it has come."""
        with suppress(httpx.TransportError):
            return httpx.get(f"{self.server.url}/api/export/steps.csv", timeout=600).status_code
        return 0

    def sample(self) -> dict[str, float]:
        """A sample of the curves, with the participants' moves since the last one."""
        proc = Path(f"/proc/{self.process.pid}")
        resident = (proc / "status").read_text().split("VmRSS:")[1].split()[0]
        files = [self._database, self._database.with_name("playground.db-wal")]
        trips: list[float] = []
        for summary in itertools.chain.from_iterable(self._summaries):
            count = len(summary.round_trips_ms)
            trips += summary.round_trips_ms[:count]
            del summary.round_trips_ms[:count]
        return {
            "resident_mb": int(resident) / 1024,
            "descriptors": len(list((proc / "fd").iterdir())),
            "p99_ms": float(np.percentile(trips, 99)) if trips else float("nan"),
            "moves": len(trips),
            "database_mb": sum(file.stat().st_size for file in files if file.exists()) / 1e6,
        }

    def end(self) -> tuple[int, float]:
        """End the server by SIGTERM; return its exit code and how many seconds it took."""
        self._over.set()
        began = time.monotonic()
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(60), time.monotonic() - began


def run(
    soak: Soak, folder: Path, minutes: float, every_s: float
) -> tuple[list[dict[str, Any]], bool]:
    """The samples of a soak, and whether server and database ended well."""
    with ExitStack() as stack:
        stack.callback(soak.process.kill)
        threads, began, samples = soak.begin(), time.monotonic(), list[dict[str, Any]]()
        flooded_s, half_s = min(3600.0, 3 * minutes), min(1800.0, 20 * minutes)
        flood_s = min(60.0, flooded_s / 4)
        events = [
            (flooded_s * (n + 0.5), KINDS[n % len(KINDS)])
            for n in range(int(60 * minutes / flooded_s))
        ]
        events += [(half_s * (n + 0.75), "export") for n in range(int(60 * minutes / half_s))]
        events.sort()
        while (now := time.monotonic() - began) < 60 * minutes:
            noted = []
            while events and events[0][0] <= now:
                noted.append(name := events.pop(0)[1])
                work = (
                    soak.export if name == "export" else lambda name=name: soak.flood(name, flood_s)
                )
                threads.append(threading.Thread(target=work))
                threads[-1].start()
            time.sleep(every_s)
            samples.append(
                {
                    "minutes": (time.monotonic() - began) / 60,
                    **soak.sample(),
                    "began": " ".join(noted),
                }
            )
            print(
                "  ".join(
                    f"{key} {number:.1f}" if isinstance(number, float) else f"{key} {number}"
                    for key, number in samples[-1].items()
                ),
                flush=True,
            )
        code, took_s = soak.end()
        for thread in threads:
            thread.join()
    print(f"SIGTERM: exit code {code} after {took_s:.1f} s", flush=True)
    arguments = ["--database", str(folder / "playground.db")]
    verified = subprocess.run(
        [sys.executable, "-m", "humanplay.cli", "verify", *arguments]
    ).returncode
    print(f"{len(list((folder / 'backups').glob('*.db')))} backups")
    return samples, code == 0 and took_s < STOP_S and verified == 0


def growth(samples: list[dict[str, Any]], name: str) -> float:
    """The median of the last quarter over that of the second."""
    values, quarter = [sample[name] for sample in samples], len(samples) // 4
    return float(np.median(values[-quarter:]) / np.median(values[quarter : 2 * quarter]))


def draw(samples: list[dict[str, Any]], path: Path) -> None:
    """Draw the curves over the minutes, with a grey line where a flood began."""
    figure = Figure(figsize=(8, 9), layout="constrained")
    for axes, (name, title) in zip(
        figure.subplots(len(CURVES), sharex=True), CURVES.items(), strict=True
    ):
        axes.plot([sample["minutes"] for sample in samples], [sample[name] for sample in samples])
        axes.set_title(title, loc="left", fontsize=9)
        axes.set_ylim(bottom=0)
        for sample in samples:
            if set(sample["began"].split()) & set(KINDS):
                axes.axvline(sample["minutes"], color="0.8", zorder=0)
    axes.set_xlabel("minutes; grey: a flood")
    figure.savefig(path)


def slope(samples: list[dict[str, Any]]) -> float:
    """MB of memory an hour from minute ten on; NaN with fewer than three samples."""
    later = [sample for sample in samples if sample["minutes"] > STEADY_MINUTES]
    if len(later) < 3:
        return float("nan")
    minutes, resident_mb = ([s[name] for s in later] for name in ("minutes", "resident_mb"))
    return 60 * float(np.polyfit(minutes, resident_mb, 1)[0])


def piece_of(samples: list[dict[str, Any]], is_well: bool) -> dict[str, object]:
    """The line of a run in pieces.csv."""
    moves, p99s = (np.array([s[name] for s in samples], float) for name in ("moves", "p99_ms"))
    grown_mb = samples[-1]["database_mb"] - samples[0]["database_mb"]
    return {
        "ended": time.strftime("%Y-%m-%dT%H:%MZ", time.gmtime()),
        "minutes": round(samples[-1]["minutes"], 1),
        "moves": int(moves.sum()),
        "median_p99_ms": round(float(np.nanmedian(p99s)), 1),
        "worst_p99_ms": round(float(np.nanmax(p99s)), 1),
        "bytes_a_move": round(1e6 * grown_mb / max(1, moves[1:].sum())),
        "memory_mb_an_hour": round(slope(samples), 2),
        "ended_well": is_well,
    }


def join_piece(path: Path, piece: dict[str, object]) -> str:
    """Add a run's line to pieces.csv, and sum up all of them."""
    is_new = not path.exists()
    with path.open("a", newline="") as file:
        table = csv.DictWriter(file, piece)
        if is_new:
            table.writeheader()
        table.writerow(piece)
    with path.open(newline="") as file:
        pieces = list(csv.DictReader(file))
    minutes, moves, worst = (
        [float(row[name]) for row in pieces] for name in ("minutes", "moves", "worst_p99_ms")
    )
    failed = sum(row["ended_well"] != "True" for row in pieces)
    return (
        f"{len(pieces)} pieces, {sum(minutes):.0f} minutes, {sum(moves):,.0f} moves: p99 of a "
        f"sample at most {max(worst):.0f} ms, {failed} ended badly"
    )


def main() -> int:
    """Run the soak, write its files, print what grew, and return the exit code."""
    logging.getLogger("websockets").setLevel(
        logging.CRITICAL
    )  # of sockets that are cut off on purpose
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--minutes", type=float, default=360.0)
    parser.add_argument("--every", type=float, default=60.0, help="seconds between samples")
    parser.add_argument("--out", type=Path, default=Path("build/soak"))
    parser.add_argument("--participants", type=int, default=5, help="of each of the two studies")
    parser.add_argument("--visitors", type=int, default=10)
    options = parser.parse_args()
    if 60 * options.minutes < FEWEST * options.every:
        parser.error(
            f"expected {FEWEST} samples at least: more --minutes, or fewer seconds in --every"
        )
    options.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        soak = Soak(Path(folder), options.minutes, options.participants, options.visitors)
        samples, is_well = run(soak, Path(folder), options.minutes, options.every)
    with (options.out / "soak.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, samples[0])
        table.writeheader()
        table.writerows(samples)
    draw(samples, options.out / "soak.svg")
    grown = {name: growth(samples, name) for name in MOST_GROWTH}
    print(", ".join(f"{name} x {factor:.3f}" for name, factor in grown.items()))
    print(join_piece(options.out / "pieces.csv", piece_of(samples, is_well)))
    judged = MOST_GROWTH if options.minutes >= MEMORY_MINUTES else {"descriptors"}
    is_flat = all(grown[name] <= MOST_GROWTH[name] for name in judged)
    return 0 if is_well and is_flat else 1


if __name__ == "__main__":
    sys.exit(main())
