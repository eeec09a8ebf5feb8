"""Finished trials as small JSON Lines, which are shipped, and from which figures and tables are drawn again.

A file has lines of two kinds:

    settings  "id"; "settings" and "versions" as they were logged, once for all trials that share them
    trial     "trial" (the fields of the Trial), "settings" (an id), "curve" (columns of at most POINTS points), "result"
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from marsexplorer.files import write_whole
from marsexplorer.paper.figures.curves import TITLES, Record
from marsexplorer.paper.trial import Trial


def write_records(records: Sequence[Record], path: Path) -> Path:
    """Write records to a file, the settings before the first trial that has them; return its path."""
    lines: list[dict[str, Any]] = []
    known: dict[str, int] = {}
    for record in records:
        common = {"settings": record.settings, "versions": record.versions}
        key = json.dumps(common, sort_keys=True)
        if key not in known:
            known[key] = len(known)
            lines.append({"kind": "settings", "id": known[key], **common})
        own = {
            "trial": vars(record.trial),
            "settings": known[key],
            "curve": record.curve,
            "result": record.result,
        }
        lines.append({"kind": "trial", **own})
    path.parent.mkdir(parents=True, exist_ok=True)
    with write_whole(path) as file:
        file.write(
            "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines).encode()
        )
    return path


def add_records(records: Sequence[Record], path: Path) -> Path:
    """Write records to a file beside those that it has; return its path.

    A kind of trial is an algorithm, variant, level and size. All trials of a kind in the file make way for new ones of that
    kind, so that no mean is taken over trainings of two runs. ValueError when the file was not written by `write_records`.
    """
    new = {_kind_of(record.trial) for record in records}
    old = read_exported(path) if path.is_file() else []
    kept = [record for record in old if _kind_of(record.trial) not in new]
    return write_records(
        sorted([*kept, *records], key=lambda record: (_place_of(record.trial), record.trial.seed)),
        path,
    )


def _kind_of(trial: Trial) -> tuple[str, str, str, int]:
    return trial.variant, trial.algorithm, trial.level, trial.size


def _place_of(trial: Trial) -> tuple[int, tuple[str, str, str, int]]:
    """Return what kinds are sorted by: the columns of figure 4 first, in their order, then the others by name."""
    columns = list(TITLES)
    return columns.index(trial.variant) if trial.variant in columns else len(columns), _kind_of(
        trial
    )


def read_exported(path: Path) -> list[Record]:
    """Return the records of a file that `write_records` wrote; ValueError when it is none."""
    records, settings = [], {}
    try:
        for text in path.read_text().splitlines():
            line = json.loads(text)
            if line["kind"] == "settings":
                settings[line["id"]] = line
            else:
                common = settings[line["settings"]]
                trial = Trial(**line["trial"])
                records.append(
                    Record(
                        trial, common["settings"], common["versions"], line["curve"], line["result"]
                    )
                )
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is no file of trials that --export wrote") from error
    return records
