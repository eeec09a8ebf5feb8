"""The paper's claims about the trained policy (figures 6, 7), from episodes.

The paper's policy is what PPO learnt. Policies whose name begins with LETTER were trained by the
letter of the paper, for as many moves; with FULL, for as many gradient steps too. Each is a seed,
and SEEDS of them are judged together. All others whose name begins with LEARNT were trained by PPO
with other settings, or for less, as the shipped `ppo-paper` was. See `verdict_on` for what each can
show.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

from marsexplorer.evaluation import RULES
from marsexplorer.intervals import wilson_interval
from research.paper.claims.results import (
    NOTHING,
    PARTLY,
    REPRODUCED,
    Decide,
    Holds,
    Judgement,
    Results,
    all_of,
    one_sided,
    partly,
    surpasses,
)
from research.paper.episodes.play import DIFFICULTIES
from research.paper.episodes.quadrants import (
    QuadrantCourse,
    Rate,
    course_rates,
    obstacles_of,
    rate_of,
)
from research.paper.episodes.scale import (
    PER_CENT,
    ScaleRow,
    compare,
    group_by_place,
    scale_rows,
    steps_of,
)
from research.paper.figures.figure7 import CONSTANT_PACE
from research.paper.jobs import Line
from research.paper.plan import SEEDS
from research.paper.tables import Estimate, low_to_high, per_cent

DENSEST = ("3-2-1", "3-2-2")
LEARNT, LETTER, FULL = "ppo", "ppo-paper-", "ppo-appendix-"
SIZES = (42, 84)
LEVEL = "2-2-1"
FEW, MOST = 0.05, 0.9
"""What counts as few and as most of the episodes, 0..1."""
Played = TypeVar("Played")
Judge = Callable[[Played], tuple[str, Sequence[Holds]]]
"""The results of a policy -> its numbers in words, and whether the claim holds, place by place."""


def learners(lines: Sequence[Line]) -> dict[str, dict[str, Line]]:
    """Policy -> level -> result of figure 6, of PPO's policies.

    Only policies that played all of the paper's 12 levels.
    """
    by_policy: dict[str, dict[str, Line]] = {}
    for line in lines:
        if line["policy"].startswith(LEARNT) and line["level"] in DIFFICULTIES:
            by_policy.setdefault(line["policy"], {})[line["level"]] = line
    return {
        policy: by_level
        for policy, by_level in by_policy.items()
        if len(by_level) == len(DIFFICULTIES)
    }


def of_all_seeds(places: Mapping[str, Sequence[Holds]], kind: str) -> list[Holds]:
    """Whether a claim holds for all seeds of a kind of policy, place by place.

    None at a place where they differ, and for fewer than SEEDS of them.

    kind  LETTER or FULL
    """
    seeds = [held for policy, held in places.items() if policy.startswith(kind)]
    if len(seeds) < SEEDS:
        return [None]
    return [held[0] if len({*held}) == 1 else None for held in zip(*seeds, strict=True)]


def verdict_on(places: Mapping[str, Sequence[Holds]]) -> str:
    """The verdict on a claim by the policies for which it holds, place by place."""
    # 1. All seeds with the paper's gradient steps decide, either way.
    with_steps = of_all_seeds(places, FULL)
    if False in with_steps or None not in with_steps:
        return partly(with_steps)

    # 2. Those with fewer steps can show that it holds, any other policy that it does in part.
    if all(of_all_seeds(places, LETTER)):
        return REPRODUCED
    if any(any(held) for held in places.values()):
        return PARTLY

    # 3. Where it fails for every policy, that is said and decides nothing.
    always_fails = all(all_of(held) is False for held in places.values())
    return one_sided(False if always_fails else None, decides=False)


def decided(
    measure: str,
    results: Mapping[str, Played],
    judge: Judge[Played],
    others: Sequence[str] = (),
    brief: str = "",
) -> Judgement:
    """The judgement on a claim about policies, NOTHING without one.

    Args:
        measure: What is measured, in words.
        results: By policy.
        judge: Judges the results of one policy.
        others: Sentences that follow the policies' numbers.
        brief: For the summary, after where the claim holds if it does in part.
    """
    if not results:
        return NOTHING
    judged = {policy: judge(played) for policy, played in results.items()}
    places = {policy: held for policy, (_, held) in judged.items()}
    words = [*(f"`{policy}` {text}" for policy, (text, _) in judged.items()), *others]
    verdict = verdict_on(places)
    there = ", ".join(
        f"`{policy}` {held.count(True)} of {len(held)}"
        for policy, held in places.items()
        if any(held) and verdict == PARTLY
    )
    return Judgement(
        f"{measure}: {'; '.join(words)}", verdict, "; ".join(filter(None, [there, brief]))
    )


def of_learners(measure: str) -> Callable[[Judge[dict[str, Line]]], Decide]:
    """A decorator that makes a claim about figure 6 of a `Judge` of results by level."""
    return lambda judge: lambda results: decided(measure, learners(results.plays[6]), judge)


def never_back(line: Line) -> Rate:
    """How often a policy or a walk visits the quadrants in a U and never goes back."""
    return course_rates(line)[1]


def hilbert(results: Results) -> Judgement:
    """The pattern is the first order of the Hilbert curve."""
    if not results.walks:
        return NOTHING
    rules = {
        rule: {
            line["level"]: never_back(line) for line in results.plays[6] if line["policy"] == rule
        }
        for rule in RULES
    }

    def judge(by_level: dict[str, Line]) -> tuple[str, list[Holds]]:
        rates = {level: never_back(line) for level, line in by_level.items()}
        held = []
        for level, rate in rates.items():
            of_rules = [by_rule[level] for by_rule in rules.values() if level in by_rule]
            low = max([0.5, *(rule.low for rule in of_rules)])
            high = max([0.5, *(rule.high for rule in of_rules)])
            held.append(surpasses(ends(rate), (low, high)))
        shares = low_to_high([rate.mean for rate in rates.values()], per_cent)
        return f"{shares} and {held.count(True)}", held

    others = [
        f"`{rule}` {low_to_high([rate.mean for rate in by_rule.values()], per_cent)}"
        for rule, by_rule in rules.items()
        if by_rule
    ]
    others += [
        f"walks by `{walk['null']}` {per_cent(never_back(walk).mean)}" for walk in results.walks
    ]
    measure = (
        "share of a U without going back on a level, and levels where it is a majority and above "
        "both rules"
    )
    return decided(measure, learners(results.plays[6]), judge, others)


@of_learners(
    f"share of a level's episodes in the commonest order of quadrants, with certainty above {per_cent(MOST)}"
)
def same_family(by_level: dict[str, Line]) -> tuple[str, Sequence[Holds]]:
    """The same family of trajectories was generated in all cases, with confidence."""
    orders = [
        [QuadrantCourse.of_code(code).entered for code in line["courses"]]
        for line in by_level.values()
    ]
    every = [order for level_orders in orders for order in level_orders]
    common = max(set(every), key=every.count)
    shares = [rate_of(order == common for order in level_orders) for level_orders in orders]
    held = [surpasses(ends(share), (MOST, MOST)) for share in shares]
    return f"{low_to_high([share.mean for share in shares], per_cent)} and {held.count(True)}", held


@of_learners("shares of the episodes there that collided and were completed")
def dexterous(by_level: dict[str, Line]) -> tuple[str, Sequence[Holds]]:
    """The policy adapts to obstacles and avoids encounters, also on 3-2-1 and 3-2-2."""
    shares, held = [], []
    for line in (by_level[level] for level in DENSEST):
        counts = [line["outcomes"].get(outcome, 0) for outcome in ("collided", "explored")]
        crashed, explored = (wilson_interval(count, line["played"]) for count in counts)
        shares.append([count / line["played"] for count in counts])
        held.append(all_of([surpasses((FEW, FEW), crashed), surpasses(explored, (MOST, MOST))]))
    texts = (low_to_high(of_outcome, per_cent) for of_outcome in zip(*shares, strict=True))
    return " and ".join(texts), held


@of_learners("correlation, and levels of 12 without blind spots")
def no_blind_spots(by_level: dict[str, Line]) -> tuple[str, Sequence[Holds]]:
    """The obstacles that a policy discovers match the drawn distribution."""
    matches = [obstacles_of(line) for line in by_level.values()]
    held = [not match.blind_spots for match in matches]
    return f"{low_to_high([match.correlation for match in matches])} and {sum(held)}", held


def discovered(results: Results) -> Judgement:
    """The same, after the finding of a rule's check."""
    policies, check = no_blind_spots(results), results.checks.get("discovered-obstacles")
    parts = [check["measured"] if check else "", policies.measured]
    return Judgement("; ".join(filter(None, parts)), policies.verdict, policies.brief)


def scaled(results: Results) -> tuple[dict[str, list[ScaleRow]], dict[str, list[ScaleRow]]]:
    """(learners, rules): policy -> its rows at 42 and 84 on 2-2-1.

    Only policies with both sizes. Both are empty unless both rules are there.
    """
    rows: dict[str, list[ScaleRow]] = {}
    for row in sorted(scale_rows(results.plays[7]), key=lambda row: row.size):
        if row.level == LEVEL and row.size in SIZES:
            rows.setdefault(row.policy, []).append(row)
    whole = {policy: sizes for policy, sizes in rows.items() if len(sizes) == len(SIZES)}
    if not whole.keys() >= {*RULES}:
        return {}, {}
    return (
        {policy: sizes for policy, sizes in whole.items() if policy.startswith(LEARNT)},
        {policy: sizes for policy, sizes in whole.items() if policy in RULES},
    )


def less_distance(results: Results) -> Judgement:
    """PPO travels less distance than the rules to explore the same share of terrain."""
    places = group_by_place(results.plays[7])
    groups = [places.get((LEVEL, size), {}) for size in SIZES]

    def judge(policy: str) -> tuple[str, list[Holds]]:
        ratios = [[to_better_rule(group, policy, share) for share in PER_CENT] for group in groups]
        held = [
            surpasses((1.0, 1.0), ends(ratio)) for group_ratios in ratios for ratio in group_ratios
        ]
        texts = (
            " ".join(f"{ratio.mean:.2f}" if ratio.is_known else "none" for ratio in group_ratios)
            for group_ratios in ratios
        )
        return f"{' and '.join(texts)}, less with certainty at {held.count(True)} of 10", held

    measure = (
        f"moves over those of the better of our two rules to {', '.join(map(str, PER_CENT))} % at "
        "42x42 and 84x84"
    )
    learnt = [*scaled(results)[0]]
    last = [to_better_rule(group, policy, PER_CENT[-1]) for group in groups for policy in learnt]
    ratios = known_means(last)
    brief = ""
    if ratios:
        brief = f"to {PER_CENT[-1]} % in {low_to_high(ratios)} of the better rule's moves"
    return decided(measure, {policy: policy for policy in learnt}, judge, brief=brief)


def known_means(estimates: Iterable[Estimate]) -> list[float]:
    """The means that are known, for the summary."""
    return [estimate.mean for estimate in estimates if estimate.is_known]


def to_better_rule(group: Mapping[str, Line], policy: str, share: int) -> Estimate:
    """A policy's moves to a share of the cells over those of the better rule there."""
    rules = (group[rule] for rule in RULES)
    better = min(rules, key=lambda line: float(steps_of(line, share).mean()))
    return compare(group[policy], better, share)


def ends(estimate: Estimate) -> tuple[float, float]:
    """The ends of an interval, as `surpasses` takes them."""
    return estimate.low, estimate.high


def last_shares(rows: Sequence[ScaleRow]) -> str:
    """The share of the moves that the last per cents take, in words."""
    return " and ".join(row.last_share.percent() for row in rows)


def knee(results: Results) -> Judgement:
    """The rules have a knee: distant parts are left for the end."""
    _, rules = scaled(results)
    if not rules:
        return NOTHING
    pace = (CONSTANT_PACE, CONSTANT_PACE)
    held = [surpasses(ends(row.last_share), pace) for rows in rules.values() for row in rows]
    measure = f"share of the moves from 90 to 99 % of coverage ({per_cent(CONSTANT_PACE)} at a constant pace), 42x42 and 84x84"
    words = (f"`{policy}` {last_shares(rows)}" for policy, rows in rules.items())
    return Judgement(f"{measure}: {'; '.join(words)}", partly(held))


def no_knee(results: Results) -> Judgement:
    """PPO has no such knee."""
    learnt, rules = scaled(results)

    def judge(rows: list[ScaleRow]) -> tuple[str, list[Holds]]:
        held = [
            all_of(surpasses(ends(rule.last_share), ends(row.last_share)) for rule in rules_there)
            for row, *rules_there in zip(rows, *rules.values(), strict=True)
        ]
        return last_shares(rows), held

    ours, theirs = (
        known_means(row.last_share for rows in rows_of.values() for row in rows)
        for rows_of in (learnt, rules)
    )
    brief = ""
    if ours and theirs:
        shares = (low_to_high(means, per_cent) for means in (ours, theirs))
        brief = "from 90 to 99 % PPO makes {} of its moves, the rules {}".format(*shares)
    return decided("the same share", learnt, judge, brief=brief)


def scales(results: Results) -> Judgement:
    """Learning extends to larger terrains: it completes them, faster than the rules."""

    def judge(rows: list[ScaleRow]) -> tuple[str, Sequence[Holds]]:
        ratios = (f"{row.to_rule.mean:.2f}" if row.to_rule.is_known else "no" for row in rows)
        texts = (
            f"{per_cent(row.completion)} in {ratio}"
            for row, ratio in zip(rows, ratios, strict=True)
        )
        completions = [
            wilson_interval(round(row.completion * row.terrains), row.terrains) for row in rows
        ]
        completes = [surpasses(completion, (MOST, MOST)) for completion in completions]
        is_faster = [surpasses((1.0, 1.0), ends(row.to_rule)) for row in rows]
        return " and ".join(texts), completes + is_faster

    measure = "terrains completed, in how many of the better rule's moves, at 42x42 and 84x84"
    learnt = scaled(results)[0]
    ratios = known_means(row.to_rule for rows in learnt.values() for row in rows)
    brief = f"completed in {low_to_high(ratios)} of the better rule's moves" if ratios else ""
    return decided(measure, learnt, judge, brief=brief)
