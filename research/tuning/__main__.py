"""`python -m research.tuning`: frontier-priced's parameters, by CMA-ES."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

import click

from humanplay.command.console import print_table, progress, reason
from humanplay.command.options import PATH
from humanplay.jobs import cores
from humanplay.tasks.mars.cli.options import levels_option, seed_option, sizes_option
from humanplay.tasks.mars.cli.train import configs_of
from marsexplorer.config import EnvConfig
from marsexplorer.files import write_whole
from marsexplorer.policies.priced import TUNED, SizedRule
from research.tuning.search import (
    CHECK_SEED,
    ENDS,
    Ratios,
    TuneConfig,
    TuneRun,
    ablations,
    compare_rules,
    make_episodes,
    read_rule,
)

HELD_OUT_SEED = 1_000_000_000
"""The first terrain of --ablate: evaluation's, which tuning never plays."""
CHECK_FACTOR = 5
"""So many times the terrains of a generation are played to compare a run's parameters with those
before it.
"""


@click.command(context_settings={"show_default": True})
@levels_option("random", "1-1-1", "1-2-1", "2-2-1", "3-2-1")
@sizes_option("21", "42", "84")
@click.option(
    "--tune",
    "end",
    type=click.Choice([*ENDS, "both", "all"]),
    default="both",
    help="The parameters for 21x21, for 42x42, for 84x84, both the first and the last, or all; between, they change gradually.",
)
@click.option("--generations", type=click.IntRange(min=1), default=40, help="Of CMA-ES.")
@click.option(
    "--terrains",
    type=click.IntRange(min=2),
    default=24,
    help="Of each level at 21x21; fewer on larger grids, in proportion to their cells.",
)
@seed_option("Of CMA-ES: the same one, the same run.")
@click.option(
    "--from",
    "start_file",
    type=PATH,
    help="A parameters.json of an earlier run.  [default: the shipped parameters]",
)
@click.option("--out", type=PATH, help="Folder of the run.  [default: runs/tuned]")
@click.option("--ablate", is_flag=True, help="Tune nothing: print what each term is good for.")
def tune(
    levels: tuple[str, ...],
    sizes: tuple[int | tuple[int, int], ...],
    end: str,
    generations: int,
    terrains: int,
    seed: int,
    start_file: Path | None,
    out: Path | None,
    ablate: bool,
) -> None:
    """Tune the policy `frontier-priced` by CMA-ES, or take its terms out one by one.

    The terms are measured on held-out terrains.

    A point is as good as its moves to 99 % divided by those of the first parameters on the same
    terrains, in the mean over levels and sizes. Every generation has new terrains, of seeds from
    3,000,000,000 on, which evaluation never uses. After each one --out gets the parameters
    (parameters.json, the mean of the search), so Ctrl-C loses only the generation under way. At the
    end both sets of parameters play further terrains. The default run takes about 15 minutes of one
    core; all cores are used.

    \b
    Examples:
      python -m research.tuning --tune small --size 21 --generations 20
      python -m research.tuning --level 1-2-1 --level 3-2-1 --out runs/large-obstacles
      python -m research.tuning --ablate --level random --terrains 400
    """

    configs = tuple(configs_of(levels, sizes))
    start = _read_rule(start_file) if start_file else TUNED
    if ablate:
        episodes = make_episodes(configs, terrains, HELD_OUT_SEED)
        with progress("playing") as advance, ThreadPoolExecutor(cores()) as pool:
            ratios = compare_rules(start, ablations(start), episodes, pool, advance)
        _print(f"those of the whole rule, from seed {HELD_OUT_SEED} on", ratios, configs)
        return
    ends = {"both": ("small", "large"), "all": ENDS}.get(end, (end,))
    run = TuneRun(TuneConfig(configs, terrains, ends, seed, start))
    path = (out or Path("runs") / "tuned") / "parameters.json"
    if path.exists():
        raise click.UsageError(f"{path.parent} holds a run already; give another --out")
    try:
        ratios = _tune(run, generations, path)
    except OSError as error:
        raise click.ClickException(
            f"cannot write to {path.parent}: {reason(error)}; choose another --out"
        ) from error
    except KeyboardInterrupt:
        left = "nothing is written before the first generation is done"
        if run.generations:
            left = f"{path} is as it was after generation {run.generations}"
        click.echo(f"stopped; {left}", err=True)
        raise
    _print(f"those before the run, from seed {CHECK_SEED} on", ratios, configs)
    click.echo(path)


def _tune(run: TuneRun, generations: int, path: Path) -> Ratios:
    """Write the parameters to a file after each generation; return their ratios."""
    before, total = run.config.start, generations * run.points
    with progress("tuning") as advance, ThreadPoolExecutor(cores()) as pool:
        while run.generations < generations:
            run.run_generation(
                pool, lambda points: advance(run.generations * run.points + points, total)
            )
            path.parent.mkdir(parents=True, exist_ok=True)
            with write_whole(path) as file:
                file.write((json.dumps(asdict(run.rule), indent=1) + "\n").encode())
        terrains = CHECK_FACTOR * run.config.terrains
        episodes = make_episodes(run.config.configs, terrains, CHECK_SEED)
        return compare_rules(before, {"after the run": run.rule}, episodes, pool, advance)


def _print(reference: str, ratios_by_rule: Ratios, configs: tuple[EnvConfig, ...]) -> None:
    """Print a table for each size: a row for each rule and a column for each level."""
    shapes = [(config.rows, config.cols) for config in configs]
    for shape in dict.fromkeys(shapes):
        places = [place for place, other in enumerate(shapes) if other == shape]
        rows = []
        for name, ratios in ratios_by_rule.items():
            cells = (ratios[place] for place in places)
            rows.append([name, *(f"{mean:.3f} ± {high - mean:.3f}" for mean, _, high in cells)])
        title = f"Moves to 99 %, divided by {reference}, {shape[0]}x{shape[1]}"
        print_table(title, ["", *(configs[place].level for place in places)], rows)


def _read_rule(path: Path) -> SizedRule:
    try:
        return read_rule(json.loads(path.read_text()))
    except OSError as error:
        wrong = f"cannot read {path}: {reason(error)}"
        cause: Exception = error
    except (ValueError, TypeError, KeyError) as error:
        wrong, cause = f"{path} holds no parameters of frontier-priced", error
    raise click.UsageError(f"{wrong}; give the parameters.json of a run") from cause


if __name__ == "__main__":
    tune(prog_name="python -m research.tuning")
