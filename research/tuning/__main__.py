"""The command `python -m research.tuning`: the parameters of frontier-priced by CMA-ES, and what each of its terms is good
for.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

import click

from app.cli.console import (
    PATH,
    configs_of,
    levels_option,
    print_table,
    progress,
    reason,
    seed_option,
    sizes_option,
)
from app.jobs import cores
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
"""So many times the terrains of a generation are played to compare a run's parameters with those before it."""


@click.command()
@levels_option("random", "1-1-1", "1-2-1", "2-2-1", "3-2-1")
@sizes_option("21", "42", "84")
@click.option(
    "--tune",
    "end",
    type=click.Choice(["small", "middle", "large", "both", "all"]),
    default="both",
    show_default=True,
    help="The parameters for 21x21, for 42x42, for 84x84, both the first and the last, or all; between, they change gradually.",
)
@click.option(
    "--generations",
    type=click.IntRange(min=1),
    default=40,
    show_default=True,
    help="Generations of CMA-ES.",
)
@click.option(
    "--terrains",
    type=click.IntRange(min=2),
    default=24,
    show_default=True,
    help="Of each level at 21x21; fewer on larger grids, in proportion to their cells.",
)
@seed_option("Of CMA-ES: the same one, the same run.")
@click.option(
    "--from",
    "given",
    type=PATH,
    help="A parameters.json of an earlier run.  [default: the shipped parameters]",
)
@click.option("--out", type=PATH, help="Folder of the run.  [default: runs/tuned]")
@click.option(
    "--ablate",
    is_flag=True,
    help="Tune nothing: print what each term is good for, on held-out terrains.",
)
def tune(
    levels: tuple[str, ...],
    sizes: tuple[int | tuple[int, int], ...],
    end: str,
    generations: int,
    terrains: int,
    seed: int,
    given: Path | None,
    out: Path | None,
    ablate: bool,
) -> None:
    """Tune the parameters of the policy `frontier-priced` by CMA-ES, or take its terms out one by one (--ablate).

    A point is as good as its moves to 99 % divided by those of the first parameters on the same terrains, in the mean over
    levels and sizes. Every generation has new terrains, of seeds from 3,000,000,000 on, which evaluation never uses. After each
    one --out gets the parameters (parameters.json, the mean of the search), so Ctrl-C loses only the generation under way. At
    the end both sets of parameters play further terrains. The default run takes about 15 minutes of one core; all cores are
    used.

    \b
    Examples:
      python -m research.tuning --tune small --size 21 --generations 20
      python -m research.tuning --level 1-2-1 --level 3-2-1 --out runs/large-obstacles
      python -m research.tuning --ablate --level random --terrains 400
    """

    configs = tuple(configs_of(levels, sizes))
    start = _read_rule(given) if given else TUNED
    if ablate:
        _ablate(start, configs, terrains)
        return
    config = TuneConfig(
        configs, terrains, {"both": ("small", "large"), "all": ENDS}.get(end, (end,)), seed, start
    )
    folder = out or Path("runs") / "tuned"
    if (folder / "parameters.json").exists():
        raise click.UsageError(f"{folder} holds a run already; give another --out")
    run = TuneRun(config)
    try:
        _tune(run, generations, folder)
    except KeyboardInterrupt:
        left = (
            f"{folder / 'parameters.json'} is as it was after generation {run.generations}"
            if run.generations
            else "nothing is written before the first generation is done"
        )
        click.echo(f"stopped; {left}", err=True)
        raise


def _tune(run: TuneRun, generations: int, folder: Path) -> None:

    def work(advance: Callable[[int, int], None]) -> Ratios:
        with ThreadPoolExecutor(cores()) as pool:
            while run.generations < generations:
                run.run_generation(
                    pool,
                    lambda done: advance(
                        run.generations * run.points + done, generations * run.points
                    ),
                )
                folder.mkdir(parents=True, exist_ok=True)
                with write_whole(folder / "parameters.json") as file:
                    file.write((json.dumps(asdict(run.rule), indent=1) + "\n").encode())
            episodes = make_episodes(
                run.config.configs, CHECK_FACTOR * run.config.terrains, CHECK_SEED
            )
            return compare_rules(
                run.config.start, {"after the run": run.rule}, episodes, pool, advance
            )

    try:
        with progress("tuning") as advance:
            found = work(advance)
    except OSError as error:
        raise click.ClickException(
            f"cannot write to {folder}: {reason(error)}; choose another --out"
        ) from error
    _print(
        f"Moves to 99 %, divided by those before the run, from seed {CHECK_SEED} on",
        found,
        run.config.configs,
    )
    click.echo(folder / "parameters.json")


def _ablate(rule: SizedRule, configs: tuple[EnvConfig, ...], terrains: int) -> None:

    def work(advance: Callable[[int, int], None]) -> Ratios:
        with ThreadPoolExecutor(cores()) as pool:
            return compare_rules(
                rule,
                ablations(rule),
                make_episodes(configs, terrains, HELD_OUT_SEED),
                pool,
                advance,
            )

    with progress("playing") as advance:
        found = work(advance)
    _print(
        f"Moves to 99 %, divided by those of the whole rule, from seed {HELD_OUT_SEED} on",
        found,
        configs,
    )


def _print(title: str, found: Ratios, configs: tuple[EnvConfig, ...]) -> None:
    """Print a table for each size: a row for each rule and a column for each level."""
    for size in dict.fromkeys((config.rows, config.cols) for config in configs):
        places = [
            place for place, config in enumerate(configs) if (config.rows, config.cols) == size
        ]
        rows = []
        for name, ratios in found.items():
            cells = (ratios[place] for place in places)
            rows.append([name, *(f"{mean:.3f} ± {high - mean:.3f}" for mean, _, high in cells)])
        print_table(
            f"{title}, {size[0]}x{size[1]}", ["", *(configs[place].level for place in places)], rows
        )


def _read_rule(path: Path) -> SizedRule:

    try:
        return read_rule(json.loads(path.read_text()))
    except OSError as error:
        raise click.UsageError(
            f"cannot read {path}: {reason(error)}; give the parameters.json of a run"
        ) from error
    except (ValueError, TypeError, KeyError) as error:
        raise click.UsageError(
            f"{path} holds no parameters of frontier-priced; give the parameters.json of a run"
        ) from error


if __name__ == "__main__":
    tune()
