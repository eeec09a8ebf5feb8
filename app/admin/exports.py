"""Reports and releases that the operator asks for: the commands themselves, in processes of low priority.

When a command fails, the last sentence of its stderr is shown. Files live as long as the server.
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

ExportKind = Literal["report", "release"]
KINDS: tuple[ExportKind, ...] = get_args(ExportKind)

_RUN = "import os; os.nice(10); from app.cli.main import main; main()"
_MAX_ERROR_CHARS = 500
"""Characters of a failed command's sentence."""


class ExportRunningError(Exception):
    """The export cannot begin; the message says why."""


@dataclass
class Export:
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
    """The exports of one server; the newest of each kind and study is kept."""

    def __init__(self, database: Path, studies: Path) -> None:
        self._database, self._studies = database, studies
        self._root: Path | None = None
        self._made: dict[tuple[str, ExportKind], Export] = {}

    def state(self, study: str) -> dict[str, Any]:
        """Return the state of each kind of export; None for a kind that was never begun."""
        made = {what: self._made.get((study, what)) for what in KINDS}
        return {what: export and export.to_dict() for what, export in made.items()}

    def begin(self, study: str, what: ExportKind, authors: tuple[str, ...] = ()) -> None:
        """Begin an export; ExportRunningError while any is being made."""
        if any(export.state == "making" for export in self._made.values()):
            raise ExportRunningError("another export is being made: wait until it is done")
        if old := self._made.pop((study, what), None):
            shutil.rmtree(old.folder, ignore_errors=True)
        if self._root is None:
            self._root = Path(tempfile.mkdtemp(prefix="mars-exports-"))
        export = Export(Path(tempfile.mkdtemp(dir=self._root)))
        self._made[study, what] = export
        export.task = asyncio.create_task(
            self._make(export, study, what, authors), name=f"{what} of {study}"
        )

    def file(self, study: str, name: str) -> Path | None:
        """Return the path of a finished file; None when there is none of this name."""
        for what in KINDS:
            export = self._made.get((study, what))
            if export is not None and name in export.files:
                return export.files[name]
        return None

    async def close(self) -> None:
        """End every process and delete every file."""
        for export in self._made.values():
            if export.process is not None:
                with contextlib.suppress(ProcessLookupError):
                    export.process.kill()
            if export.task is not None:
                await export.task
        if self._root is not None:
            await asyncio.to_thread(shutil.rmtree, self._root, ignore_errors=True)

    async def _make(
        self, export: Export, study: str, what: ExportKind, authors: tuple[str, ...]
    ) -> None:
        """Make the files of an export; set its state, its files and what went wrong."""
        folder, files = export.folder, _files(export.folder, study, what)
        options = (
            "--study",
            study,
            "--database",
            str(self._database),
            "--studies",
            str(self._studies),
        )
        try:
            error = await self._run(export, what, *options, *_outputs(folder, what, authors))
            if error is None and what == "release":
                zipped = (str(folder / "release"), "zip", folder / "release")
                await asyncio.to_thread(shutil.make_archive, *zipped)
        except OSError as failure:
            error = f"cannot write the {what}: {(failure.strerror or str(failure)).lower()}"
        export.state, export.error = ("ready", None) if error is None else ("failed", error)
        export.files = {} if error else files

    async def _run(self, export: Export, *words: str) -> str | None:
        """Run a command; return None when it succeeds, else the last line that it wrote to stderr."""
        # a session of its own: Ctrl-C in the server's terminal is not meant for it
        process = export.process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-c",
            _RUN,
            *words,
            stdin=DEVNULL,
            stdout=DEVNULL,
            stderr=PIPE,
            start_new_session=True,
        )
        said = (await process.communicate())[1].decode(errors="replace").strip()
        if process.returncode == 0:
            return None
        last = said.splitlines()[-1] if said else f"it ended with code {process.returncode}"
        return last.removeprefix("marsexplorer: ")[:_MAX_ERROR_CHARS]


def _files(folder: Path, study: str, what: ExportKind) -> dict[str, Path]:
    """Return the files of a finished export by the name they are downloaded under."""
    if what == "report":
        return {
            f"{study}-report.html": folder / "report.html",
            f"{study}-report.json": folder / "report.json",
        }
    return {f"{study}-release.zip": folder / "release.zip"}


def _outputs(folder: Path, what: ExportKind, authors: tuple[str, ...]) -> list[str]:
    """Return the options that say what the command writes."""
    if what == "report":
        return ["--html", str(folder / "report.html"), "--json", str(folder / "report.json")]
    return [
        "--out",
        str(folder / "release"),
        *(word for author in authors for word in ("--author", author)),
    ]
