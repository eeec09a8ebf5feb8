"""The jobs of `python -m research.paper` for each figure and budget.

The order is by seed first, so that a run that is stopped leaves a whole: everything with one seed,
then with two, and so on. Budgets were planned in CPU seconds, the same for all algorithms and
variants, and are laid down in moves, so that a trial is the same wherever it runs.

Figures 6 and 7 have the policies that were trained in the same folder too: 6 PPO's of the 12
levels, 7 those of seed 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from research.paper.algorithms import ALGORITHMS, check_variant
from research.paper.episodes.play import DIFFICULTIES, difficulty_jobs
from research.paper.figures import figure6, figure7
from research.paper.figures.curves import Record
from research.paper.jobs import Job, read_lines
from research.paper.trial import HELD_OUT_TERRAINS, Trial

FIGURES = ("4", "5", "6", "7")
TRAINED = ("4", "5")
"""The figures that are of trainings; the others are of policies at play."""
LEVEL, SIZE = "random", 21
"""Of figure 4 (section 4.2 and table 1 of the paper)."""
SEEDS = 3


@dataclass(frozen=True)
class Budget:
    """The length of the trainings.

    moves     algorithm, or algorithm and variant -> moves of a trial of figure 4; works-no-CHANGE
              as works, tuned likewise
    levels    variant -> moves of a trial of figure 5; any other variant has those of "paper"
    terrains  held-out terrains that each policy is measured on
    """

    moves: dict[str, int]
    levels: dict[str, int]
    terrains: int


MOVES_OF_AN_UPDATE = 4000
"""Of PPO, RLlib's default."""
ITERATIONS = 2250
"""Of RLlib, at which the authors' script cuts figure 4 (`comparingV2.py`)."""
PAPER_MOVES = {
    "ppo": MOVES_OF_AN_UPDATE * ITERATIONS,
    "a2c": MOVES_OF_AN_UPDATE * ITERATIONS,
    "rainbow": 1000 * ITERATIONS,
    "sac": 100 * ITERATIONS,
}
"""Algorithm -> moves of the paper's training of figure 4: iterations of the size of RLlib's
default, for A2C as drawn.
"""
LEVEL_MOVES = 800_000
"""Of the paper's PPO on each of the 12 levels, figure 5."""

BUDGETS = {
    "small": Budget(
        {
            "a2c": 560_000,
            "a2c-works": 360_000,
            "ppo": 240_000,
            "ppo-tuned": 1_000_000,
            "rainbow": 40_000,
            "rainbow-works": 30_000,
            "rainbow-tuned": 80_000,
            "sac": 20_000,
            "sac-works": 15_000,
            "sac-tuned": 50_000,
        },
        {"paper": 240_000},
        50,
    ),
    "full": Budget(
        {
            "a2c": 3_000_000,
            "a2c-works": 1_800_000,
            "a2c-tuned": 4_000_000,
            "ppo": 1_250_000,
            "ppo-works": 1_200_000,
            "ppo-tuned": 6_000_000,
            "rainbow": 140_000,
            "rainbow-works": 120_000,
            "rainbow-tuned": 480_000,
            "sac": 70_000,
            "sac-works": 70_000,
            "sac-tuned": 280_000,
        },
        {"paper": 2_500_000, "works": 400_000},
        HELD_OUT_TERRAINS,
    ),
}
BUDGETS["authors"] = Budget(
    BUDGETS["full"].moves | PAPER_MOVES,
    BUDGETS["full"].levels | {"paper": LEVEL_MOVES},
    HELD_OUT_TERRAINS,
)
"""small: about 2 CPU minutes a trial; full: about 10; authors: as long as the authors' by the
letter, an hour for PPO's.
"""
VARIANTS = {"4": ("paper", "works"), "5": ("paper",)}
"""Figure -> the variants that it has unless others are asked for."""


@dataclass(frozen=True)
class Request:
    """The options of a run.

    figures     of FIGURES
    budget      a name in BUDGETS
    algorithms  of figure 4; () takes all that have the variant
    variants    of figures 4 and 5; () takes VARIANTS
    seeds       of figures 4 and 5: how many, from 0 on
    moves, terrains  in place of the budget's, for every trial
    policies    of figures 6 and 7 besides theirs and those trained: names or files
    """

    figures: tuple[str, ...]
    budget: str = "small"
    algorithms: tuple[str, ...] = ()
    variants: tuple[str, ...] = ()
    seeds: int = SEEDS
    moves: int | None = None
    terrains: int | None = None
    policies: tuple[str, ...] = ()


def plan(request: Request, folder: Path) -> list[Job]:
    """The jobs in the order in which they begin.

    They include the plays of policies that are trained in `folder` already.

    Raises:
        ValueError: If an algorithm or variant is unknown.
        PolicyNotFoundError: If there is no such policy.
        PolicyFileError: If a policy's file cannot be played.
    """
    jobs: dict[str, Job] = {}
    for figure in request.figures:
        for job in _figure_jobs(figure, request, folder):
            jobs.setdefault(job.name, job)
    for algorithm, variant in dict.fromkeys(
        (job.algorithm, job.variant) for job in jobs.values() if isinstance(job, Trial)
    ):
        check_variant(algorithm, variant)
    return list(jobs.values())


def _figure_jobs(figure: str, request: Request, folder: Path) -> Iterable[Job]:
    if figure == "4":  # within a seed the longest first
        return _trials(request, request.algorithms, VARIANTS["4"], [LEVEL])
    if figure == "5":
        trials = _trials(request, ["ppo"], VARIANTS["5"], DIFFICULTIES)
        return [*trials, *difficulty_jobs(request.budget, SIZE)]
    if figure == "6":
        return figure6.jobs((*figure6.POLICIES, *request.policies, *trained_by_level(folder)))
    return figure7.jobs((*figure7.POLICIES, *request.policies, *trained(folder)))


def _trials(
    request: Request, algorithms: Sequence[str], variants: Sequence[str], levels: Sequence[str]
) -> list[Trial]:
    """The trials of some algorithms; () takes all that have a variant, else all four."""
    budget = BUDGETS[request.budget]
    terrains = request.terrains or budget.terrains
    return [
        Trial(algorithm, variant, level, SIZE, seed, request.moves or moves, terrains)
        for seed in range(request.seeds)
        for variant in request.variants or variants
        for algorithm in algorithms or algorithms_with(variant) or ALGORITHMS
        for level in levels
        for moves in [_moves_of(budget, algorithm, variant, level)]
    ]


def algorithms_with(variant: str) -> list[str]:
    """The algorithms that have a variant."""
    names = []
    for algorithm in ALGORITHMS:
        with suppress(ValueError):
            check_variant(algorithm, variant)
            names.append(algorithm)
    return names


def _moves_of(budget: Budget, algorithm: str, variant: str, level: str) -> int:
    """The moves of a trial; 0 for an unknown algorithm, which is refused later."""
    if level != LEVEL:
        return budget.levels.get(variant, budget.levels["paper"])
    names = (f"{algorithm}-{variant}", f"{algorithm}-{variant.partition('-no-')[0]}", algorithm)
    return next((budget.moves[name] for name in names if name in budget.moves), 0)


def is_full(trial: Trial) -> bool:
    """Whether a trial has the moves of the full budget, or the paper's own.

    Shorter ones decide nothing about the paper.
    """
    kind = trial.algorithm, trial.variant, trial.level
    return trial.moves >= min(_moves_of(BUDGETS[budget], *kind) for budget in ("full", "authors"))


def records_of_figure(figure: str, records: Sequence[Record]) -> list[Record]:
    """The trials of a figure: 4 has level random, 5 has PPO on the 12 levels."""
    return [
        record
        for record in records
        if (record.trial.level == LEVEL) == (figure == "4")
        and (figure == "4" or record.trial.algorithm == "ppo")
    ]


def trained(folder: Path) -> list[str]:
    """The policy files of the finished trials on level random with seed 0."""
    return [str(path) for path in _finished(folder, f"*-{LEVEL}-{SIZE}-s0")]


def trained_by_level(folder: Path) -> list[str]:
    """The paths of PPO's policies of the 12 levels, if all twelve are finished.

    A path has "{level}" in place of the level.
    """
    patterns = []
    for first in _finished(folder, f"ppo-*-{DIFFICULTIES[0]}-{SIZE}-s0"):
        pattern = str(first).replace(DIFFICULTIES[0], figure6.LEVEL_PLACE)
        paths = [Path(pattern.replace(figure6.LEVEL_PLACE, level)) for level in DIFFICULTIES]
        if all(_finished(folder, path.stem) for path in paths):
            patterns.append(pattern)
    return patterns


def _finished(folder: Path, pattern: str) -> list[Path]:
    """The policy files of the finished trials whose names match, by name."""
    logs = {path.parent: read_lines(path) for path in sorted(folder.glob(f"{pattern}/log.jsonl"))}
    return [
        trial_folder / f"{trial_folder.name}.onnx"
        for trial_folder, lines in logs.items()
        if lines and lines[-1]["kind"] == "result"
    ]


def disagreement(jobs: Sequence[Job], folder: Path) -> str | None:
    """A sentence about the first trial in `folder` with other options, or None."""
    for job in jobs:
        if not isinstance(job, Trial):
            continue
        head = next(iter(read_lines(folder / job.name / "log.jsonl")), None)
        if head is not None and (begun := Trial(**head["trial"])) != job:
            return (
                f"{folder / job.name} was begun with {begun.moves:,} moves and {begun.terrains} terrains, "
                f"and {job.moves:,} and {job.terrains} are asked for; give another --out, or those"
            )
    return None
