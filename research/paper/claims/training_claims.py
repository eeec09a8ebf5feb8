"""The paper's claims about its trainings (figures 4, 5), from the logs of trials.

And what `docs/paper.md` shows of them besides: tables of trained policies, and what changes of the
paper's settings are worth. A change is judged by the completion that is lost without it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
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
    one_sided,
    ratio_of_means,
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
from research.paper.plan import (
    LEVEL,
    LEVEL_MOVES,
    MOVES_OF_AN_UPDATE,
    PAPER_MOVES,
    SIZE,
    is_full,
)
from research.paper.tables import (
    Estimate,
    low_to_high,
    markdown_table,
    per_cent,
    without_constants,
)
from research.paper.trial import ENDINGS, HELD_OUT_TERRAINS, Trial


def by_training(results: Results) -> dict[str, dict[str, list[Line]]]:
    """Return level trained on -> level played -> results of PPO as it works.

    A result a seed.
    """
    groups: dict[str, dict[str, list[Line]]] = {}
    for line in results.plays[8]:
        trained_on = line["policy"].removeprefix("ppo-works-").rsplit("-", 2)[0]
        groups.setdefault(trained_on, {}).setdefault(line["level"], []).append(line)
    return groups


def few_terrains(results: Results) -> Trials:
    """Return number of training terrains in words -> the trials on level random."""
    kinds = {"10": "works@10", "100": "works@100", "1,000": "works@1000", "unlimited": "works"}
    trials = {words: of_kind(results, "ppo", variant, LEVEL) for words, variant in kinds.items()}
    return {words: records for words, records in trials.items() if records}


def as_it_works(holds: Holds) -> str:
    """The verdict by PPO as it works: a part of a statement, or the contrary."""
    return PARTLY if holds else one_sided(holds, decides=False)


def generalises(results: Results) -> Judgement:
    """Training on diverse terrains gives strong generalisation to new ones.

    More terrains to train on give more completed new ones.
    """
    trials = few_terrains(results)
    if not trials:
        return NOTHING
    shares = {words: results_of(records, "completion") for words, records in trials.items()}
    words = "; ".join(
        f"{name}: {Estimate.of(completions).percent()} and "
        f"{Estimate.of(results_of(trials[name], 'steps')).text(0)}"
        for name, completions in shares.items()
    )
    measured = f"as it works, completion of new terrains, and moves to 99 %, after training on so many: {words}"
    if len(shares) < 4 or min(map(len, shares.values())) < SEEDS:
        return Judgement(measured, UNDECIDED)
    holds = certainly_above(shares["unlimited"], shares["10"])
    few = Estimate.of(shares["10"])
    brief = f"after 10 terrains PPO as it works completes {few.percent()} of new ones"
    if few.low > AIM:
        brief += ", which leaves little to gain"
    return Judgement(measured, as_it_works(holds), brief)


def results_of(records: Iterable[Record], name: str) -> Floats:
    """Return a number of each training's result: float64[seeds]."""
    return np.array([record.result[name] for record in records], np.float64)


EASIEST, HARDEST = ("1-1-1", "1-1-2"), ("3-2-1", "3-2-2")
"""The levels of either end of the difficulty; d_b changes no terrain, so the two of a pair have the same."""


def moves_between(results: Results, levels: Sequence[str]) -> Floats:
    """Return the mean moves on the levels between the easiest and the hardest.

    Of each training on one of `levels`: float64[trainings].
    """
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
    """Policies of the greater difficulty do better on levels not trained on."""
    easy, hard = (moves_between(results, levels) for levels in (EASIEST, HARDEST))
    if not len(easy) or not len(hard):
        return NOTHING
    words = ", ".join(
        f"trained on {' or '.join(levels)} {Estimate.of(moves).text(1)} ({len(moves)} trainings)"
        for levels, moves in ((EASIEST, easy), (HARDEST, hard))
    )
    measured = (
        f"as it works, moves to 99 % on the levels between the easiest and the hardest: {words}"
    )
    if min(len(easy), len(hard)) < SEEDS:
        return Judgement(measured, UNDECIDED)
    return Judgement(measured, as_it_works(certainly_above(easy, hard)))


AIM = 0.9
"""Share of terrains that a policy which has learnt completes, 0..1."""
SERIOUS = 0.1
"""Loss of normalized score that counts as a serious degradation; the paper's is about 0.2 (a little above 0.6 from 0.8)."""
Trials = dict[str, list[Record]]
"""Algorithm or level -> its trials."""
PAPER_STEPS = 30 * -(-MOVES_OF_AN_UPDATE // 128)
"""Gradient steps of an update of the paper's PPO: 30 passes in batches of 128."""
LETTER = ("appendix", "paper")
"""Variants by the letter: with the paper's gradient steps (PPO alone), and in light passes."""


def of_kind(results: Results, algorithm: str, variant: str, level: str) -> list[Record]:
    """Return the trainings of one algorithm and variant on one level."""
    return results.trials(algorithm=algorithm, variant=variant, level=level, size=SIZE)


def by_the_letter(results: Results) -> list[Record]:
    """Return all trainings by the letter on the level of figure 4, of any length."""
    return [
        record
        for variant in LETTER
        for record in chosen(results.records, variant=variant, level=LEVEL, size=SIZE)
    ]


def of_ppo(results: Results, levels: Sequence[str], variant: str) -> Trials:
    """Return PPO's trials by level, empty unless each level has SEEDS of them."""
    trials = {level: of_kind(results, "ppo", variant, level) for level in levels}
    return trials if min(map(len, trials.values())) >= SEEDS else {}


def letter_of_ppo(results: Results, levels: Sequence[str]) -> Trials:
    """Return PPO's trials by the letter by level, empty unless each has SEEDS.

    Those with the paper's gradient steps where all are as long as the paper's.
    """
    whole = of_ppo(results, levels, "appendix")
    if whole and all(is_as_long(record) for records in whole.values() for record in records):
        return whole
    return of_ppo(results, levels, "paper")


def figure_4(results: Results) -> Trials:
    """Return the trials of each algorithm, empty unless all four have SEEDS of them."""
    trials = {name: of_kind(results, name, "paper", LEVEL) for name in ALGORITHMS}
    trials["ppo"] = letter_of_ppo(results, (LEVEL,)).get(LEVEL, [])
    return trials if min(map(len, trials.values())) >= SEEDS else {}


def decided(measured: str, holds: Holds, trials: Trials) -> Judgement:
    """Judge by the one-sided rule, and say the moves and gradient steps of both.

    Trainings of the paper's moves can show that a statement holds. That it does not takes its
    gradient steps too; without them the contrary is said and decides nothing.
    """
    records = [record for group in trials.values() for record in group]
    if not all(is_full(record.trial) for record in records):
        return Judgement(f"after short trainings, which decide nothing: {measured}", NOT_YET)
    needed = [is_as_long(record) and (holds or has_the_steps(record)) for record in records]
    return Judgement(f"{measured}. {lengths(trials)}", one_sided(holds, all(needed)))


def has_the_steps(record: Record) -> bool:
    """Return whether a training of PPO made as many gradient steps as the paper's.

    True for the other algorithms, whose steps the paper does not say.
    """
    if record.trial.algorithm != "ppo":
        return True
    return gradient_steps(record) >= paper_steps(record.trial)


def paper_steps(trial: Trial) -> int:
    """Return how many gradient steps the paper's PPO made in a training of a kind."""
    return paper_moves(trial) // MOVES_OF_AN_UPDATE * PAPER_STEPS


def paper_moves(trial: Trial) -> int:
    """Return how many moves the paper's training of a kind had."""
    return PAPER_MOVES[trial.algorithm] if trial.level == LEVEL else LEVEL_MOVES


def is_as_long(record: Record) -> bool:
    """Return whether a training had as many moves as the paper's of its kind."""
    return bool(record.result["moves"] >= paper_moves(record.trial))


def gradient_steps(record: Record) -> int:
    """Return a training's number of gradient steps, by the settings that it logged."""
    settings, moves = record.settings, record.result["moves"]
    if "moves_per_update" in settings:
        return int(max(0, moves - settings["learning_starts"]) // settings["moves_per_update"])
    between = settings["num_envs"] * settings["num_steps"]
    steps = -(-between // settings.get("minibatch_size", between))
    return int(moves // between * settings.get("update_epochs", 1) * steps)


def lengths(trials: Trials) -> str:
    """Return how long our trainings and the paper's are, in words.

    Of ours the first of each algorithm; gradient steps of the paper's PPO alone.
    """
    first = {
        record.trial.algorithm: record
        for records in reversed(trials.values())
        for record in records[:1]
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
    return (
        f"Moves and gradient steps of our trainings: {', '.join(ours)}; moves of the paper's: {paper}; "
        f"its PPO made {count_text(paper_steps(first['ppo'].trial))} gradient steps"
    )


def score_at(record: Record, axis: str, limit: float) -> float:
    """Return the score at the last point of a curve within a limit, NaN before any.

    axis  of the limit: "moves" or "cpu_s"
    """
    x, scores = points_of(record, "score", axis)
    return float([np.nan, *scores[x <= limit]][-1])


def scores_at(trials: Trials, axis: str | None) -> dict[str, Floats]:
    """Return algorithm -> scores of its seeds, the best algorithm first.

    axis  on which all are cut where the shortest trial has ended; None: at the end of each
    """
    end = np.inf
    if axis is not None:
        end = min(record.curve[axis][-1] or 0 for records in trials.values() for record in records)
    scores = {
        name: np.array([score_at(record, axis or "moves", end) for record in records])
        for name, records in trials.items()
    }
    return dict(sorted(scores.items(), key=lambda pair: -np.nan_to_num(pair[1].mean(), nan=-1)))


def order(scores: dict[str, Floats]) -> str:
    """Return algorithms and their scores in words, best first."""
    means = {name: Estimate.of(values) for name, values in scores.items()}
    return ", ".join(
        f"{name} {mean.text() if mean.is_known else 'too early to say'}"
        for name, mean in means.items()
    )


def best(results: Results) -> Judgement:
    """PPO achieves the highest average episodic reward."""
    trials = figure_4(results)
    if not trials:
        return NOTHING
    views = {"at the end": None, "at equal moves": "moves"}
    if is_timed_alike([record for records in trials.values() for record in records]):
        views["at equal CPU time"] = "cpu_s"
    scores = {words: scores_at(trials, axis) for words, axis in views.items()}
    wins = all_of(beats("ppo", scores["at the end"]))
    measured = "; ".join(f"{words} {order(by_name)}" for words, by_name in scores.items())
    return decided(f"score of the last episodes in training: {measured}", wins, trials)


def beats(name: str, scores: dict[str, Floats]) -> list[Holds]:
    """Return whether an algorithm is above each other; None if that is not certain."""
    return [
        certainly_above(scores[name], values) for other, values in scores.items() if other != name
    ]


def second(results: Results) -> Judgement:
    """DQN-Rainbow achieves the second-best performance."""
    trials = figure_4(results)
    if not trials:
        return NOTHING
    scores = scores_at(trials, None)
    is_above_other = beats("rainbow", scores)
    below, above = is_above_other.count(False), is_above_other.count(True)
    is_second: Holds = None
    if below > 1 or above == len(is_above_other):
        is_second = False
    elif None not in is_above_other:
        is_second = True
    return decided(f"the same at the end {order(scores)}", is_second, trials)


def half(results: Results) -> Judgement:
    """Rainbow's average is 50.04 % of PPO's."""
    trials = figure_4(results)
    if not trials:
        return NOTHING
    scores = scores_at(trials, None)
    ratio = ratio_of_means(scores["rainbow"], scores["ppo"])
    is_inside = ratio.low <= 0.5004 <= ratio.high
    holds = (True if ratio.high - ratio.low < 0.5 else None) if is_inside else False
    words = f"{ratio.mean:.3f}, and no bounded interval, since PPO's may be 0"
    if ratio.high < np.inf:
        words = ratio.span("{:.3f}")
    return decided(f"ratio of the means of these scores at the end {words}", holds, trials)


def converged(record: Record) -> int | None:
    """The moves of a training until AIM of 100 episodes were completed, None if never."""
    moves, completion = points_of(record, "explored", "moves")
    there = np.flatnonzero(completion >= AIM)
    return int(moves[there[0]]) if len(there) else None


def with_bonus(record: Record) -> float:
    """Return the last normalized score of a training as it would be on level t-m-1.

    Levels t-m-2 pay neither n nor -n for how an episode ends, so their score has another scale. The
    share of episodes that ended either way is known, so the two can be counted.
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
    """Return as many of PPO's trials on each of the 12 levels, or none.

    None until all levels have SEEDS.

    variant  "paper": as `letter_of_ppo` chooses
    """
    is_letter = variant == "paper"
    trials = (
        letter_of_ppo(results, DIFFICULTIES)
        if is_letter
        else of_ppo(results, DIFFICULTIES, variant)
    )
    count = min(map(len, trials.values()), default=0)
    return {level: records[:count] for level, records in trials.items()}


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


BY = {"paper": "by the letter", "works": "as it works"}
"""Variant -> what the summary calls it."""


@dataclass(frozen=True)
class Measured:
    """What the final values of the 12 levels say of a statement.

    words   in full
    holds   whether it holds of them
    number  the one that the summary names
    """

    words: str
    holds: Holds
    number: str


def on_levels(brief: str) -> Callable[[Callable[[Finals], Measured]], Decide]:
    """A decorator that makes a judge of a statement about the 12 levels.

    brief  a line of the summary, with a place for the numbers
    """
    return lambda measure: lambda results: judge_levels(results, measure, brief)


def judge_levels(results: Results, measure: Callable[[Finals], Measured], brief: str) -> Judgement:
    """Judge a statement about the 12 levels.

    The letter alone decides. Without it the statement is undecided, whatever PPO does as it works.
    """
    parts, numbers, judged, length = [], [], NOT_YET, ""
    for variant, words_of_variant in BY.items():
        if trials := figure_5(results, variant):
            finals = {
                name: {level: np.array([*map(of, records)]) for level, records in trials.items()}
                for name, of in ON_LEVELS.items()
            }
            measured = measure(finals)
            parts.append(f"{TITLES[variant]}: {measured.words}")
            numbers.append(f"{measured.number} {words_of_variant}")
            length = length or lengths(trials)
            if variant == "paper":
                judged = decided(measured.words, measured.holds, trials).verdict
            elif judged == NOT_YET:
                judged = one_sided(measured.holds, decides=False)
                parts[-1] += f", {AS_IT_SAYS[measured.holds]}"
    text = ". ".join([*parts, length] if length else parts)
    return Judgement(text, judged, brief.format(", ".join(numbers)) if numbers else "")


def mean_with(finals: dict[str, Floats], element: int, setting: str) -> Floats:
    """Return the mean over the levels with one setting: float64[seeds].

    element  0 d_t, 1 d_m, 2 d_b
    """
    chosen_levels = [
        scores for level, scores in finals.items() if level.split("-")[element] == setting
    ]
    return np.asarray(np.mean(chosen_levels, axis=0))


def effects(finals: Finals) -> tuple[dict[str, Floats], str]:
    """The effects of d_t, d_m and d_b on the comparable score, with words.

    The effect of an element is the highest less the lowest mean of its settings, float64[seeds].
    """
    scores, spreads = finals[COMPARABLE], {}
    for element, name in enumerate(("d_t", "d_m", "d_b")):
        settings = {level.split("-")[element] for level in scores}
        means = [mean_with(scores, element, setting) for setting in settings]
        spreads[name] = np.ptp(means, axis=0)
    words = ", ".join(f"{name} {Estimate.of(spread).text()}" for name, spread in spreads.items())
    return spreads, f"spread of the {COMPARABLE} between its values: {words}"


def larger(spreads: dict[str, Floats], pairs: Sequence[tuple[str, str]]) -> tuple[str, Holds]:
    """Return by how much the first effect of a pair is larger than the second.

    Of each pair, in words, and whether all are larger with certainty.
    """
    words = ", ".join(
        f"{a} less {b} {Estimate.of(spreads[a] - spreads[b]).text()}" for a, b in pairs
    )
    return (
        f"by seed: {words}",
        all_of(above_by_seed(spreads[a], spreads[b]) for a, b in pairs),
    )


@on_levels("it changes the score by {}")
def morphology_first(finals: Finals) -> Measured:
    """d_m has the largest effect on the learned policy."""
    spreads, words = effects(finals)
    differences, holds = larger(spreads, [("d_m", "d_t"), ("d_m", "d_b")])
    return Measured(f"{words}; {differences}", holds, Estimate.of(spreads["d_m"]).text())


@on_levels(f"d_m = 2 costs {{}}; {SERIOUS} counts as serious")
def morphology_degrades(finals: Finals) -> Measured:
    """With d_m = 1 the policies perform best, and d_m = 2 degrades them seriously."""
    small, large = (mean_with(finals[COMPARABLE], 1, setting) for setting in ("1", "2"))
    is_serious = above_by_seed(small, large, SERIOUS)
    size = {True: "more than", False: "less than", None: "not certainly more or less than"}
    of_loss = "a certain loss" if above_by_seed(small, large) else "a loss"
    one, two, loss = (Estimate.of(scores).text() for scores in (small, large, small - large))
    words = (
        f"final score with the bonus counted everywhere {one} with d_m = 1, {two} with d_m = 2: "
        f"{of_loss} of {loss}, {size[is_serious]} the {SERIOUS} that counts as serious"
    )
    return Measured(words, is_serious, loss)


@on_levels("it is {}")
def hardest(finals: Finals) -> Measured:
    """With d_m = 2 and d_t = 3 the final performance is a little above 0.6."""
    means = {level: Estimate.of(finals["score"][level]) for level in ("3-2-1", "3-2-2")}
    words = ", ".join(f"{level} {mean.text()}" for level, mean in means.items())
    holds = all_of(is_within(mean, 0.6, 0.7) for mean in means.values())
    both = " and ".join(f"{mean.mean:.3f}" for mean in means.values())
    return Measured(f"final score: {words}", holds, both)


def is_within(score: Estimate, low: float, high: float) -> Holds:
    """Return whether a score lies in low..high, None if its interval crosses an end."""
    if low <= score.low and score.high < high:
        return True
    return False if score.high < low or score.low >= high else None


@on_levels("it changes the score by {}")
def bonus_little(finals: Finals) -> Measured:
    """d_b does not affect the overall performance much."""
    spreads, _ = effects(finals)
    differences, holds = larger(spreads, [("d_t", "d_b"), ("d_m", "d_b")])
    words = f"the spreads of `morphology-first`; {differences}"
    return Measured(words, holds, Estimate.of(spreads["d_b"]).text())


NONE_YET = "No such trainings are shipped yet."
WITHOUT = ("works", "tuned")
"""The variants from which a change can be taken out."""
STARTS = (*(f"{variant}-no-" for variant in WITHOUT), "paper+", "paper-no-")
"""What the names of variants begin with that leave a change out, make it alone, and leave a part of the paper's out."""


def completion(results: Results, algorithm: str, variant: str) -> Estimate:
    """Return the completion on held-out terrains, UNKNOWN without a training."""
    return Estimate.of(results_of(of_kind(results, algorithm, variant, LEVEL), "completion"))


def trained(results: Results) -> str:
    """Return the table of figure 4's policies: by the letter, as they work, and tuned."""
    records = [
        record
        for variant in (*TITLES, "appendix")
        for record in chosen(results.records, variant=variant, level=LEVEL, size=SIZE)
    ]
    rows = [cells_of(row) for row in rows_of(records)]
    return without_constants(TABLE_COLUMNS, rows) if rows else NONE_YET


def levels_in_short(results: Results) -> str:
    """What PPO reaches on the 12 levels, by the letter and as it works, in words."""
    letter, works = (figure_5(results, variant) for variant in ("paper", "works"))
    if not letter or not works:
        return NONE_YET
    shares: dict[str, list[float]] = {"1": [], "2": []}
    for level, records in letter.items():
        shares[level[2]].append(_mean(records, "coverage"))
    (first, *_), *_ = letter.values()
    ratios = [
        _mean(records, "steps") / _mean(records, "best_rule_steps") for records in works.values()
    ]
    harder = [
        _mean(works[level.replace("-1-", "-2-", 1)], "steps") - _mean(records, "steps")
        for level, records in works.items()
        if level[2] == "1"
    ]
    by_letter, as_works = (
        low_to_high([_mean(records, "completion") for records in trials.values()], per_cent)
        for trials in (letter, works)
    )
    return fill(
        f"By the letter, each training on a level has {count_text(first.result['moves'])} moves and "
        f"{count_text(gradient_steps(first))} gradient steps, and completes {by_letter} of the terrains; "
        f"it covers {low_to_high(shares['1'], per_cent)} of the cells where obstacles are small (d_m = 1), "
        f"{low_to_high(shares['2'], per_cent)} where they are large. As it works, it completes {as_works} of a level's "
        f"terrains, in {low_to_high(ratios)} of the "
        f"better rule's moves; large obstacles cost it {low_to_high(harder, '{:.0f}'.format)} moves more.",
        110,
        break_on_hyphens=False,
    )


def millions(results: Results) -> str:
    """Why "millions of time steps" (2.5) has no verdict, and what was measured."""
    works = []
    for name in NAMES:
        ends = [converged(record) for record in of_kind(results, name, "works", LEVEL)]
        moves_to_aim = [moves for moves in ends if moves is not None]
        if moves_to_aim and len(moves_to_aim) == len(ends):
            works.append(f"{NAMES[name]} {count_text(max(moves_to_aim))}")
    letter = by_the_letter(results)
    if not works or not letter:
        return NONE_YET
    reached = sum(converged(record) is not None for record in letter)
    return fill(
        "That algorithms usually need millions of time steps to converge (2.5) is said of reinforcement learning "
        f"in general and not judged; here, as it works, all seeds have completed {per_cent(AIM)} of their last 100 "
        f"episodes after at most {', '.join(works)} moves, and by the letter {reached} of {len(letter)} trainings "
        "ever have.",
        110,
        break_on_hyphens=False,
    )


def _mean(records: Sequence[Record], name: str) -> float:
    return float(results_of(records, name).mean())


def changes_of(results: Results, algorithm: str) -> list[str]:
    """Return the changes that trainings of an algorithm leave out, or make alone."""
    trials = [record.trial for record in results.records if record.trial.algorithm == algorithm]
    variants = {trial.variant for trial in trials}
    changes = {
        variant.removeprefix(start)
        for variant in variants
        for start in STARTS
        if variant.startswith(start)
    }
    return sorted(change for change in changes if "+" not in change)


def ablations(results: Results) -> str:
    """Return what each change does to completion, as a table.

    Of each algorithm the change whose lack costs most is first.
    """
    rows: list[tuple[str, float, list[str]]] = []
    for name in ALGORITHMS:
        whole = [completion(results, name, variant) for variant in WITHOUT]
        for change in changes_of(results, name):
            others = [completion(results, name, start + change) for start in STARTS]
            losses = [both.mean - one.mean for both, one in zip(whole, others, strict=False)]
            lost = max((loss for loss in losses if not isnan(loss)), default=0.0)
            used = (of_kind(results, name, start + change, LEVEL) for start in STARTS)
            sizes = [
                f"{len(records)} x {records[0].trial.terrains}, {count_text(records[0].trial.moves)}"
                for records in used
                if records
            ]
            shares = (share.percent() if share.is_known else "" for share in others)
            cells = [f"`{change}`", *shares, "; ".join(dict.fromkeys(sizes))]
            rows.append((NAMES[name], -lost, cells))
    columns = ("algorithm", "change", "works without it", "tuned without it")
    alone = ("the letter with it alone", "the letter without it", "seeds x terrains, moves")
    rows.sort(key=lambda row: row[:2])
    table = [[name, *cells] for name, _, cells in rows]
    return markdown_table((*columns, *alone), table) if table else NONE_YET


@cache
def constant_actions() -> dict[str, dict[str, float]]:
    """Return action -> the shares of a result of a policy that makes no other move.

    On the terrains of the measurements.
    """
    config, results = EnvConfig.of(LEVEL, SIZE), {}
    for action, name in enumerate(ACTIONS):
        ends = []
        for seed in range(EVALUATION_SEEDS.start, EVALUATION_SEEDS.start + HELD_OUT_TERRAINS):
            episode = Episode.begin(config, seed=seed)
            while not episode.ended:
                episode.step(action)
            ends.append((episode.coverage, episode.outcome))
        shares = {end: sum(outcome == end for _, outcome in ends) / len(ends) for end in ENDINGS}
        coverage = round(float(np.mean([share for share, _ in ends])), 4)
        results[name] = {"coverage": coverage, **shares}
    return results


def became(results: Results) -> str:
    """How many trainings by the letter became a constant action, in words."""
    ended = [record for record in by_the_letter(results) if "collided" in record.result]
    constant: Counter[str] = Counter()
    for record in ended:
        same = [
            name
            for name, figures in constant_actions().items()
            if all(record.result.get(key) == share for key, share in figures.items())
        ]
        if same:
            constant[f"{NAMES[record.trial.algorithm]} always {same[0]}"] += 1
    words = ", ".join(f"{name} {count}" for name, count in sorted(constant.items()))
    trainings = "training" if len(ended) == 1 else "trainings"
    return f"Of {len(ended)} {trainings} by the letter, {constant.total()} became a constant move: {words or 'none'}."


def unfinished(results: Results) -> str:
    """Return how far the trainings are that are not finished, as a table."""
    rows = []
    for progress in results.unfinished:
        trial, line = progress["trial"], progress["line"]
        name = f"{NAMES[trial.algorithm]} {trial.variant}"
        far = f"{count_text(progress['moves'])} of {count_text(trial.moves)}"
        shares = (f"{line[column]:.3f}" if line else "" for column in ("coverage", "explored"))
        rows.append([name, str(trial.seed), far, *shares])
    columns = ("training", "seed", "moves", "coverage as trained", "completion as trained")
    return markdown_table(columns, rows) if rows else "None is under way."


BLOCKS: dict[str, Callable[[Results], str]] = {
    "trained policies": trained,
    "levels in short": levels_in_short,
    "millions": millions,
    "ablations": ablations,
    "became": became,
    "unfinished": unfinished,
    "difference in short": lambda results: answers.in_short(results.trainings),
    "difference": lambda results: answers.table(results.trainings),
    "reasons": lambda results: answers.reasons(results.trainings),
}
"""Name of a drawn block of the document -> what draws it."""
