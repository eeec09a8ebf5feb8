"""The command `marsexplorer evaluate`: score policies on the same terrains, as tables, files and plots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING

import click

from app.cli.console import (
    PATH,
    check_more,
    env_config_of,
    levels_option,
    print_table,
    progress,
    reason,
    sizes_option,
)

if TYPE_CHECKING:
    from marsexplorer.config import EnvConfig
    from marsexplorer.evaluation import EvaluationRow, EvaluationTable
    from marsexplorer.evaluation.episodes import Result
    from marsexplorer.evaluation.on_maps import MapResults
    from marsexplorer.maps import GridMap


FEW_EPISODES = 20
"""So many episodes are played sooner in this process than others start."""


@dataclass(frozen=True)
class EvaluationRequest:
    """What to play: the arguments of `marsexplorer.evaluation.evaluate`."""

    names: tuple[str, ...]
    configs: tuple[EnvConfig, ...]
    episodes: int
    seed: int
    traces: bool
    ray: str | None


@click.command(short_help="Score policies on the same terrains.")
@click.option(
    "--policy",
    "policies",
    multiple=True,
    required=True,
    help="A policy's name or file; repeatable.",
)
@levels_option("random")
@sizes_option("21")
@click.option(
    "--episodes",
    type=click.IntRange(min=2),
    default=100,
    show_default=True,
    help="Terrains of each level and size.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="The first terrain's seed.",
)
@click.option(
    "--json",
    "json_path",
    type=PATH,
    help="Also write everything, every episode included, to this file.",
)
@click.option("--csv", "csv_path", type=PATH, help="Also write the table to this file.")
@click.option(
    "--plots", type=PATH, help="Folder for coverage curves and heat maps (PNG); made when absent."
)
@click.option(
    "--map",
    "maps",
    type=PATH,
    multiple=True,
    help="Play on this map_server file (YAML) instead; repeatable.",
)
@click.option(
    "--cell", "cell_m", type=float, help="Side of a map's cells in metres.  [default: 0.5]"
)
@click.option("--ray", metavar="ADDRESS", help="Play on a Ray cluster: HOST:PORT, auto, or local.")
@click.argument("more", nargs=-1, metavar="")
def evaluate(
    policies: tuple[str, ...],
    more: tuple[str, ...],
    levels: tuple[str, ...],
    sizes: tuple[int | tuple[int, int], ...],
    episodes: int,
    seed: int,
    json_path: Path | None,
    csv_path: Path | None,
    plots: Path | None,
    maps: tuple[Path, ...],
    cell_m: float | None,
    ray: str | None,
) -> None:
    """Play policies on the same terrains and print steps to 99 %, completion, coverage and score.

    The two frontier rules are always evaluated too. `to rule` is the ratio of the mean steps to those of the better rule.
    Episodes are played on all cores; the table is the same for any number of them. The score hardly differs between good
    policies: ten steps change it by 0.004. docs/evaluation.md defines every figure.

    With --map each policy plays one episode on each map, from the free cell nearest to the origin. What can be discovered from
    there counts, and there are no intervals.

    \b
    Examples:
      marsexplorer evaluate --policy random --policy ppo
      marsexplorer evaluate --policy mine.onnx --level all --json result.json --csv result.csv
      marsexplorer evaluate --policy ppo --size 21 --size 42x84 --episodes 50 --plots pictures
      marsexplorer evaluate --policy ppo --episodes 100000 --ray head:6379
      marsexplorer evaluate --policy ppo --map office.yaml --map garage.yaml
    """
    from marsexplorer.evaluation import RULES

    check_more(more, policies)
    names = dict.fromkeys((*policies, *more, *RULES))
    if maps:
        if csv_path or plots or ray:
            raise click.UsageError(
                "--map takes no --csv, --plots or --ray; leave them out, or write --json"
            )
        _evaluate_maps(list(names), maps, cell_m, json_path)
        return
    configs = tuple(env_config_of(level, size) for level in _levels(levels) for size in sizes)
    if plots is not None:
        import marsexplorer.evaluation.plots  # noqa: F401 - whoever lacks its library learns so before any episode is played
    request = EvaluationRequest(tuple(names), configs, episodes, seed, plots is not None, ray)
    with _open_outputs(json_path, csv_path, plots) as files:
        table = _evaluate(request)
        for file, text in zip(files, (table.to_json() + "\n", table.to_csv()), strict=True):
            if file is not None:
                file.write(text.encode())
        if plots is not None:
            _save_plots(table, plots)
    _print(table)


def _levels(given: Sequence[str]) -> list[str]:
    from marsexplorer.config import LEVELS

    return list(
        dict.fromkeys(name for level in given for name in (LEVELS if level == "all" else (level,)))
    )


@contextmanager
def _open_outputs(
    json_path: Path | None, csv_path: Path | None, plots: Path | None
) -> Iterator[list[IO[bytes] | None]]:
    """Yield the JSON and CSV files, None for one not asked for; they appear when the block ends without an error.

    The files are opened before playing, so that a path that cannot be written is found before anything is played.
    """
    from marsexplorer.files import write_whole

    files: list[IO[bytes] | None] = []
    with ExitStack() as stack:
        for option, path in (("--json", json_path), ("--csv", csv_path)):
            try:
                files.append(stack.enter_context(write_whole(path)) if path else None)
            except OSError as error:
                raise click.ClickException(
                    f"cannot write {path}: {reason(error)}; choose another {option}"
                ) from error
        try:
            if plots is not None:
                plots.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise click.ClickException(
                f"cannot write to {plots}: {reason(error)}; choose another --plots"
            ) from error
        yield files


def _evaluate(request: EvaluationRequest) -> EvaluationTable:
    from app.jobs import ClusterError, JobError, Jobs
    from marsexplorer.evaluation import evaluate as evaluate_policies
    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError

    episodes = len(request.names) * len(request.configs) * request.episodes
    try:
        with Jobs(ray=request.ray) as jobs, progress("playing") as advance:
            return evaluate_policies(
                request.names,
                request.configs,
                request.episodes,
                request.seed,
                advance,
                traces=request.traces,
                executor=jobs if request.ray or episodes > FEW_EPISODES else None,
            )
    except (ClusterError, JobError) as error:
        raise click.ClickException(str(error)) from error
    except (PolicyNotFoundError, PolicyFileError, ValueError) as error:
        raise click.UsageError(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"cannot read {error.filename}: {reason(error)}") from error


def _save_plots(table: EvaluationTable, folder: Path) -> None:
    from marsexplorer.evaluation.plots import save_plots

    try:
        for path in save_plots(table, folder):
            click.echo(path)
    except OSError as error:
        raise click.ClickException(
            f"cannot write to {folder}: {reason(error)}; choose another --plots"
        ) from error


def _print(table: EvaluationTable) -> None:
    """Print a row for each policy, level and size."""
    first, last = table.seeds[0], table.seeds[-1]
    title = f"{len(table.seeds)} terrains each, seeds {first} to {last}, the same for all; ± half of the 95 % interval"
    columns = ["policy", "level", "size", "completion", "steps to 99 %", "to rule"]
    columns += ["AUC", "mean score", "collisions"]
    print_table(title, columns, [_cells(table, row) for row in table.rows])


def _cells(table: EvaluationTable, row: EvaluationRow) -> list[str]:
    cells = [row.policy, row.level, f"{row.rows}x{row.cols}", f"{row.completion:.1%}"]
    cells.append(f"{row.steps_mean:.1f} ± {row.steps_high - row.steps_mean:.1f}")
    found = table.compared(row)
    cells.append(
        f"{found.ratio_mean:.3f} ± {found.ratio_high - found.ratio_mean:.3f}" if found else "1"
    )
    return [
        *cells,
        f"{row.auc_mean:.4f}",
        f"{row.score_mean:.4f} ± {row.score_high - row.score_mean:.4f}",
        str(row.collisions),
    ]


def _evaluate_maps(
    names: Sequence[str], paths: Sequence[Path], cell_m: float | None, json_path: Path | None
) -> None:
    """Play policies on map_server files, print a row for each map and policy, and write all figures where asked to."""
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
    columns += ["AUC", "score"]
    rows = [_map_cells(each, result) for each in found for result in each.results]
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


def _map_cells(found: MapResults, result: Result) -> list[str]:
    share = found.to_rule(result)
    return [
        found.name,
        f"{result.rows}x{result.cols}",
        str(result.cells),
        result.policy,
        result.outcome,
        str(result.steps_to_99),
        "" if share is None else f"{share:.3f}",
        f"{result.auc:.4f}",
        f"{result.score:.4f}",
    ]
