"""Finished episodes as CSV, one row an episode or one row a step, each episode replayed before it is written.

Columns are listed in `docs/data.md`. `verified` is false where the replay does not come to what is stored: such rows are
marked, never hidden. Players appear under pseudonyms drawn anew for every export; sessions do not appear.
"""

from __future__ import annotations

import csv
import hashlib
import hmac
import io
import secrets
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

from app.storage.reader import Reader, Who, cells_of, config_of, now_ms
from app.storage.resimulation import simulate
from marsexplorer.config import ACTIONS
from marsexplorer.episode import Episode
from marsexplorer.files import to_cell, write_whole
from marsexplorer.score import steps_to_target

ExportTable = Literal["episodes", "steps"]

EPISODE_COLUMNS = (
    "episode", "player", "driver", "assisted", "seed_chosen", "terrain_met_before", "counts",
    "level", "rows", "cols", "sensor_radius", "beta", "max_steps", "config_hash", "seed", "start_row", "start_col",
    "terrain", "policy_seed", "core_version", "started_ms", "ended_ms", "outcome", "steps", "discovered", "coverage",
    "return", "score", "steps_to_target", "actions", "trajectory_hash",
    "attestation", "attestation_reason", "daily", "verified",
)  # fmt: skip
STEP_COLUMNS = (
    "episode", "player", "step", "action", "row", "col", "discovered", "coverage", "reward",
    "server_ms", "client_ms", "key_down_ms", "key_up_ms", "input", "driver", "verified",
)  # fmt: skip
COLUMNS: dict[ExportTable, tuple[str, ...]] = {"episodes": EPISODE_COLUMNS, "steps": STEP_COLUMNS}


def new_key() -> bytes:
    """Return the key of one export's pseudonyms; give the same one to both tables so that they agree."""
    return secrets.token_bytes(32)


def export_table(
    source: Reader | Path | str,
    table: ExportTable,
    who: Who = "all",
    key: bytes | None = None,
    public: bool = False,
    at_ms: int | None = None,
) -> Iterator[bytes]:
    """Yield the table in pieces, the header first, one piece an episode.

    source   the database's path, or a Reader or Store on it; read over a read-only connection of its own
    who      "all", or "human" for the episodes that count
    public   True leaves out the episodes of studies that are not closed
    at_ms    when the export is made (None: now): daily terrains whose day is not over are left out
    """
    _check(table, who)
    at_ms = now_ms() if at_ms is None else at_ms
    reader = Reader.open(source.path if isinstance(source, Reader) else source, public, at_ms)
    return _stream(reader, lambda: reader.finished(who), table, key or new_key())


def export_own(database: Path, table: ExportTable, player: str) -> Iterator[bytes]:
    """Yield the table of what one player drove, their daily terrain of today among it; of studies the closed ones alone."""
    _check(table, "all")
    reader = Reader.open(database, public=True)
    return _stream(reader, lambda: reader.finished("all", player), table, new_key())


def write_table(path: Path, database: Path, table: ExportTable, who: Who, at_ms: int) -> None:
    """Write what `export_table` yields of what anybody may see."""
    with path.open("wb") as file:
        file.writelines(export_table(database, table, who, public=True, at_ms=at_ms))


def write_own_table(path: Path, database: Path, table: ExportTable, player: str) -> None:
    """Write what `export_own` yields."""
    with path.open("wb") as file:
        file.writelines(export_own(database, table, player))


def export_to(database: Path, folder: Path, who: Who, advance: Callable[[int, int], None]) -> str:
    """Write `episodes.csv` and `steps.csv` in the folder, both whole or neither, and return a sentence on what was written.

    advance  called with (episodes written, of how many), both tables counted
    """
    reader = Reader.open(database, at_ms=now_ms())
    total = 2 * reader.count(who)
    reader.close()
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{table}.csv" for table in COLUMNS]
    key, done, lines, unverified = new_key(), 0, [0, 0], 0
    with write_whole(paths[0]) as episodes, write_whole(paths[1]) as steps:
        for number, (table, file) in enumerate(zip(COLUMNS, (episodes, steps), strict=True)):
            for piece in export_table(database, table, who, key):
                file.write(piece)
                done += 1
                lines[number] += piece.count(b"\n")
                unverified += number == 0 and piece.endswith(b",false\n")
                advance(min(done, total), total)
    count, moves = (n - 1 for n in lines)
    warning = (
        f"; {unverified} of them did not replay as recorded: see the column verified"
        if unverified
        else ""
    )
    return f"{_counted(count, 'episode')} in {paths[0]}, {_counted(moves, 'step')} in {paths[1]}{warning}"


def _counted(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def _check(table: str, who: str) -> None:
    """Raise ValueError for what is no table or choice of episodes."""
    for name, value, known in (
        ("table", table, tuple(COLUMNS)),
        ("who", who, ("all", "human")),
    ):
        if value not in known:
            raise ValueError(f"{name} must be one of {', '.join(known)}, got {value!r}")


def _stream(
    reader: Reader,
    wanted: Callable[[], Iterator[dict[str, Any]]],
    table: ExportTable,
    key: bytes,
) -> Iterator[bytes]:
    try:
        yield (",".join(COLUMNS[table]) + "\n").encode()
        with reader.snapshot():
            for row in wanted():
                found = _rows_of(row, reader.steps(row["id"]), table, key)
                if found:
                    yield _encoded(found)
    finally:
        reader.close()


def _rows_of(
    row: dict[str, Any], steps: list[dict[str, Any]], table: ExportTable, key: bytes
) -> list[tuple[Any, ...]]:
    episode, findings = simulate(row, steps)
    verified = not findings
    common = (row["id"], _pseudonym(row["owner_id"], key))
    if table == "episodes":
        return [
            (
                *common,
                *_episode_values(row, steps),
                row["attestation"],
                row["attestation_reason"],
                row["daily"],
                verified,
            )
        ]
    path = [] if episode is None else episode.path
    return [(*common, *_step_values(step, episode, path), verified) for step in steps]


def _pseudonym(player_id: str | None, key: bytes) -> str | None:
    return (
        None
        if player_id is None
        else "P" + hmac.new(key, player_id.encode(), hashlib.sha256).hexdigest()[:10]
    )


def _episode_values(row: dict[str, Any], steps: list[dict[str, Any]]) -> tuple[Any, ...]:
    config = config_of(row)
    flags = (
        bool(row[name]) for name in ("assisted", "seed_chosen", "terrain_met_before", "counts")
    )
    shape = (
        config.level,
        config.rows,
        config.cols,
        config.sensor_radius,
        config.beta,
        config.max_steps,
    )
    cause = (
        row["config_hash"],
        row["seed"],
        row["start_row"],
        row["start_col"],
        row["terrain"].hex(),
    )
    times = (row["policy_seed"], row["core_version"], row["started_ms"], row["ended_ms"])
    totals = (
        row["outcome"],
        row["steps"],
        row["discovered"],
        row["discovered"] / cells_of(row),
        row["total"],
        row["score"],
    )
    to_target = steps_to_target(config, row["outcome"], row["steps"])
    actions = " ".join(ACTIONS[step["action"]] for step in steps)
    return (
        row["driver"],
        *flags,
        *shape,
        *cause,
        *times,
        *totals,
        to_target,
        actions,
        row["trajectory_hash"],
    )


def _step_values(
    step: dict[str, Any], episode: Episode | None, path: Sequence[tuple[int, int]]
) -> tuple[Any, ...]:
    here = step["step"] + 1
    position: Sequence[int | None] = path[here] if episode else (None, None)
    coverage = episode.discoveries[here] / episode.cells if episode else None
    seen = (step["discovered"], coverage, step["reward"], step["server_ms"])
    times = (
        step["client_ms"],
        step["key_down_ms"],
        step["key_up_ms"],
        step["input"],
        step["driver"],
    )
    return (step["step"], ACTIONS[step["action"]], *position, *seen, *times)


def _encoded(values: list[tuple[Any, ...]]) -> bytes:
    out = io.StringIO()
    words = {True: "true", False: "false"}
    plain = ([words[v] if isinstance(v, bool) else to_cell(v) for v in line] for line in values)
    csv.writer(out, lineterminator="\n").writerows(plain)
    return out.getvalue().encode()
