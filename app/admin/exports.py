"""Report and release at the press of a button: the commands themselves, in processes of low priority.

What a command says on stderr when it fails is the sentence that is shown. Files live as long as the server.
"""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import sys
import tempfile
import time
from asyncio.subprocess import DEVNULL, PIPE, Process
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

What = Literal["report", "release"]
KINDS: tuple[What, ...] = get_args(What)

_RUN = "import os; os.nice(10); from app.cli.main import main; main()"
_KEPT = 500
"""Characters of a failed command's sentence."""


class ExportRunningError(Exception):
    """The export cannot begin; the message says why."""


@dataclass
class Making:
    """One export: `state` is "making", "ready" or "failed"; `files` by the name they are downloaded under."""

    folder: Path
    state: str = "making"
    began_ms: int = field(default_factory=lambda: time.time_ns() // 1_000_000)
    error: str | None = None
    files: dict[str, Path] = field(default_factory=dict)
    process: Process | None = None
    task: asyncio.Task[None] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return what the page shows."""
        files = [{"name": name, "size": path.stat().st_size} for name, path in self.files.items()]
        return {"state": self.state, "began_ms": self.began_ms, "error": self.error, "files": files}


class Exports:
    """One server's; the newest of each kind and study is kept."""

    def __init__(self, database: Path, studies: Path) -> None:
        self._database, self._studies = database, studies
        self._root: Path | None = None
        self._made: dict[tuple[str, What], Making] = {}

    def state(self, study: str) -> dict[str, Any]:
        """Return per kind how its export stands; None before the first."""
        made = {what: self._made.get((study, what)) for what in KINDS}
        return {what: making and making.to_dict() for what, making in made.items()}

    def begin(self, study: str, what: What, authors: tuple[str, ...] = ()) -> None:
        """Begin an export; ExportRunningError while any is being made."""
        if any(making.state == "making" for making in self._made.values()):
            raise ExportRunningError("another export is being made: wait until it is done")
        if old := self._made.pop((study, what), None):
            shutil.rmtree(old.folder, ignore_errors=True)
        if self._root is None:
            self._root = Path(tempfile.mkdtemp(prefix="mars-exports-"))
        making = Making(Path(tempfile.mkdtemp(dir=self._root)))
        self._made[study, what] = making
        making.task = asyncio.create_task(self._make(making, study, what, authors), name=f"{what} of {study}")

    def file(self, study: str, name: str) -> Path | None:
        """Return where a finished file lies; None when there is none of this name."""
        for what in KINDS:
            making = self._made.get((study, what))
            if making is not None and name in making.files:
                return making.files[name]
        return None

    async def close(self) -> None:
        """Return with every process ended and every file gone."""
        for making in self._made.values():
            if making.process is not None:
                with contextlib.suppress(ProcessLookupError):
                    making.process.kill()
            if making.task is not None:
                await making.task
        if self._root is not None:
            await asyncio.to_thread(shutil.rmtree, self._root, ignore_errors=True)

    async def _make(self, making: Making, study: str, what: What, authors: tuple[str, ...]) -> None:
        folder = making.folder
        files = (
            {f"{study}-report.html": folder / "report.html", f"{study}-report.json": folder / "report.json"}
            if what == "report"
            else {f"{study}-release.zip": folder / "release.zip"}
        )
        options = ["--study", study, "--database", str(self._database), "--studies", str(self._studies)]
        if what == "report":
            options += ["--html", str(folder / "report.html"), "--json", str(folder / "report.json")]
        else:
            options += ["--out", str(folder / "release")]
            options += [word for author in authors for word in ("--author", author)]
        try:
            error = await self._run(making, what, *options)
            if error is None and what == "release":
                zipped = (str(folder / "release"), "zip", folder / "release")
                await asyncio.to_thread(shutil.make_archive, *zipped)
        except OSError as failure:
            error = f"cannot write the {what}: {(failure.strerror or str(failure)).lower()}"
        making.state, making.error = ("ready", None) if error is None else ("failed", error)
        making.files = {} if error else files

    async def _run(self, making: Making, *words: str) -> str | None:
        """Return None once the command has done its work, else the last thing it said."""
        # a session of its own: Ctrl-C in the server's terminal is not meant for it
        process = making.process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", _RUN, *words, stdin=DEVNULL, stdout=DEVNULL, stderr=PIPE, start_new_session=True
        )
        said = (await process.communicate())[1].decode(errors="replace").strip()
        if process.returncode == 0:
            return None
        last = said.splitlines()[-1] if said else f"it ended with code {process.returncode}"
        return last.removeprefix("marsexplorer: ")[:_KEPT]
