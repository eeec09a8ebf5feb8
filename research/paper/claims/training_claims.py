"""What the paper says of its trainings (figures 4 and 5), measured from the logs of trials.

And what `docs/paper.md` shows of them besides: tables of trained policies, and what each change is worth. A change is judged by
the completion that is lost without it, so its importance is that of a part of the paper's setting for an algorithm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.intervals import t_interval
from marsexplorer.score import score
from research.paper.algorithms import ALGORITHMS
from research.paper.claims.results import (
    NOT_YET,
    NOTHING,
    PARTLY,
    REPRODUCED,
    Judgement,
    Results,
    Values,
    is_above,
    mean_of,
    verdict,
)
from research.paper.figures.curves import (
    NAMES,
    TABLE_COLUMNS,
    TITLES,
    Mean,
    Record,
    cells_of,
    rows_of,
)
from research.paper.plan import LEVEL, SIZE, is_full

SERIOUS = 0.1
"""Loss of normalized score that counts as a serious degradation; the paper's is about 0.2 (a little above 0.6 from 0.8)."""
SEEDS = 3
"""Fewest seeds that a verdict is given on."""
FIGURE_4 = {"level": "random", "size": 21}
TOPOLOGIES, MORPHOLOGIES, BONUSES = (1, 2, 3), (1, 2), (1, 2)


def figure_4(results: Results, variant: str) -> dict[str, list[Record]]:
    """Return the trials of each algorithm, empty unless all four have SEEDS of them."""
    found = {
        name: results.trials(algorithm=name, variant=variant, **FIGURE_4) for name in ALGORITHMS
    }
    return found if all(len(each) >= SEEDS for each in found.values()) else {}


def decided(measured: str, holds: bool, records: Iterable[Record]) -> Judgement:
    """Return a judgement; trainings shorter than those of the full budget are shown, and decide nothing."""
    if all(is_full(record.trial) for record in records):
        return Judgement(measured, verdict(holds))
    return Judgement(f"after short trainings, which decide nothing: {measured}", NOT_YET)


def every(trials: dict[str, list[Record]]) -> list[Record]:
    """Return the trials of all algorithms."""
    return [record for each in trials.values() for record in each]


def score_at(record: Record, axis: str, limit: float) -> float:
    """Return the score of the last point of a curve whose `axis` (moves or cpu_s) is within the limit; NaN before the first."""
    points = zip(record.curve[axis], record.curve["score"], strict=True)
    return next(
        (
            score
            for x, score in reversed([*points])
            if x is not None and score is not None and x <= limit
        ),
        np.nan,
    )


def scores_at(trials: dict[str, list[Record]], axis: str | None) -> dict[str, Values]:
    """Return the scores by algorithm, best first, at the end or where the shortest trial has ended on `axis`."""
    ends = (
        [float(record.curve[axis][-1] or 0) for each in trials.values() for record in each]
        if axis
        else [np.inf]
    )
    found = {
        name: np.array(
            [score_at(record, axis or "moves", min(ends)) for record in each], np.float64
        )
        for name, each in trials.items()
    }
    return dict(sorted(found.items(), key=lambda item: -np.nan_to_num(item[1].mean(), nan=-1)))


def order(scores: dict[str, Values]) -> str:
    """Return algorithms and their scores in words, best first."""
    known = {
        name: "too early to say" if np.isnan(values).any() else mean_of(values)
        for name, values in scores.items()
    }
    return ", ".join(f"{name} {words}" for name, words in known.items())


def best(results: Results) -> Judgement:
    """PPO achieves the highest average episodic reward."""
    parts, wins = [], False
    for variant, column in TITLES.items():
        trials = figure_4(results, variant)
        if not trials:
            continue
        views = {"at the end": None, "at equal moves": "moves", "at equal CPU time": "cpu_s"}
        scores = {words: scores_at(trials, axis) for words, axis in views.items()}
        parts.append(
            f"{column}: " + "; ".join(f"{words} {order(each)}" for words, each in scores.items())
        )
        if variant == "paper":
            first, second = list(scores["at the end"].items())[:2]
            wins = first[0] == "ppo" and is_above(first[1], second[1])
    letter = every(figure_4(results, "paper"))
    return (
        decided(". ".join(parts), wins, letter) if letter else Judgement(". ".join(parts), NOT_YET)
    )


def second(results: Results) -> Judgement:
    """DQN-Rainbow achieves the second-best performance."""
    trials = figure_4(results, "paper")
    if not trials:
        return NOTHING
    scores = scores_at(trials, None)
    return decided(f"at the end {order(scores)}", list(scores)[1] == "rainbow", every(trials))


def half(results: Results) -> Judgement:
    """Rainbow's average is 50.04 % of PPO's."""
    trials = figure_4(results, "paper")
    if not trials:
        return NOTHING
    scores = scores_at(trials, None)
    count = min(len(scores["rainbow"]), len(scores["ppo"]))
    ratios = scores["rainbow"][:count] / scores["ppo"][:count]
    low, high = t_interval(ratios)
    holds = bool(low <= 0.5004 <= high and high - low < 0.5)
    return decided(f"ratio of the final scores {mean_of(ratios)}", holds, every(trials))


def with_bonus(record: Record) -> float:
    """Return the normalized score at the end of a training on t-m-b as it would be on t-m-1.

    Levels t-m-2 pay neither n nor -n for how an episode ends, so their score has another scale. The share of episodes that
    ended either way is known, so the two can be counted.
    """
    last = {name: column[-1] for name, column in record.curve.items()}
    config, other = (
        record.trial.config,
        EnvConfig.of(record.trial.level[:-1] + "1", record.trial.size),
    )
    gained = (
        float(last["score"] or 0) * (config.r_invalid + config.r_bonus + config.n)
        - config.r_invalid
    )
    explored, invalid = (
        float(last["explored"] or 0),
        float(last["collided"] or 0) + float(last["out_of_bounds"] or 0),
    )
    ends = (other.r_bonus - config.r_bonus) * explored - (
        other.r_invalid - config.r_invalid
    ) * invalid
    return score(other, gained + ends)


def by_level(
    results: Results, measure: Callable[[Record], float], variant: str
) -> dict[str, Values]:
    """Return a measure of PPO's trainings on each of the 12 levels: float64[seeds] each; empty until all have SEEDS."""
    levels = [f"{t}-{m}-{b}" for t in TOPOLOGIES for m in MORPHOLOGIES for b in BONUSES]
    trials = {
        level: results.trials(algorithm="ppo", variant=variant, level=level, size=21)
        for level in levels
    }
    count = min(map(len, trials.values()))
    found = {
        level: np.array([measure(each) for each in own[:count]], np.float64)
        for level, own in trials.items()
    }
    return found if count >= SEEDS else {}


def at_the_end(name: str) -> Callable[[Record], float]:
    """Return what gives the last point of a column of the curve."""
    return lambda record: float(record.curve[name][-1] or 0)


def of_levels(results: Results, variant: str) -> list[Record]:
    """Return PPO's trials of a variant on the 12 levels."""
    return [
        record
        for level in by_level(results, at_the_end("score"), variant)
        for record in results.trials(algorithm="ppo", variant=variant, level=level)
    ]


Measure = Callable[[dict[str, dict[str, Values]]], tuple[str, bool]]
"""Name in ON_LEVELS -> final values by level -> what they say in words, and whether the paper's statement holds of them."""
ON_LEVELS: dict[str, Callable[[Record], float]] = {
    "score": at_the_end("score"),
    "score with the bonus counted everywhere": with_bonus,
    "coverage": at_the_end("coverage"),
}
COMPARABLE = "score with the bonus counted everywhere"
"""What the effect of d_b is judged by: the scores of t-m-1 and t-m-2 have two scales."""


def on_levels(results: Results, measure: Measure) -> Judgement:
    """Return the judgement of a statement about the 12 levels, by the letter and as it works.

    The letter decides. What holds of PPO as it works alone holds in part.
    """
    parts, verdicts = [], {}
    for variant in ("paper", "works"):
        finals = {name: by_level(results, of, variant) for name, of in ON_LEVELS.items()}
        if finals["score"]:
            words, holds = measure(finals)
            one = decided(words, holds, of_levels(results, variant))
            parts.append(f"{TITLES[variant]}: {one.measured}")
            verdicts[variant] = one.verdict
    if verdicts.get("paper", NOT_YET) != NOT_YET:
        return Judgement(". ".join(parts), verdicts["paper"])
    found = verdicts.get("works", NOT_YET)
    return Judgement(". ".join(parts), PARTLY if found == REPRODUCED else found)


def effect(finals: dict[str, Values], element: int) -> Values:
    """Return the effect of one element of the difficulty (0 d_t, 1 d_m, 2 d_b) for each seed: highest less lowest mean."""
    values = sorted({level.split("-")[element] for level in finals})
    means = [
        np.mean(
            [each for level, each in finals.items() if level.split("-")[element] == value], axis=0
        )
        for value in values
    ]
    spread: Values = np.max(means, axis=0) - np.min(means, axis=0)
    return spread


def effects(finals: dict[str, dict[str, Values]]) -> tuple[dict[str, Values], str]:
    """Return the effects of d_t, d_m and d_b on the score that can be compared, and words with those on all of ON_LEVELS."""
    found = {
        name: {measure: effect(values, k) for measure, values in finals.items()}
        for k, name in enumerate(("d_t", "d_m", "d_b"))
    }
    words = "; ".join(
        f"{name} "
        + ", ".join(f"{mean_of(values)} of {measure}" for measure, values in each.items())
        for name, each in found.items()
    )
    return {
        name: each[COMPARABLE] for name, each in found.items()
    }, f"spread between its values: {words}"


def morphology_first(results: Results) -> Judgement:
    """d_m has the largest effect on the learned policy."""

    def measure(finals: dict[str, dict[str, Values]]) -> tuple[str, bool]:
        found, words = effects(finals)
        return words, all(found["d_m"].mean() > found[other].mean() for other in ("d_t", "d_b"))

    return on_levels(results, measure)


def morphology_degrades(results: Results) -> Judgement:
    """With d_m = 1 the policies perform best, and d_m = 2 degrades them seriously."""

    def measure(finals: dict[str, dict[str, Values]]) -> tuple[str, bool]:
        small, large = (
            np.mean(
                [each for level, each in finals["score"].items() if level.split("-")[1] == m],
                axis=0,
            )
            for m in ("1", "2")
        )
        holds = is_above(small, large) and float(small.mean() - large.mean()) > SERIOUS
        return f"final score {mean_of(small)} with d_m = 1, {mean_of(large)} with d_m = 2", holds

    return on_levels(results, measure)


def hardest(results: Results) -> Judgement:
    """With d_m = 2 and d_t = 3 the final performance is a little above 0.6."""

    def measure(finals: dict[str, dict[str, Values]]) -> tuple[str, bool]:
        wanted = {level: finals["score"][level] for level in ("3-2-1", "3-2-2")}
        words = ", ".join(f"{level} {mean_of(values)}" for level, values in wanted.items())
        return f"final score: {words}", all(
            0.6 <= values.mean() < 0.7 for values in wanted.values()
        )

    return on_levels(results, measure)


def bonus_little(results: Results) -> Judgement:
    """d_b does not affect the overall performance much."""

    def measure(finals: dict[str, dict[str, Values]]) -> tuple[str, bool]:
        found, _ = effects(finals)
        holds = all(found["d_b"].mean() < found[other].mean() for other in ("d_t", "d_m"))
        return "the spreads of `morphology-first`", holds

    return on_levels(results, measure)


AIM = 0.9
"""Share of the 21x21 terrains of level `random` that each algorithm should complete as it works, 0..1."""
NONE_YET = "No such trainings are shipped yet."
WITHOUT = ("works", "tuned")
"""The variants from which a change can be taken out."""
STARTS = (*(f"{variant}-no-" for variant in WITHOUT), "paper+", "paper-no-")
"""What the names of variants begin with that leave a change out, make it alone, and leave a part of the paper's out."""


def completion(results: Results, algorithm: str, variant: str) -> Mean | None:
    """Return the completion on held-out terrains over seeds, None without a training."""
    trials = of_figure_4(results, algorithm, variant)
    return Mean.of([record.result["completion"] for record in trials]) if trials else None


def percent(share: Mean) -> str:
    """Return a share in per cent with half of its interval."""
    half = "" if share.high is None else f" ± {100 * (share.high - share.mean):.0f}"
    return f"{100 * share.mean:.0f}{half} %"


def as_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown; NONE_YET without rows."""
    lines = ["| " + " | ".join(each) + " |" for each in (columns, *rows)]
    return "\n".join([lines[0], "|---" * len(columns) + "|", *lines[1:]]) if rows else NONE_YET


def without_constants(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table without the columns that have one value, which a line above it has."""
    values = list(zip(*rows, strict=True))
    constant = [number for number, each in enumerate(values) if len(set(each)) == 1]
    common = ", ".join(f"{columns[number]} {values[number][0]}" for number in constant)
    kept = [number for number in range(len(columns)) if number not in constant]
    table = as_table(
        [columns[number] for number in kept], [[row[number] for number in kept] for row in rows]
    )
    return f"In all rows: {common}.\n\n{table}" if rows and common else table


def trained(results: Results) -> str:
    """Return the table of the policies of figure 4: all four algorithms, by the letter, as they work, and tuned."""
    found = [
        each
        for name in ALGORITHMS
        for variant in TITLES
        for each in of_figure_4(results, name, variant)
    ]
    return without_constants(TABLE_COLUMNS, [cells_of(row) for row in rows_of(found)])


def of_figure_4(results: Results, algorithm: str, variant: str) -> list[Record]:
    """Return the trainings of one algorithm and variant on the level of figure 4."""
    return results.trials(algorithm=algorithm, variant=variant, level=LEVEL, size=SIZE)


def levels(results: Results) -> str:
    """Return the table of the policies of figure 5: PPO on the 12 levels, with the better rule's moves for the difficulty."""
    names = sorted({record.trial.level for record in results.records} - {LEVEL})
    found = [
        each
        for variant in ("paper", "works")
        for level in names
        for each in results.trials(algorithm="ppo", variant=variant, level=level, size=SIZE)
    ]
    rule = {record.trial.level: f"{record.result['best_rule_steps']:.0f}" for record in found}
    rows = [[*cells_of(row), rule[row.level]] for row in rows_of(found)]
    return without_constants((*TABLE_COLUMNS, "steps of the better rule"), rows)


def aims(results: Results) -> str:
    """Return which algorithms complete the share of terrains that is aimed at, as a table; SEEDS seeds decide it."""
    rows = []
    for name in ALGORITHMS:
        letter, works, tuned = (completion(results, name, variant) for variant in TITLES)
        if works is not None:
            seeds = len(of_figure_4(results, name, "works"))
            reached = "too few seeds" if seeds < SEEDS else "yes" if works.mean >= AIM else "no"
            shown = [percent(each) if each else "" for each in (letter, works, tuned)]
            rows.append([NAMES[name], *shown, str(seeds), reached])
    columns = (
        "algorithm",
        "completes by the letter",
        "completes as it works",
        "completes tuned",
        "seeds as it works",
    )
    return as_table((*columns, f"{AIM:.0%} reached"), rows)


def changes_of(results: Results, algorithm: str) -> list[str]:
    """Return the changes of which an algorithm has trainings without them, or with them alone."""
    variants = {
        record.trial.variant for record in results.records if record.trial.algorithm == algorithm
    }
    found = {
        each.removeprefix(start) for each in variants for start in STARTS if each.startswith(start)
    }
    return sorted(each for each in found if "+" not in each)


def ablations(results: Results) -> str:
    """Return what each change does to completion, as a table, the one whose lack costs most first."""
    rows: list[tuple[float, list[str]]] = []
    for name in ALGORITHMS:
        whole = [completion(results, name, variant) for variant in WITHOUT]
        for change in changes_of(results, name):
            others = [completion(results, name, start + change) for start in STARTS]
            lost = max(
                (
                    both.mean - one.mean
                    for both, one in zip(whole, others, strict=False)
                    if both and one
                ),
                default=0.0,
            )
            shown = [percent(each) if each else "" for each in others]
            rows.append((lost, [NAMES[name], f"`{change}`", *shown]))
    columns = (
        "algorithm",
        "change",
        "works without it",
        "tuned without it",
        "the letter with it alone",
        "the letter without it",
    )
    return as_table(
        columns, [row for _, row in sorted(rows, key=lambda each: (each[1][0], -each[0]))]
    )


BLOCKS: dict[str, Callable[[Results], str]] = {
    "trained policies": trained,
    "trained levels": levels,
    "aims": aims,
    "ablations": ablations,
}
"""Name of a drawn block of the document -> what draws it."""
