"""The table of an evaluation: a row a policy and configuration, and comparisons.

All intervals are 95 % Student's t intervals over terrains. docs/evaluation.md defines every
measure.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass

import numpy as np

from marsexplorer import policies as policy_files
from marsexplorer.config import CORE_VERSION, EnvConfig, check_seed
from marsexplorer.evaluation.episodes import Result, horizon, make_chunks, play_chunks
from marsexplorer.files import to_cell
from marsexplorer.intervals import Floats, t_interval, t_quantile

Progress = Callable[[int, int], None]
"""Called with (done, in all)."""

COMPARED = ("reference", "difference_", "ratio_")
"""The beginnings of the names of a comparison's own columns."""
RULES = ("frontier-cost", "frontier-utility")
"""The rule policies; the one of the fewest mean steps is the reference of the comparisons."""


@dataclass(frozen=True)
class EvaluationRow:
    """One policy over all terrains of one configuration.

    *_low and *_high bound the mean.

    completion  share of episodes explored, 0..1
    steps_*     moves to 99 %, an unfinished episode counting `max_steps`
    collisions  episodes that ended in an obstacle or off the grid
    auc_mean    area under the coverage curve, 0..1
    """

    policy: str
    level: str
    rows: int
    cols: int
    config_hash: str
    episodes: int
    score_mean: float
    score_low: float
    score_high: float
    completion: float
    steps_mean: float
    steps_low: float
    steps_high: float
    collisions: int
    coverage_mean: float
    auc_mean: float
    auc_low: float
    auc_high: float


@dataclass(frozen=True)
class Comparison:
    """Steps to 99 % of a policy and of a reference, paired by terrain.

    reference     the frontier rule of fewest mean steps among those played
    difference_*  mean of policy - reference (moves), with its interval
    ratio_*       mean steps of the policy over mean steps of the reference, with its interval
    """

    policy: str
    reference: str
    level: str
    rows: int
    cols: int
    config_hash: str
    episodes: int
    difference_mean: float
    difference_low: float
    difference_high: float
    ratio_mean: float
    ratio_low: float
    ratio_high: float


@dataclass(frozen=True)
class EvaluationTable:
    """The result of `evaluate`: its rows in the order given, and every episode."""

    configs: tuple[EnvConfig, ...]
    seeds: tuple[int, ...]
    rows: tuple[EvaluationRow, ...]
    comparisons: tuple[Comparison, ...]
    results: tuple[Result, ...]

    def compared(self, row: EvaluationRow) -> Comparison | None:
        """The comparison of a row's policy with the better rule, None if there is none."""
        keys = {(pair.policy, pair.config_hash): pair for pair in self.comparisons}
        return keys.get((row.policy, row.config_hash))

    def to_json(self) -> str:
        """Everything but the traces as JSON.

        core_version, configs, seeds, rows, comparisons, results
        """
        configs = (
            (config, {"hash": config.hash, "horizon": horizon(config)}) for config in self.configs
        )
        document = {
            "core_version": CORE_VERSION,
            "configs": [config.to_dict() | derived for config, derived in configs],
            "seeds": list(self.seeds),
            "rows": [asdict(row) for row in self.rows],
            "comparisons": [asdict(comparison) for comparison in self.comparisons],
            "results": [result.figures() for result in self.results],
        }
        return json.dumps(document, indent=1)

    def to_csv(self) -> str:
        """The rows as CSV, each with its comparison; a cell is empty if there is none."""
        fields = [name for name in Comparison.__dataclass_fields__ if name.startswith(COMPARED)]
        names = [*EvaluationRow.__dataclass_fields__, *(f"rule_{name}" for name in fields)]
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(names)
        for row in self.rows:
            cells = list(asdict(row).values())
            comparison = self.compared(row)
            cells += [getattr(comparison, name) if comparison else "" for name in fields]
            writer.writerow(map(to_cell, cells))
        return text.getvalue()


def tabulate(
    configs: Sequence[EnvConfig],
    policies: Sequence[str],
    seeds: Sequence[int],
    results: Iterable[Result],
) -> EvaluationTable:
    """The table of results that came in any order: by configuration, policy and seed."""
    config_of = {config.hash: number for number, config in enumerate(configs)}
    policy_of = {name: number for number, name in enumerate(policies)}
    seed_of = {seed: number for number, seed in enumerate(seeds)}

    def place(result: Result) -> tuple[int, int, int]:
        return config_of[result.config_hash], policy_of[result.policy], seed_of[result.seed]

    ordered = sorted(results, key=place)
    rows: list[EvaluationRow] = []
    comparisons: list[Comparison] = []
    for config in configs:
        by_policy: dict[str, list[Result]] = {name: [] for name in policies}
        for result in ordered:
            if result.config_hash == config.hash:
                by_policy[result.policy].append(result)
        rows += [summarize_policy(episodes) for episodes in by_policy.values()]
        comparisons += compare(by_policy)
    parts = tuple(configs), tuple(seeds), tuple(rows), tuple(comparisons), tuple(ordered)
    return EvaluationTable(*parts)


def summarize_policy(results: Sequence[Result]) -> EvaluationRow:
    """The row of one policy's episodes of one configuration (at least two)."""
    first, outcomes = results[0], [result.outcome for result in results]
    config = first.level, first.rows, first.cols, first.config_hash
    cause = (first.policy, *config, len(results))
    columns = (_column(results, name) for name in ("score", "steps_to_99", "auc"))
    score, steps, area = map(mean_interval, columns)
    completion = outcomes.count("explored") / len(results)
    collisions = outcomes.count("collided") + outcomes.count("out_of_bounds")
    coverage = float(_column(results, "coverage").mean())
    return EvaluationRow(*cause, *score, completion, *steps, collisions, coverage, *area)


def compare(by_policy: dict[str, list[Result]]) -> list[Comparison]:
    """Compare every policy with the best rule that was played.

    by_policy   name -> results, all on the same seeds in the same order
    """
    steps = {name: _column(results, "steps_to_99") for name, results in by_policy.items()}
    rules = [name for name in RULES if name in steps]
    if not rules:
        return []
    reference = min(rules, key=lambda name: float(steps[name].mean()))
    comparisons: list[Comparison] = []
    for name, results in by_policy.items():
        if name != reference:
            first = results[0]
            setting = (first.level, first.rows, first.cols, first.config_hash, len(results))
            difference = mean_interval(steps[name] - steps[reference])
            ratio = ratio_interval(steps[name], steps[reference])
            comparisons.append(Comparison(name, reference, *setting, *difference, *ratio))
    return comparisons


def mean_interval(values: Floats) -> tuple[float, float, float]:
    """The mean of at least two values, and its t interval low and high."""
    low, high = t_interval(values)
    return float(values.mean()), float(low), float(high)


def ratio_interval(values: Floats, references: Floats) -> tuple[float, float, float]:
    """The ratio of the means of paired values, and its 95 % interval low and high.

    By linearisation (the delta method): the ratio's error is that of the mean of (value - ratio x
    reference) / mean reference.
    """
    ratio = values.mean() / references.mean()
    errors = (values - ratio * references) / references.mean()
    half_width = t_quantile(len(values) - 1) * errors.std(ddof=1) / np.sqrt(len(values))
    return float(ratio), float(ratio - half_width), float(ratio + half_width)


def _column(results: Sequence[Result], name: str) -> Floats:
    return np.array([getattr(result, name) for result in results], np.float64)


def evaluate(
    policies: Sequence[str],
    configs: EnvConfig | Sequence[EnvConfig],
    episodes: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    seeds: Sequence[int] | None = None,
    traces: bool = False,
    executor: Executor | None = None,
) -> EvaluationTable:
    """Play policies on terrains and tabulate the measures.

    Args:
        policies: Names or paths.
        configs: One configuration or several; every policy plays the terrains of the same seeds in
            each.
        episodes: How many terrains, of the seeds from `seed` on.
        seed: The first seed.
        progress: Called with (episodes played, episodes in all).
        seeds: In place of episodes and seed: at least two different ones.
        traces: Keep each episode's path and coverage after every move in `Result.trace`.
        executor: Of `concurrent.futures`, such as ProcessPoolExecutor(), that plays; None plays in
            this process. The table is the same.

    Raises:
        ValueError: If an argument is out of range.
        PolicyNotFoundError: If there is no such policy.
        PolicyFileError: If a policy's file cannot be played.
    """
    if not policies:
        raise ValueError("there must be at least one policy to evaluate, got none")
    chosen_seeds = _seeds(episodes, seed, seeds)
    configs = (configs,) if isinstance(configs, EnvConfig) else tuple(dict.fromkeys(configs))
    if not configs:
        raise ValueError("there must be at least one configuration to evaluate on, got none")
    names = list(dict.fromkeys(str(policy) for policy in policies))
    for config in configs:  # refuse what cannot be played before anything is played
        for name in names:
            policy_files.load(name, config.sensor_radius)
    chunks = make_chunks(names, configs, chosen_seeds, traces)
    total = len(names) * len(configs) * len(chosen_seeds)
    results: list[Result] = []
    for part in play_chunks(chunks, executor):
        results += part
        if progress:
            progress(len(results), total)
    return tabulate(configs, names, chosen_seeds, results)


def _seeds(episodes: int | None, seed: int, seeds: Sequence[int] | None) -> list[int]:
    """The seeds to play; ValueError if there are fewer than two or one comes twice."""
    if (episodes is None) == (seeds is None):
        raise ValueError("give either episodes (and seed) or seeds")
    if seeds is None:
        assert episodes is not None
        if episodes < 2:
            raise ValueError(f"episodes must be at least 2 (an interval needs two), got {episodes}")
        check_seed(check_seed(seed) + episodes - 1)
        return list(range(seed, seed + episodes))
    chosen = [check_seed(int(number)) for number in seeds]
    if len(chosen) < 2:
        raise ValueError(f"seeds must be at least 2 (an interval needs two), got {len(chosen)}")
    if len(set(chosen)) != len(chosen):
        raise ValueError("seeds must differ: an interval counts terrains, and one came twice")
    return chosen
