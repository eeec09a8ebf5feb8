"""What the paper says of its trainings (figures 4 and 5), measured from the logs of trials.

And what `docs/paper.md` shows of them besides: tables of trained policies, and what each change is worth. A change is judged by
the completion that is lost without it, so its importance is that of a part of the paper's setting for an algorithm.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import cache
from math import isnan
from textwrap import fill

import numpy as np

from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Episode, score
from marsexplorer.intervals import Floats
from marsexplorer.training.envs import EVALUATION_SEEDS
from research.difference import answers
from research.paper.algorithms import ALGORITHMS
from research.paper.claims.results import (
    NOT_YET,
    NOTHING,
    PARTLY,
    UNDECIDED,
    Decide,
    Holds,
    Judgement,
    Results,
    above_by_seed,
    all_of,
    certainly_above,
    is_above,
    ratio_of_means,
    verdict,
)
from research.paper.episodes.play import DIFFICULTIES
from research.paper.figures.curves import (
    NAMES,
    SEEDS,
    TABLE_COLUMNS,
    TITLES,
    Record,
    cells_of,
    chosen,
    count_text,
    is_timed_alike,
    points_of,
    rows_of,
)
from research.paper.jobs import Line
from research.paper.plan import LEVEL, LEVEL_MOVES, PAPER_MOVES, SIZE, is_full
from research.paper.tables import Estimate, markdown_table
from research.paper.trial import ENDINGS, HELD_OUT_TERRAINS, Trial


def by_training(results: Results) -> dict[str, dict[str, list[Line]]]:
    """Return level trained on -> level played -> results of PPO as it works, a seed each."""
    found: dict[str, dict[str, list[Line]]] = {}
    for line in results.plays[8]:
        trained_on = line["policy"].removeprefix("ppo-works-").rsplit("-", 2)[0]
        found.setdefault(trained_on, {}).setdefault(line["level"], []).append(line)
    return found


def few_terrains(results: Results) -> Trials:
    """Return number of training terrains in words -> the trials on level random."""
    kinds = {"10": "works@10", "100": "works@100", "1,000": "works@1000", "unlimited": "works"}
    found = {words: of_figure_4(results, "ppo", variant) for words, variant in kinds.items()}
    return {words: own for words, own in found.items() if own}


def as_it_works(holds: bool) -> str:
    """Return the verdict on a statement by PPO as it works: at best in part, and nothing against the paper."""
    return PARTLY if holds else UNDECIDED


def generalises(results: Results) -> Judgement:
    """Training on diverse terrains gives strong generalisation: new terrains are completed, the more the more there were."""
    trials = few_terrains(results)
    if not trials:
        return NOTHING
    shares = {
        words: np.array([record.result["completion"] for record in own])
        for words, own in trials.items()
    }
    words = ", ".join(
        f"{name} {Estimate.of(each).percent()} and {_moves_of(trials[name])}"
        for name, each in shares.items()
    )
    measured = f"as it works, completion of new terrains, and moves to 99 %, after training on so many: {words}"
    if len(shares) < 4 or min(map(len, shares.values())) < SEEDS:
        return Judgement(measured, UNDECIDED)
    return Judgement(measured, as_it_works(is_above(shares["unlimited"], shares["10"])))


def _moves_of(records: Sequence[Record]) -> str:
    return Estimate.of([record.result["steps"] for record in records]).text(0)


EASIEST, HARDEST = ("1-1-1", "1-1-2"), ("3-2-1", "3-2-2")
"""The levels of either end of the difficulty; d_b changes no terrain, so the two of a pair have the same."""


def moves_between(results: Results, levels: Sequence[str]) -> Floats:
    """Return the mean moves on the levels between the easiest and the hardest, of each training on one of `levels`."""
    trained = by_training(results)
    return np.array(
        [
            np.mean([line["steps_to_99"] for line in seed])
            for trained_on in levels
            for seed in zip(
                *(
                    lines
                    for level, lines in trained.get(trained_on, {}).items()
                    if level not in (*EASIEST, *HARDEST)
                ),
                strict=False,
            )
        ]
    )


def harder_generalises(results: Results) -> Judgement:
    """What was trained on the greater difficulty does better on levels that it was not trained on."""
    easy, hard = (moves_between(results, levels) for levels in (EASIEST, HARDEST))
    if not len(easy) or not len(hard):
        return NOTHING
    words = ", ".join(
        f"trained on {' or '.join(levels)} {Estimate.of(each).text(1)} ({len(each)} trainings)"
        for levels, each in ((EASIEST, easy), (HARDEST, hard))
    )
    measured = (
        f"as it works, moves to 99 % on the levels between the easiest and the hardest: {words}"
    )
    if min(len(easy), len(hard)) < SEEDS:
        return Judgement(measured, UNDECIDED)
    return Judgement(measured, as_it_works(is_above(easy, hard)))


AIM = 0.9
"""Share of the 21x21 terrains of level `random` that each algorithm should complete as it works, 0..1."""
MILLION = 1_000_000
SERIOUS = 0.1
"""Loss of normalized score that counts as a serious degradation; the paper's is about 0.2 (a little above 0.6 from 0.8)."""
Trials = dict[str, list[Record]]
"""Algorithm or level -> its trials."""
PAPER_STEPS = 30 * -(-4000 // 128)
"""Gradient steps of the paper's PPO for each 4,000 moves: 30 passes in batches of 128."""


def of_figure_4(results: Results, algorithm: str, variant: str) -> list[Record]:
    """Return the trainings of one algorithm and variant on the level of figure 4."""
    return results.trials(algorithm=algorithm, variant=variant, level=LEVEL, size=SIZE)


def of_figure_5(results: Results, level: str, variant: str) -> list[Record]:
    """Return PPO's trainings of a variant on one level."""
    return results.trials(algorithm="ppo", variant=variant, level=level, size=SIZE)


def figure_4(results: Results, variant: str) -> Trials:
    """Return the trials of each algorithm, empty unless all four have SEEDS of them."""
    found = {name: of_figure_4(results, name, variant) for name in ALGORITHMS}
    return found if min(map(len, found.values())) >= SEEDS else {}


def decided(measured: str, holds: Holds, trials: Trials) -> Judgement:
    """Return a judgement by the one-sided rule; the moves and gradient steps of both are said.

    Trainings of the paper's moves can show that a statement holds. That it does not takes its gradient steps too.
    """
    records = [record for each in trials.values() for record in each]
    if not all(is_full(record.trial) for record in records):
        return Judgement(f"after short trainings, which decide nothing: {measured}", NOT_YET)
    needed = [is_as_long(record) and (holds or has_the_steps(record)) for record in records]
    return Judgement(f"{measured}. {lengths(trials)}", verdict(holds) if all(needed) else UNDECIDED)


def has_the_steps(record: Record) -> bool:
    """Return whether a training of PPO made as many gradient steps as the paper's; of the others nobody says how many."""
    if record.trial.algorithm != "ppo":
        return True
    return gradient_steps(record) >= paper_moves(record.trial) // 4000 * PAPER_STEPS


def paper_moves(trial: Trial) -> int:
    """Return how many moves the paper's training of a kind had."""
    return PAPER_MOVES[trial.algorithm] if trial.level == LEVEL else LEVEL_MOVES


def is_as_long(record: Record) -> bool:
    """Return whether a training had as many moves as the paper's of its kind."""
    return bool(record.result["moves"] >= paper_moves(record.trial))


def gradient_steps(record: Record) -> int:
    """Return how many gradient steps a training made, from the settings that it logged."""
    own, moves = record.settings, record.result["moves"]
    if "moves_per_update" in own:
        return int(max(0, moves - own["learning_starts"]) // own["moves_per_update"])
    between = own["num_envs"] * own["num_steps"]
    passes = own.get("update_epochs", 1) * -(-between // own.get("minibatch_size", between))
    return int(moves // between * passes)


def lengths(trials: Trials) -> str:
    """Return how long our trainings and the paper's are, in words: the first of each algorithm, and the paper's PPO."""
    first = {
        record.trial.algorithm: record for each in reversed(trials.values()) for record in each[:1]
    }
    ours = (
        f"{NAMES[name]} {count_text(first[name].result['moves'])} and {count_text(gradient_steps(first[name]))}"
        for name in NAMES
        if name in first
    )
    paper = ", ".join(
        f"{NAMES[name]} {count_text(paper_moves(first[name].trial))}"
        for name in NAMES
        if name in first
    )
    steps = count_text(paper_moves(first["ppo"].trial) // 4000 * PAPER_STEPS)
    return (
        f"Moves and gradient steps of our trainings: {', '.join(ours)}; moves of the paper's: {paper}; "
        f"its PPO made {steps} gradient steps"
    )


def score_at(record: Record, axis: str, limit: float) -> float:
    """Return the score of the last point of a curve whose `axis` (moves or cpu_s) is within the limit; NaN before the first."""
    x, scores = points_of(record, "score", axis)
    return float([np.nan, *scores[x <= limit]][-1])


def scores_at(trials: Trials, axis: str | None) -> dict[str, Floats]:
    """Return the scores by algorithm, best first, at the end or where the shortest trial has ended on `axis`."""
    end = np.inf
    if axis is not None:
        end = min(record.curve[axis][-1] or 0 for each in trials.values() for record in each)
    found = {
        name: np.array([score_at(record, axis or "moves", end) for record in each])
        for name, each in trials.items()
    }
    return dict(sorted(found.items(), key=lambda item: -np.nan_to_num(item[1].mean(), nan=-1)))


def order(scores: dict[str, Floats]) -> str:
    """Return algorithms and their scores in words, best first."""
    means = {name: Estimate.of(values) for name, values in scores.items()}
    return ", ".join(
        f"{name} {mean.text() if mean.is_known else 'too early to say'}"
        for name, mean in means.items()
    )


def best(results: Results) -> Judgement:
    """PPO achieves the highest average episodic reward."""
    trials = figure_4(results, "paper")
    if not trials:
        return NOTHING
    views = {"at the end": None, "at equal moves": "moves"}
    if is_timed_alike([record for each in trials.values() for record in each]):
        views["at equal CPU time"] = "cpu_s"
    scores = {words: scores_at(trials, axis) for words, axis in views.items()}
    wins = all_of(beats("ppo", scores["at the end"]))
    measured = "; ".join(f"{words} {order(each)}" for words, each in scores.items())
    return decided(measured, wins, trials)


def beats(name: str, scores: dict[str, Floats]) -> list[Holds]:
    """Return whether an algorithm is above each of the others, None where neither is with certainty."""
    return [
        certainly_above(scores[name], values) for other, values in scores.items() if other != name
    ]


def second(results: Results) -> Judgement:
    """DQN-Rainbow achieves the second-best performance."""
    trials = figure_4(results, "paper")
    if not trials:
        return NOTHING
    scores = scores_at(trials, None)
    found = beats("rainbow", scores)
    below, above = found.count(False), found.count(True)
    is_second: Holds = None
    if below > 1 or above == len(found):
        is_second = False
    elif None not in found:
        is_second = True
    return decided(f"at the end {order(scores)}", is_second, trials)


def half(results: Results) -> Judgement:
    """Rainbow's average is 50.04 % of PPO's."""
    trials = figure_4(results, "paper")
    if not trials:
        return NOTHING
    scores = scores_at(trials, None)
    ratio = ratio_of_means(scores["rainbow"], scores["ppo"])
    is_inside = ratio.low <= 0.5004 <= ratio.high
    holds = (True if ratio.high - ratio.low < 0.5 else None) if is_inside else False
    words = f"{ratio.mean:.3f}, and no bounded interval, since PPO's may be 0"
    if ratio.high < np.inf:
        words = ratio.span("{:.3f}")
    return decided(f"ratio of the means of the final scores {words}", holds, trials)


def millions(results: Results) -> Judgement:
    """The algorithms usually need millions of time steps to converge: so most of the trainings by the letter do.

    Undecided until most have converged, however long they are.
    """
    words = []
    for name in NAMES:
        found = [converged(record) for record in of_figure_4(results, name, "works")]
        if found and None not in found:
            words.append(f"{NAMES[name]} {count_text(max(each or 0 for each in found))}")
    letter = chosen(results.records, variant="paper", level=LEVEL, size=SIZE)
    if not words or not letter:
        return NOTHING
    reached = [moves for record in letter if (moves := converged(record)) is not None]
    shorter = sum(not is_as_long(record) for record in letter)
    measured = (
        f"as it works all seeds have completed {AIM:.0%} of their last 100 episodes after at most {', '.join(words)} moves; "
        f"by the letter {len(reached)} of {len(letter)} trainings ever have; {shorter} of these are shorter than the paper's"
    )
    late = sum(moves >= MILLION for moves in reached)
    usual: Holds = None
    if 2 * late > len(letter):
        usual = True
    elif 2 * (len(reached) - late) > len(letter):
        usual = False
    return Judgement(measured, verdict(usual))


def converged(record: Record) -> int | None:
    """Return the moves after which a training had completed AIM of its last 100 episodes; None when it never had."""
    moves, completion = points_of(record, "explored", "moves")
    there = np.flatnonzero(completion >= AIM)
    return int(moves[there[0]]) if len(there) else None


def with_bonus(record: Record) -> float:
    """Return the normalized score at the end of a training on t-m-b as it would be on t-m-1.

    Levels t-m-2 pay neither n nor -n for how an episode ends, so their score has another scale. The share of episodes that
    ended either way is known, so the two can be counted.
    """
    last = {name: float(column[-1] or 0) for name, column in record.curve.items()}
    config, size = record.trial.config, record.trial.size
    other = EnvConfig.of(record.trial.level[:-1] + "1", size)
    range_of_score = config.r_invalid + config.r_bonus + config.n
    gained = last["score"] * range_of_score - config.r_invalid
    ends = (other.r_bonus - config.r_bonus) * last["explored"]
    ends -= (other.r_invalid - config.r_invalid) * (last["collided"] + last["out_of_bounds"])
    return score(other, gained + ends)


def figure_5(results: Results, variant: str) -> Trials:
    """Return PPO's trials on each of the 12 levels, as many of each; empty until all have SEEDS."""
    trials = {level: of_figure_5(results, level, variant) for level in DIFFICULTIES}
    count = min(map(len, trials.values()))
    return {level: own[:count] for level, own in trials.items()} if count >= SEEDS else {}


def at_the_end(name: str) -> Callable[[Record], float]:
    """Return what gives the last point of a column of the curve."""
    return lambda record: float(record.curve[name][-1] or 0)


Finals = dict[str, dict[str, Floats]]
"""Name in ON_LEVELS -> level -> final values float64[seeds]."""
ON_LEVELS: dict[str, Callable[[Record], float]] = {
    "score": at_the_end("score"),
    "score with the bonus counted everywhere": with_bonus,
}
COMPARABLE = "score with the bonus counted everywhere"
"""What levels of both d_b are judged by: the scores of t-m-1 and t-m-2 have two scales."""
AS_IT_SAYS = {True: "as the paper says", False: "not as the paper says", None: "undecided"}


def on_levels(measure: Callable[[Finals], tuple[str, Holds]]) -> Decide:
    """Return what judges a statement about the 12 levels, by the letter and as it works.

    The letter alone decides. Without it the statement is undecided, whatever PPO does as it works.

    measure  final values -> what they say in words, and whether the paper's statement holds of them
    """

    def decide(results: Results) -> Judgement:
        parts, found, said = [], NOT_YET, ""
        for variant in ("paper", "works"):
            if trials := figure_5(results, variant):
                finals = {
                    name: {level: np.array([*map(of, own)]) for level, own in trials.items()}
                    for name, of in ON_LEVELS.items()
                }
                words, holds = measure(finals)
                parts.append(f"{TITLES[variant]}: {words}")
                said = said or lengths(trials)
                if variant == "paper":
                    found = decided(words, holds, trials).verdict
                elif found == NOT_YET:
                    found = UNDECIDED
                    parts[-1] += f", {AS_IT_SAYS[holds]}"
        return Judgement(". ".join([*parts, said] if said else parts), found)

    return decide


def mean_with(finals: dict[str, Floats], element: int, value: str) -> Floats:
    """Return the mean over the levels where an element of the difficulty (0 d_t, 1 d_m, 2 d_b) has a value, for each seed."""
    own = [each for level, each in finals.items() if level.split("-")[element] == value]
    return np.asarray(np.mean(own, axis=0))


def effects(finals: Finals) -> tuple[dict[str, Floats], str]:
    """The effects of d_t, d_m and d_b on the comparable score, with words.

    The effect of an element is the highest less the lowest mean of its values, float64[seeds].
    """
    own, found = finals[COMPARABLE], {}
    for element, name in enumerate(("d_t", "d_m", "d_b")):
        values = {level.split("-")[element] for level in own}
        means = [mean_with(own, element, value) for value in values]
        found[name] = np.ptp(means, axis=0)
    words = ", ".join(f"{name} {Estimate.of(spread).text()}" for name, spread in found.items())
    return found, f"spread of the {COMPARABLE} between its values: {words}"


def larger(found: dict[str, Floats], pairs: Sequence[tuple[str, str]]) -> tuple[str, Holds]:
    """Return by how much the first effect of each pair is larger than the second, and whether all are with certainty."""
    words = ", ".join(f"{a} less {b} {Estimate.of(found[a] - found[b]).text()}" for a, b in pairs)
    return (
        f"by seed: {words}",
        all_of(above_by_seed(found[a], found[b]) for a, b in pairs),
    )


@on_levels
def morphology_first(finals: Finals) -> tuple[str, Holds]:
    """d_m has the largest effect on the learned policy."""
    found, words = effects(finals)
    differences, holds = larger(found, [("d_m", "d_t"), ("d_m", "d_b")])
    return f"{words}; {differences}", holds


@on_levels
def morphology_degrades(finals: Finals) -> tuple[str, Holds]:
    """With d_m = 1 the policies perform best, and d_m = 2 degrades them seriously."""
    small, large = (mean_with(finals[COMPARABLE], 1, value) for value in ("1", "2"))
    is_serious = above_by_seed(small, large, SERIOUS)
    size = {True: "more than", False: "less than", None: "not certainly more or less than"}
    of_loss = "a certain loss" if above_by_seed(small, large) else "a loss"
    one, two, loss = (Estimate.of(each).text() for each in (small, large, small - large))
    return (
        f"final score with the bonus counted everywhere {one} with d_m = 1, {two} with d_m = 2: "
        f"{of_loss} of {loss}, {size[is_serious]} the {SERIOUS} that counts as serious"
    ), is_serious


@on_levels
def hardest(finals: Finals) -> tuple[str, Holds]:
    """With d_m = 2 and d_t = 3 the final performance is a little above 0.6."""
    found = {level: Estimate.of(finals["score"][level]) for level in ("3-2-1", "3-2-2")}
    words = ", ".join(f"{level} {mean.text()}" for level, mean in found.items())
    return f"final score: {words}", all_of(is_within(each, 0.6, 0.7) for each in found.values())


def is_within(score: Estimate, low: float, high: float) -> Holds:
    """Return whether a score lies in low..high, None where its interval reaches over an end."""
    if low <= score.low and score.high < high:
        return True
    return False if score.high < low or score.low >= high else None


@on_levels
def bonus_little(finals: Finals) -> tuple[str, Holds]:
    """d_b does not affect the overall performance much."""
    found, _ = effects(finals)
    differences, holds = larger(found, [("d_t", "d_b"), ("d_m", "d_b")])
    return f"the spreads of `morphology-first`; {differences}", holds


NONE_YET = "No such trainings are shipped yet."
WITHOUT = ("works", "tuned")
"""The variants from which a change can be taken out."""
STARTS = (*(f"{variant}-no-" for variant in WITHOUT), "paper+", "paper-no-")
"""What the names of variants begin with that leave a change out, make it alone, and leave a part of the paper's out."""


def completion(results: Results, algorithm: str, variant: str) -> Estimate:
    """Return the completion on held-out terrains over seeds, UNKNOWN without a training."""
    trials = of_figure_4(results, algorithm, variant)
    return Estimate.of([record.result["completion"] for record in trials])


def percent(share: Estimate) -> str:
    """Return a share in per cent, nothing where it is not known."""
    return share.percent() if share.is_known else ""


def as_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown; NONE_YET without rows."""
    return markdown_table(columns, rows) if rows else NONE_YET


def without_constants(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table without the columns that have one value, which a line above it has."""
    values = dict(zip(columns, zip(*rows, strict=True), strict=True)) if rows else {}
    common = ", ".join(f"{name} {each[0]}" for name, each in values.items() if len({*each}) == 1)
    varying = {name: each for name, each in values.items() if len({*each}) > 1}
    table = as_table([*varying], [*zip(*varying.values(), strict=True)])
    return f"In all rows: {common}.\n\n{table}" if common else table


def trained(results: Results) -> str:
    """Return the table of the policies of figure 4: all four algorithms, by the letter, as they work, and tuned."""
    found = [
        each
        for variant in TITLES
        for each in chosen(results.records, variant=variant, level=LEVEL, size=SIZE)
    ]
    return without_constants(TABLE_COLUMNS, [cells_of(row) for row in rows_of(found)])


def levels_in_short(results: Results) -> str:
    """What PPO reaches on the 12 levels, by the letter and as it works, in words."""
    letter, works = (figure_5(results, variant) for variant in ("paper", "works"))
    if not letter or not works:
        return NONE_YET
    shares: dict[str, list[float]] = {"1": [], "2": []}
    for level, records in letter.items():
        shares[level[2]].append(_mean(records, "coverage"))
    (first, *_), *_ = letter.values()
    small, large = (f"{min(means):.0%} to {max(means):.0%}" for means in shares.values())
    ratios = [_mean(own, "steps") / _mean(own, "best_rule_steps") for own in works.values()]
    harder = [
        _mean(works[level.replace("-1-", "-2-", 1)], "steps") - _mean(own, "steps")
        for level, own in works.items()
        if level[2] == "1"
    ]
    completed = [_mean(own, "completion") for trials in (letter, works) for own in trials.values()]
    half = len(letter)
    return fill(
        f"By the letter, each training on a level has {count_text(first.result['moves'])} moves and "
        f"{count_text(gradient_steps(first))} gradient steps, and completes {max(completed[:half]):.0%} of the terrains; "
        f"it covers {small} of the cells where obstacles are small (d_m = 1), {large} where they are large. As it works, "
        f"it completes {min(completed[half:]):.0%} of each level's terrains, or more, "
        f"in {min(ratios):.2f} to {max(ratios):.2f} of the "
        f"better rule's moves; large obstacles cost it {min(harder):.0f} to {max(harder):.0f} moves more.",
        110,
        break_on_hyphens=False,
    )


def _mean(records: Sequence[Record], name: str) -> float:
    return float(np.mean([record.result[name] for record in records]))


def changes_of(results: Results, algorithm: str) -> list[str]:
    """Return the changes of which an algorithm has trainings without them, or with them alone."""
    trials = [each.trial for each in results.records if each.trial.algorithm == algorithm]
    variants = {trial.variant for trial in trials}
    found = {
        each.removeprefix(start) for each in variants for start in STARTS if each.startswith(start)
    }
    return sorted(each for each in found if "+" not in each)


def ablations(results: Results) -> str:
    """Return what each change does to completion, as a table, the one whose lack costs most first."""
    rows: list[tuple[str, float, list[str]]] = []
    for name in ALGORITHMS:
        whole = [completion(results, name, variant) for variant in WITHOUT]
        for change in changes_of(results, name):
            others = [completion(results, name, start + change) for start in STARTS]
            losses = [both.mean - one.mean for both, one in zip(whole, others, strict=False)]
            lost = max((each for each in losses if not isnan(each)), default=0.0)
            used = (of_figure_4(results, name, start + change) for start in STARTS)
            sizes = [
                f"{len(each)} x {each[0].trial.terrains}, {count_text(each[0].trial.moves)}"
                for each in used
                if each
            ]
            cells = [f"`{change}`", *map(percent, others), "; ".join(dict.fromkeys(sizes))]
            rows.append((NAMES[name], -lost, cells))
    columns = ("algorithm", "change", "works without it", "tuned without it")
    alone = ("the letter with it alone", "the letter without it", "seeds x terrains, moves")
    rows.sort(key=lambda row: row[:2])
    return as_table((*columns, *alone), [[name, *cells] for name, _, cells in rows])


@cache
def constant_actions() -> dict[str, dict[str, float]]:
    """Return what each action does that is made at every move, on the terrains of the measurements: a result's shares."""
    config, found = EnvConfig.of(LEVEL, SIZE), {}
    for action, name in enumerate(ACTIONS):
        ends = []
        for seed in range(EVALUATION_SEEDS.start, EVALUATION_SEEDS.start + HELD_OUT_TERRAINS):
            episode = Episode.begin(config, seed=seed)
            while not episode.ended:
                episode.step(action)
            ends.append((episode.coverage, episode.outcome))
        shares = {end: sum(outcome == end for _, outcome in ends) / len(ends) for end in ENDINGS}
        found[name] = {"coverage": round(float(np.mean([each for each, _ in ends])), 4), **shares}
    return found


def became(results: Results) -> str:
    """How many trainings by the letter became a constant action, in words."""
    letter = chosen(results.records, variant="paper", level=LEVEL)
    ended = [record for record in letter if "collided" in record.result]
    constant: Counter[str] = Counter()
    for record in ended:
        own = record.result
        same = [
            name
            for name, figures in constant_actions().items()
            if all(own.get(key) == share for key, share in figures.items())
        ]
        if same:
            constant[f"{NAMES[record.trial.algorithm]} always {same[0]}"] += 1
    words = ", ".join(f"{name} {count}" for name, count in sorted(constant.items()))
    return f"Of {len(ended)} trainings by the letter, {constant.total()} became a constant move: {words or 'none'}."


def unfinished(results: Results) -> str:
    """Return how far the trainings are that are not finished, as a table."""
    rows = []
    for each in results.unfinished:
        trial, line = each["trial"], each["line"]
        name = f"{NAMES[trial.algorithm]} {trial.variant}"
        far = f"{count_text(each['moves'])} of {count_text(trial.moves)}"
        shares = (f"{line[column]:.3f}" if line else "" for column in ("coverage", "explored"))
        rows.append([name, str(trial.seed), far, *shares])
    columns = ("training", "seed", "moves", "coverage as trained", "completion as trained")
    return markdown_table(columns, rows) if rows else "None is under way."


BLOCKS: dict[str, Callable[[Results], str]] = {
    "trained policies": trained,
    "levels in short": levels_in_short,
    "ablations": ablations,
    "became": became,
    "unfinished": unfinished,
    "difference in short": lambda results: answers.in_short(answers.read_stored()),
    "difference": lambda results: answers.table(answers.read_stored()),
}
"""Name of a drawn block of the document -> what draws it."""
