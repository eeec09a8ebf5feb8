"""Reports and releases that the operator asks for: the commands themselves, each as a job.

When a command fails, the last sentence of its stderr is shown. Files live as long as the server.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from humanplay.jobs import Jobs, JobsFullError
from humanplay.web.answers import operator as answers
from humanplay.web.downloads import Downloads

ExportKind = Literal["report", "release"]
KINDS: tuple[ExportKind, ...] = get_args(ExportKind)
OWNER = "operator"
"""Whose jobs exports are."""
LIMIT_S = 4 * 3600.0
"""Seconds that a report or a release may take."""
_MAX_ERROR_CHARS = 500
"""Characters of a failed command's sentence."""


class ExportError(Exception):
    """The export cannot begin, or has failed; the message says why."""


@dataclass
class Export:
    """One export: `making` is its job, `files` are by the name they are downloaded under."""

    folder: Path
    making: Future[None]
    files: dict[str, Path]
    began_ms: int = field(default_factory=lambda: time.time_ns() // 1_000_000)

    @property
    def state(self) -> Literal["making", "ready", "failed"]:
        """ "making", "ready" or "failed"."""
        if not self.making.done():
            return "making"
        return "ready" if self.making.exception() is None else "failed"

    def shown(self) -> answers.Export:
        """What the page shows of it."""
        error = str(self.making.exception()) if self.state == "failed" else None
        made = self.files.items() if self.state == "ready" else ()
        files = [answers.ExportFile(name=name, size=path.stat().st_size) for name, path in made]
        return answers.Export(state=self.state, began_ms=self.began_ms, error=error, files=files)


class Exports:
    """The exports of one server; the newest of each kind and study is kept."""

    def __init__(self, database: Path, jobs: Jobs, downloads: Downloads) -> None:
        self._database, self._jobs = database, jobs
        self._downloads = downloads
        self._made: dict[tuple[str, ExportKind], Export] = {}

    def state(self, study: str) -> answers.Exports:
        """The state of each kind of export; None for a kind that was never begun."""
        newest = {what: self._made.get((study, what)) for what in KINDS}
        return answers.Exports(**{what: one and one.shown() for what, one in newest.items()})

    def begin(self, study: str, what: ExportKind, authors: tuple[str, ...] = ()) -> None:
        """Begin an export; ExportError while the same is being made."""
        old = self._made.get((study, what))
        if old is not None and old.state == "making":
            raise ExportError(f"this {what} is being made already: wait until it is done")
        folder = self._downloads.new_folder()
        files, outputs = _written(folder, study, what, authors)
        words = (what, "--study", study, "--database", str(self._database), *outputs)
        making_of = (make_export, words, folder, what)
        try:
            making = self._jobs.submit(*making_of, owner=OWNER, limit_s=LIMIT_S)
        except JobsFullError as error:
            raise ExportError(str(error)) from error
        if old is not None:
            shutil.rmtree(old.folder, ignore_errors=True)
        self._made[study, what] = Export(folder, making, files)

    def file(self, study: str, name: str) -> Path | None:
        """Return the path of a finished file; None when there is none of this name."""
        for what in KINDS:
            export = self._made.get((study, what))
            if export is not None and export.state == "ready" and name in export.files:
                return export.files[name]
        return None


def make_export(words: Sequence[str], folder: Path, what: ExportKind) -> None:
    """Run the command that makes an export; ExportError with the last line that it wrote to stderr where it fails."""
    command = (sys.executable, "-m", "humanplay.cli", *words)
    done = subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"it ended with code {done.returncode}"]
        raise ExportError(lines[-1].removeprefix("humanplay: ")[:_MAX_ERROR_CHARS])
    if what == "release":
        try:
            shutil.make_archive(str(folder / "release"), "zip", folder / "release")
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise ExportError(f"cannot write the {what}: {reason}") from error


def _written(
    folder: Path, study: str, what: ExportKind, authors: tuple[str, ...]
) -> tuple[dict[str, Path], list[str]]:
    """Return the files of an export by the name they are downloaded under, and the options by which they are written."""
    if what == "report":
        stem = f"{study}-report"
        ends = (".html", "-methods.html", "-checklist.html", ".json")
        files = {f"{stem}{end}": folder / f"{stem}{end}" for end in ends}
        html, data = folder / f"{stem}.html", folder / f"{stem}.json"
        return files, ["--html", str(html), "--json", str(data)]
    named = (word for author in authors for word in ("--author", author))
    files = {f"{study}-release.zip": folder / "release.zip"}
    return files, ["--out", str(folder / "release"), *named]
