"""Reports and releases for the operator: each is the command, run as a job.

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
    """A report or release of a study.

    Attributes:
        making: Its job.
        files: Name of the download -> file.
    """

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
        written = self.files.items() if self.state == "ready" else ()
        files = [answers.ExportFile(name=name, size=path.stat().st_size) for name, path in written]
        return answers.Export(state=self.state, began_ms=self.began_ms, error=error, files=files)


class Exports:
    """The exports of one server; the newest of each kind and study is kept."""

    def __init__(self, database: Path, jobs: Jobs, downloads: Downloads) -> None:
        self._database, self._jobs = database, jobs
        self._downloads = downloads
        self._newest: dict[tuple[str, ExportKind], Export] = {}

    def state(self, study: str) -> answers.Exports:
        """The state of each kind of export; None for a kind that was never begun."""
        newest = {kind: self._newest.get((study, kind)) for kind in KINDS}
        return answers.Exports(
            **{kind: export and export.shown() for kind, export in newest.items()}
        )

    def begin(self, study: str, kind: ExportKind, authors: tuple[str, ...] = ()) -> None:
        """Begin an export; ExportError while the same is being made."""
        old = self._newest.get((study, kind))
        if old is not None and old.state == "making":
            raise ExportError(f"this {kind} is being made already: wait until it is done")
        folder = self._downloads.new_folder()
        files, options = _files_and_options(folder, study, kind, authors)
        words = (kind, "--study", study, "--database", str(self._database), *options)
        try:
            making = self._jobs.submit(
                make_export, words, folder, kind, owner=OWNER, limit_s=LIMIT_S
            )
        except JobsFullError as error:
            raise ExportError(str(error)) from error
        if old is not None:
            shutil.rmtree(old.folder, ignore_errors=True)
        self._newest[study, kind] = Export(folder, making, files)

    def file(self, study: str, name: str) -> Path | None:
        """The path of a finished file; None if there is none of this name."""
        for kind in KINDS:
            export = self._newest.get((study, kind))
            if export is not None and export.state == "ready" and name in export.files:
                return export.files[name]
        return None


def make_export(words: Sequence[str], folder: Path, kind: ExportKind) -> None:
    """Run the command that makes an export.

    Raises:
        ExportError: If it fails; the text is the last line of its stderr.
    """
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
    if kind == "release":
        try:
            shutil.make_archive(str(folder / "release"), "zip", folder / "release")
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise ExportError(f"cannot write the {kind}: {reason}") from error


def _files_and_options(
    folder: Path, study: str, kind: ExportKind, authors: tuple[str, ...]
) -> tuple[dict[str, Path], list[str]]:
    """The files of an export by their downloads' names, and the command's options."""
    if kind == "report":
        stem = f"{study}-report"
        ends = (".html", "-methods.html", "-checklist.html", ".json")
        files = {f"{stem}{end}": folder / f"{stem}{end}" for end in ends}
        html, data = folder / f"{stem}.html", folder / f"{stem}.json"
        return files, ["--html", str(html), "--json", str(data)]
    named = (word for author in authors for word in ("--author", author))
    files = {f"{study}-release.zip": folder / "release.zip"}
    return files, ["--out", str(folder / "release"), *named]
