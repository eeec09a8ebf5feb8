"""The command `marsexplorer evaluate`: policies on the same terrains."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from itertools import chain
from pathlib import Path
from typing import IO, TYPE_CHECKING

import click
from click import ClickException, UsageError, argument, echo, option

from humanplay.command.console import print_table, progress, reason, written
from humanplay.command.options import PATH, check_more, path_option, several
from humanplay.tasks.mars.cli.options import env_config_of, levels_option, sizes_option

if TYPE_CHECKING:
    from marsexplorer.evaluation import EvaluationRow, EvaluationTable
    from marsexplorer.evaluation.episodes import Result
    from marsexplorer.evaluation.on_maps import MapResults
    from marsexplorer.maps import GridMap


FEW_EPISODES = 20
"""So many episodes are played sooner in this process than others start."""


@click.command(short_help="Score policies on the same terrains.")
@several("--policy", "policies", "A policy's name or file; repeatable.", required=True)
@levels_option("random")
@sizes_option("21")
@option("--episodes", type=click.IntRange(min=2), default=100, help="Terrains of a level and size.")
@option("--seed", type=click.IntRange(min=0), default=0, help="The first terrain's seed.")
@path_option("--json", "json_path", "Also write everything, every episode included, to this file.")
@path_option("--csv", "csv_path", "Also write the table to this file.")
@path_option("--plots", "Folder for coverage curves and heat maps; made when absent.")
@several("--map", "maps", "Play on this map_server file (YAML) instead; repeatable.", type=PATH)
@option(
    "--cell",
    "cell_m",
    type=float,
    help="Side of a map's cells in metres.  [default: the largest that fit]",
)
@option("--ray", metavar="ADDRESS", help="Play on a Ray cluster: HOST:PORT, auto, or local.")
@argument("more", nargs=-1, metavar="")
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
    """Play policies on the same terrains and print moves, coverage and score.

    The two frontier rules are always evaluated too. `to rule` is the ratio of the mean steps to those of the better rule.
    Episodes are played on all cores; the table is the same for any number of them. The score hardly differs between good
    policies: ten steps change it by 0.004. docs/evaluation.md defines every figure.

    With --map each policy plays one episode on each map, from the free cell nearest to the origin that leaves something to
    explore. What can be discovered from there counts, and there are no intervals.

    \b
    Examples:
      marsexplorer evaluate --policy random --policy ppo
      marsexplorer evaluate --policy mine.onnx --level all --json result.json --csv result.csv
      marsexplorer evaluate --policy ppo --size 21 --size 42x84 --episodes 50 --plots pictures
      marsexplorer evaluate --policy ppo --episodes 100000 --ray head:6379
      marsexplorer evaluate --policy ppo --map office.yaml --map garage.yaml
    """
    from humanplay.jobs import Jobs
    from humanplay.tasks.mars.cli.cluster import Cluster
    from marsexplorer.config import LEVELS
    from marsexplorer.evaluation import RULES
    from marsexplorer.evaluation import evaluate as evaluate_policies

    check_more(more, policies)
    names = list(dict.fromkeys((*policies, *more, *RULES)))
    if maps:
        if csv_path or plots or ray:
            raise UsageError("--map takes no --csv, --plots or --ray; leave them, or write --json")
        _evaluate_maps(names, maps, cell_m, json_path)
        return
    levels = tuple(chain.from_iterable(LEVELS if name == "all" else (name,) for name in levels))
    configs = [env_config_of(level, size) for level in dict.fromkeys(levels) for size in sizes]
    if plots is not None:  # whoever lacks its library learns so before any episode is played
        from marsexplorer.evaluation.plots import save_plots
    with ExitStack() as stack:  # the files too: what cannot be written is found before
        json_file, csv_file = (
            _open_output(stack, json_path, "--json"),
            _open_output(stack, csv_path, "--csv"),
        )
        if plots is not None:
            with written(f"to {plots}", "--plots"):
                plots.mkdir(parents=True, exist_ok=True)
        has_workers = hasattr(os, "fork")  # on Windows this process plays all of them
        is_long = len(names) * len(configs) * episodes > FEW_EPISODES and has_workers
        with _errors_of_playing(), ExitStack() as playing, progress("playing") as advance:
            executor: Executor | None = None
            if ray or is_long:
                executor = playing.enter_context(Cluster(ray) if ray else Jobs())
            table = evaluate_policies(
                names, configs, episodes, seed, advance, traces=plots is not None, executor=executor
            )
        if json_file is not None:
            json_file.write(table.to_json().encode() + b"\n")
        if csv_file is not None:
            csv_file.write(table.to_csv().encode())
        if plots is not None:
            with written(f"to {plots}", "--plots"):
                for path in save_plots(table, plots):
                    echo(path)
    _print(table)


def _open_output(stack: ExitStack, path: Path | None, option: str) -> IO[bytes] | None:
    """Return a file that appears if the stack is left without error; None for no path."""
    from marsexplorer.files import write_whole

    with written(path or "", option):
        return stack.enter_context(write_whole(path)) if path else None


@contextmanager
def _errors_of_playing() -> Iterator[None]:
    """Turn faults of policies, terrains, workers and clusters into a sentence."""
    from humanplay.jobs import JobError
    from humanplay.tasks.mars.cli.cluster import ClusterError
    from marsexplorer.policies import PolicyNotFoundError

    try:
        yield
    except (ClusterError, JobError) as error:
        raise ClickException(str(error)) from error
    except (PolicyNotFoundError, ValueError) as error:
        raise UsageError(str(error)) from error
    except OSError as error:
        raise ClickException(f"cannot read {error.filename}: {reason(error)}") from error


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
    comparison = table.compared(row)
    half = comparison.ratio_high - comparison.ratio_mean if comparison else 0.0
    cells.append(f"{comparison.ratio_mean:.3f} ± {half:.3f}" if comparison else "1")
    score = f"{row.score_mean:.4f} ± {row.score_high - row.score_mean:.4f}"
    return [*cells, f"{row.auc_mean:.4f}", score, str(row.collisions)]


def _evaluate_maps(
    names: Sequence[str], paths: Sequence[Path], cell_m: float | None, json_path: Path | None
) -> None:
    """Play policies on map files, print a table, and write all figures if asked to."""
    from marsexplorer.evaluation.on_maps import evaluate_on_maps, to_json

    maps = _read_maps(paths, cell_m)
    with ExitStack() as stack:
        file = _open_output(stack, json_path, "--json")
        with _errors_of_playing():
            maps_results = evaluate_on_maps(names, maps)
        if file is not None:
            file.write(to_json(maps_results).encode() + b"\n")
    columns = ["map", "size", "cells", "policy", "outcome", "steps to 99 %", "to rule"]
    columns += ["AUC", "score"]
    rows = [
        _map_cells(map_results, result)
        for map_results in maps_results
        for result in map_results.results
    ]
    title = "one episode each; cells are those that can be discovered from the start"
    print_table(title, columns, rows)


def _read_maps(paths: Sequence[Path], cell_m: float | None) -> dict[str, GridMap]:
    """Return the maps by the names of their files."""
    from humanplay.tasks.mars.terrains import open_map
    from marsexplorer.maps import MapFileError

    maps: dict[str, GridMap] = {}
    for path in paths:
        if path.stem in maps:
            raise UsageError(f"--map names two files {path.stem!r}; rename one, or give it once")
        try:
            maps[path.stem] = open_map(path, cell_m)
        except MapFileError as error:
            raise UsageError(str(error)) from error
        except ModuleNotFoundError as error:
            raise ClickException(
                "maps are read with the extra [play]: pip install 'humanplay[play]'"
            ) from error
    return maps


def _map_cells(map_results: MapResults, result: Result) -> list[str]:
    share, size = map_results.to_rule(result), f"{result.rows}x{result.cols}"
    cells = [map_results.name, size, str(result.cells), result.policy, result.outcome]
    to_rule = "" if share is None else f"{share:.3f}"
    return [*cells, str(result.steps_to_99), to_rule, f"{result.auc:.4f}", f"{result.score:.4f}"]
