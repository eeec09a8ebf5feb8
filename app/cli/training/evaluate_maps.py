"""`marsexplorer evaluate --map`: policies on occupancy maps of robots."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import print_table, reason

if TYPE_CHECKING:
    from marsexplorer.evaluation.episodes import Result
    from marsexplorer.evaluation.on_maps import MapResults
    from marsexplorer.maps import GridMap


def evaluate_maps(
    names: Sequence[str], paths: Sequence[Path], cell_m: float | None, json_path: Path | None
) -> None:
    """Play policies on map_server files, print a row for each map and policy, and write all figures where asked to."""
    from marsexplorer.evaluation import INFORMED
    from marsexplorer.evaluation.on_maps import evaluate_on_maps, to_json
    from marsexplorer.files import write_whole
    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError

    maps = _read_maps(paths, cell_m)
    with ExitStack() as stack:
        try:
            file = stack.enter_context(write_whole(json_path)) if json_path else None
        except OSError as error:
            raise click.ClickException(
                f"cannot write {json_path}: {reason(error)}; choose another --json"
            ) from error
        try:
            found = evaluate_on_maps(names, maps)
        except (PolicyNotFoundError, PolicyFileError, ValueError) as error:
            raise click.UsageError(str(error)) from error
        if file is not None:
            file.write(to_json(found).encode() + b"\n")
    columns = ["map", "size", "cells", "policy", "outcome", "steps to 99 %", "to rule"]
    columns += [*(["to informed"] if INFORMED in names else []), "AUC", "score"]
    rows = [_cells(each, result, INFORMED in names) for each in found for result in each.results]
    print_table(
        "one episode each; cells are those that can be discovered from the start", columns, rows
    )


def _read_maps(paths: Sequence[Path], cell_m: float | None) -> dict[str, GridMap]:
    """Return the maps by the names of their files."""
    from marsexplorer.maps import CELL_M, MapFileError, read_map

    maps: dict[str, GridMap] = {}
    for path in paths:
        if path.stem in maps:
            raise click.UsageError(
                f"--map names two files called {path.stem!r}; rename one, or give each once"
            )
        try:
            maps[path.stem] = read_map(path, CELL_M if cell_m is None else cell_m)
        except MapFileError as error:
            raise click.UsageError(str(error)) from error
        except ModuleNotFoundError as error:
            raise click.ClickException(
                "maps are read with the extra maps: pip install 'marsexplorer-playground[maps]'"
            ) from error
    return maps


def _cells(found: MapResults, result: Result, with_informed: bool) -> list[str]:
    shares = [found.to_rule(result), *([found.to_informed(result)] if with_informed else [])]
    return [
        found.name,
        f"{result.rows}x{result.cols}",
        str(result.cells),
        result.policy,
        result.outcome,
        str(result.steps_to_99),
        *("" if share is None else f"{share:.3f}" for share in shares),
        f"{result.auc:.4f}",
        f"{result.score:.4f}",
    ]
