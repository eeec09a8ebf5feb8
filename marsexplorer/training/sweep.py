"""Training runs over levels, sizes and seeds as trials of Ray Tune, each on one core and measured on held-out terrains."""

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
from marsexplorer.training.ppo import TrainingRun, UpdateMetrics, train
from marsexplorer.training.run_folder import RunFolder

REPORTS_PER_RUN = 20
"""Reports of a run to Ray Tune besides the last."""

NAN = float("nan")


@dataclass(frozen=True)
class SweepRun:
    """One training run: the options of `marsexplorer train`, and on how many terrains its policy is measured.

    name      of its folder and policy file
    recipe    a name in RECIPES
    config    the fields of its EnvConfig as a dictionary
    steps     moves to train for
    episodes  held-out terrains to measure on
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
class SweepResult:
    """The outcome of a run; error is empty when all went well, otherwise the figures are NaN.

    steps, completion, score  means on held-out terrains; rule_ratio: mean steps over those of the best frontier rule there
    policy                    the policy file
    """

    run: SweepRun
    steps: float
    completion: float
    score: float
    rule_ratio: float
    policy: Path | None
    error: str = ""


def sweep(
    runs: Sequence[SweepRun],
    out: Path,
    address: str = LOCAL,
    on_progress: Callable[[int, int], None] | None = None,
) -> list[SweepResult]:
    """Train on a Ray cluster and return the outcome of each run, in the order given.

    out          folder, on a file system that all machines of the cluster see: each run's folder (policy file, log, learning
                 curve) as out/NAME, Ray Tune's own records in out/ray
    on_progress  called with (runs ended, runs in all)

    ClusterError when Ray is missing or the cluster cannot be reached. A run that fails leaves the others running.
    """
    os.environ.setdefault("RAY_AIR_NEW_OUTPUT", "0")  # the older reporter can be silent
    with session(address):
        tune: Any = import_module("ray.tune")
        run_config = tune.RunConfig(
            name="ray",
            storage_path=str(out.resolve()),
            verbose=0,
            callbacks=_callbacks(tune, runs, on_progress),
        )
        space = {"run": tune.grid_search([asdict(run) for run in runs])}
        tune_config = tune.TuneConfig(
            trial_name_creator=_trial_name, trial_dirname_creator=_trial_name
        )
        trainable = tune.with_resources(train_one, {"cpu": 1})
        results = tune.Tuner(
            trainable, param_space=space, tune_config=tune_config, run_config=run_config
        ).fit()
        by_name = {results[i].config["run"]["name"]: results[i] for i in range(len(results))}
        return [_outcome(run, by_name[run.name], out) for run in runs]


def _trial_name(trial: Any) -> str:
    return str(trial.config["run"]["name"])


_listeners: list[Callable[[], None]] = []
"""What `_notify` calls in this process: Ray Tune pickles its callbacks, and a progress bar cannot be pickled."""


def _notify(callback: object, *args: Any, **kwargs: Any) -> None:
    for listener in _listeners:
        listener()


def _callbacks(
    tune: Any, runs: Sequence[SweepRun], on_progress: Callable[[int, int], None] | None
) -> list[Any]:
    """Return the callback that counts the trials that end, well or not."""
    ended = itertools.count(1)
    _listeners[:] = [lambda: on_progress(next(ended), len(runs))] if on_progress else []
    return [
        type("Count", (tune.Callback,), {"on_trial_complete": _notify, "on_trial_error": _notify})()
    ]


def train_one(params: dict[str, Any]) -> None:
    """Train, measure and report one run, on a machine of the cluster. params: {"run": the fields of a SweepRun}."""
    tune: Any = import_module("ray.tune")
    sweep_run = SweepRun(**params["run"])
    config = EnvConfig(**sweep_run.config)
    run = TrainingRun.begin(RECIPES[sweep_run.recipe], [config], sweep_run.steps, sweep_run.seed)
    interval = max(1, run.num_updates // REPORTS_PER_RUN)

    def on_update(metrics: UpdateMetrics, seconds: float) -> None:
        if run.updates_done % interval == 0 and run.updates_done < run.num_updates:
            means = {"episode_moves": metrics.episode_steps, "explored": metrics.explored}
            tune.report({"moves": metrics.global_step, "seconds": seconds, **means})

    with TemporaryDirectory() as temporary:
        folder = RunFolder(Path(temporary) / sweep_run.name, run, sweep_run.card, on_update)
        train(run, folder.on_update)
        folder.save()
        table = evaluate(
            [str(folder.policy), *RULES],
            config,
            sweep_run.episodes,
            EVALUATION_SEEDS.start,
            workers=1,
        )
        own, ratio = table.rows[0], table.compared(table.rows[0], "rule")
        assert ratio is not None
        figures = {
            "steps": own.steps_mean,
            "completion": own.completion,
            "score": own.score_mean,
            "rule_ratio": ratio.ratio_mean,
        }
        where = f"{config.level} {config.rows}x{config.cols}"
        terrains = {"terrains": sweep_run.episodes, "first_seed": EVALUATION_SEEDS.start}
        folder.save_policy(
            {"results": {where: {**terrains, **figures, "collisions": own.collisions}}}
        )
        last = {"moves": run.global_step, "seconds": folder.seconds, **figures}
        tune.report(last, checkpoint=tune.Checkpoint.from_directory(temporary))


def _outcome(run: SweepRun, result: Any, out: Path) -> SweepResult:
    """Return a run's figures, after copying its folder to out/NAME."""
    if (
        result.error is not None
        or result.checkpoint is None
        or "rule_ratio" not in (result.metrics or {})
    ):
        message = str(result.error).strip().splitlines()
        return SweepResult(
            run, NAN, NAN, NAN, NAN, None, message[-1] if message else "it ended without a result"
        )
    with result.checkpoint.as_directory() as folder:
        shutil.copytree(Path(folder) / run.name, out / run.name, dirs_exist_ok=True)
    figures, policy = result.metrics, out / run.name / f"{run.name}.safetensors"
    return SweepResult(
        run,
        figures["steps"],
        figures["completion"],
        figures["score"],
        figures["rule_ratio"],
        policy,
    )
