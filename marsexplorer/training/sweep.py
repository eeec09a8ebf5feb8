"""Trainings over levels, sizes and seeds as trials of Ray Tune, each on one core and measured on held-out terrains."""

from __future__ import annotations

import itertools
import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import RULES, evaluate
from marsexplorer.evaluation.cluster import LOCAL, session
from marsexplorer.training.config import RECIPES
from marsexplorer.training.envs import EVALUATION_SEEDS
from marsexplorer.training.ppo import Report, Run, train
from marsexplorer.training.run_folder import Logbook

TOLD = 20
"""Reports of a trial to Ray Tune besides the last."""

NAN = float("nan")


@dataclass(frozen=True)
class Trial:
    """One training: what `marsexplorer train` is told, and on how many terrains its policy is measured.

    config    as a dictionary of EnvConfig's fields
    card      what the policy's card says besides numbers
    """

    name: str
    recipe: str
    config: dict[str, Any]
    steps: int
    seed: int
    episodes: int
    card: dict[str, Any]


@dataclass(frozen=True)
class Finished:
    """What became of a trial; error is empty when all went well, else the figures are NaN.

    steps, completion, score  means on held-out terrains; rule_ratio: mean steps over those of the best frontier rule there
    policy                    the policy file
    """

    trial: Trial
    steps: float
    completion: float
    score: float
    rule_ratio: float
    policy: Path | None
    error: str = ""


def sweep(
    trials: Sequence[Trial], out: Path, address: str = LOCAL, tell: Callable[[int, int], None] | None = None
) -> list[Finished]:
    """Run the trials on a Ray cluster and return what became of each, in the order given.

    out   folder, on a file system that all machines of the cluster see: each trial's folder (policy file, log, learning
          curve) as out/NAME, Ray Tune's own records in out/ray
    tell  called with (trials ended, trials in all)

    ClusterError when Ray is missing or the cluster cannot be reached. A trial that fails leaves the others running.
    """
    os.environ.setdefault("RAY_AIR_NEW_OUTPUT", "0")  # the older reporter can be silent
    with session(address):
        tune: Any = import_module("ray.tune")
        records = tune.RunConfig(
            name="ray", storage_path=str(out.resolve()), verbose=0, callbacks=_callbacks(tune, trials, tell)
        )
        space = {"trial": tune.grid_search([asdict(trial) for trial in trials])}
        names = tune.TuneConfig(trial_name_creator=_name, trial_dirname_creator=_name)
        work = tune.with_resources(train_one, {"cpu": 1})
        results = tune.Tuner(work, param_space=space, tune_config=names, run_config=records).fit()
        by_name = {results[at].config["trial"]["name"]: results[at] for at in range(len(results))}
        return [_finished(trial, by_name[trial.name], out) for trial in trials]


def _name(trial: Any) -> str:
    return str(trial.config["trial"]["name"])


_listener: list[Callable[[], None]] = []
"""Whom `_count` tells in this process: Ray Tune pickles its callbacks, and a progress bar is nothing to pickle."""


def _count(callback: object, *args: Any, **kwargs: Any) -> None:
    for tell in _listener:
        tell()


def _callbacks(tune: Any, trials: Sequence[Trial], tell: Callable[[int, int], None] | None) -> list[Any]:
    """Return what counts the trials that end, well or not."""
    ended = itertools.count(1)
    _listener[:] = [lambda: tell(next(ended), len(trials))] if tell else []
    return [type("Count", (tune.Callback,), {"on_trial_complete": _count, "on_trial_error": _count})()]


def train_one(params: dict[str, Any]) -> None:
    """Train, measure and report one trial, on a machine of the cluster. params: {"trial": a Trial's fields}."""
    tune: Any = import_module("ray.tune")
    trial = Trial(**params["trial"])
    config = EnvConfig(**trial.config)
    run = Run.begin(RECIPES[trial.recipe], [config], trial.steps, trial.seed)
    every = max(1, run.updates // TOLD)

    def tell(report: Report, seconds: float) -> None:
        if run.done % every == 0 and run.done < run.updates:
            tune.report({"moves": report.moves, "seconds": seconds, "episode_moves": report.steps, "explored": report.explored})

    with TemporaryDirectory() as folder:
        book = Logbook(Path(folder) / trial.name, run, trial.card, tell)
        train(run, book.heard)
        book.keep()
        table = evaluate([str(book.policy), *RULES], config, trial.episodes, EVALUATION_SEEDS.start, workers=1)
        own, ratio = table.rows[0], table.compared(table.rows[0], "rule")
        assert ratio is not None
        figures = {
            "steps": own.steps_mean,
            "completion": own.completion,
            "score": own.score_mean,
            "rule_ratio": ratio.ratio_mean,
        }
        where = f"{config.level} {config.rows}x{config.cols}"
        numbers = {"terrains": trial.episodes, "first_seed": EVALUATION_SEEDS.start, **figures, "collisions": own.collisions}
        book.keep_policy({"results": {where: numbers}})
        tune.report({"moves": run.moves, "seconds": book.seconds, **figures}, checkpoint=tune.Checkpoint.from_directory(folder))


def _finished(trial: Trial, result: Any, out: Path) -> Finished:
    """Return a trial's figures, its folder copied to where people look."""
    if result.error is not None or result.checkpoint is None or "rule_ratio" not in (result.metrics or {}):
        said = str(result.error).strip().splitlines()
        return Finished(trial, NAN, NAN, NAN, NAN, None, said[-1] if said else "it ended without a result")
    with result.checkpoint.as_directory() as folder:
        shutil.copytree(Path(folder) / trial.name, out / trial.name, dirs_exist_ok=True)
    seen, policy = result.metrics, out / trial.name / f"{trial.name}.safetensors"
    return Finished(trial, seen["steps"], seen["completion"], seen["score"], seen["rule_ratio"], policy)
