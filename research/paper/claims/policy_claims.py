"""The paper's claims about the trained policy (figures 6, 7), from episodes.

The paper's policy is what PPO learnt. Policies whose name begins with LETTER were trained by the
letter of the paper, for as many moves. All others whose name begins with LEARNT were trained by PPO
with other settings, or for less, as the shipped `ppo-paper` was. A claim is reproduced when it
holds everywhere for a policy of the first kind. It is reproduced in part when it holds somewhere
for any, and each is named with its numbers. Where it holds for none it is undecided: those by the
letter made a twentieth of the paper's gradient steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import nan
from typing import TypeVar

from marsexplorer.evaluation import RULES
from research.paper.claims.results import (
    NOTHING,
    PARTLY,
    REPRODUCED,
    UNDECIDED,
    Decide,
    Judgement,
    Results,
    partly,
)
from research.paper.episodes.play import DIFFICULTIES
from research.paper.episodes.quadrants import (
    QuadrantCourse,
    Rate,
    course_rates,
    obstacles_of,
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
from research.paper.tables import Estimate, low_to_high, per_cent

DENSEST = ("3-2-1", "3-2-2")
LEARNT, LETTER = "ppo", "ppo-paper-"
SIZES = (42, 84)
LEVEL = "2-2-1"
Played = TypeVar("Played")
Judge = Callable[[Played], tuple[str, list[bool]]]
"""The results of a policy -> its numbers in words, and where the claim holds."""


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


def decided(
    measure: str, results: Mapping[str, Played], judge: Judge[Played], others: Sequence[str] = ()
) -> Judgement:
    """The judgement on a claim about policies, NOTHING without one.

    Args:
        measure: What is measured, in words.
        results: By policy.
        judge: Judges the results of one policy.
        others: Sentences that follow the policies' numbers.
    """
    if not results:
        return NOTHING
    judged = {policy: judge(played) for policy, played in results.items()}
    somewhere = PARTLY if any(any(held) for _, held in judged.values()) else UNDECIDED
    whole = any(all(held) for policy, (_, held) in judged.items() if policy.startswith(LETTER))
    words = [*(f"`{policy}` {text}" for policy, (text, _) in judged.items()), *others]
    return Judgement(f"{measure}: {'; '.join(words)}", REPRODUCED if whole else somewhere)


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

    def judge(by_level: dict[str, Line]) -> tuple[str, list[bool]]:
        rates = {level: never_back(line) for level, line in by_level.items()}
        held = [
            rate.low
            > max([0.5, *(by_rule[level].high for by_rule in rules.values() if level in by_rule)])
            for level, rate in rates.items()
        ]
        shares = low_to_high([rate.mean for rate in rates.values()], per_cent)
        return f"{shares} and {sum(held)}", held

    others = [
        f"`{rule}` {low_to_high([rate.mean for rate in by_rule.values()] or [nan], per_cent)}"
        for rule, by_rule in rules.items()
    ]
    others += [
        f"walks by `{walk['null']}` {per_cent(never_back(walk).mean)}" for walk in results.walks
    ]
    measure = (
        "share of a U without going back on a level, and levels where it is a majority and above "
        "both rules"
    )
    return decided(measure, learners(results.plays[6]), judge, others)


@of_learners("share of a level's episodes in the commonest order of quadrants")
def same_family(by_level: dict[str, Line]) -> tuple[str, list[bool]]:
    """The same family of trajectories was generated in all cases, with confidence."""
    orders = [
        [QuadrantCourse.of_code(code).entered for code in line["courses"]]
        for line in by_level.values()
    ]
    every = [order for level_orders in orders for order in level_orders]
    common = max(set(every), key=every.count)
    shares = [level_orders.count(common) / len(level_orders) for level_orders in orders]
    return low_to_high(shares, per_cent), [share > 0.9 for share in shares]


@of_learners("shares of the episodes there that collided and were completed")
def dexterous(by_level: dict[str, Line]) -> tuple[str, list[bool]]:
    """The policy adapts to obstacles and avoids encounters, also on 3-2-1 and 3-2-2."""
    crashed, explored = (
        [
            by_level[level]["outcomes"].get(outcome, 0) / by_level[level]["played"]
            for level in DENSEST
        ]
        for outcome in ("collided", "explored")
    )
    pairs = zip(crashed, explored, strict=True)
    return f"{low_to_high(crashed, per_cent)} and {low_to_high(explored, per_cent)}", [
        a < 0.05 and b > 0.9 for a, b in pairs
    ]


@of_learners("correlation, and levels of 12 without blind spots")
def no_blind_spots(by_level: dict[str, Line]) -> tuple[str, list[bool]]:
    """The obstacles that a policy discovers match the drawn distribution."""
    matches = [obstacles_of(line) for line in by_level.values()]
    held = [not match.blind_spots for match in matches]
    return f"{low_to_high([match.correlation for match in matches])} and {sum(held)}", held


def discovered(results: Results) -> Judgement:
    """The same, after the finding of a rule's check."""
    policies, check = no_blind_spots(results), results.checks.get("discovered-obstacles")
    parts = [check["measured"] if check else "", policies.measured]
    return Judgement("; ".join(filter(None, parts)), policies.verdict)


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

    def judge(policy: str) -> tuple[str, list[bool]]:
        ratios = [[to_better_rule(group, policy, share) for share in PER_CENT] for group in groups]
        held = [ratio.high < 1 for group_ratios in ratios for ratio in group_ratios]
        texts = (
            " ".join(f"{ratio.mean:.2f}" if ratio.is_known else "none" for ratio in group_ratios)
            for group_ratios in ratios
        )
        return f"{' and '.join(texts)}, less with certainty at {sum(held)} of 10", held

    measure = (
        f"moves over the better rule's to {', '.join(map(str, PER_CENT))} % at 42x42 and 84x84"
    )
    return decided(measure, {policy: policy for policy in scaled(results)[0]}, judge)


def to_better_rule(group: Mapping[str, Line], policy: str, share: int) -> Estimate:
    """A policy's moves to a share of the cells over those of the better rule there."""
    rules = (group[rule] for rule in RULES)
    better = min(rules, key=lambda line: float(steps_of(line, share).mean()))
    return compare(group[policy], better, share)


def last_shares(rows: Sequence[ScaleRow]) -> str:
    """The share of the moves that the last per cents take, in words."""
    return " and ".join(row.last_share.percent() for row in rows)


def knee(results: Results) -> Judgement:
    """The rules have a knee: distant parts are left for the end."""
    _, rules = scaled(results)
    if not rules:
        return NOTHING
    held = [row.last_share.low > CONSTANT_PACE for rows in rules.values() for row in rows]
    measure = f"share of the moves from 90 to 99 % of coverage ({per_cent(CONSTANT_PACE)} at a constant pace), 42x42 and 84x84"
    words = (f"`{policy}` {last_shares(rows)}" for policy, rows in rules.items())
    return Judgement(f"{measure}: {'; '.join(words)}", partly(held))


def no_knee(results: Results) -> Judgement:
    """PPO has no such knee."""
    learnt, rules = scaled(results)

    def judge(rows: list[ScaleRow]) -> tuple[str, list[bool]]:
        pairs = zip(rows, *rules.values(), strict=True)
        held = [
            all(row.last_share.high < rule.last_share.low for rule in rules_there)
            for row, *rules_there in pairs
        ]
        return last_shares(rows), held

    return decided("the same share", learnt, judge)


def scales(results: Results) -> Judgement:
    """Learning extends to larger terrains: it completes them as fast as the rules."""

    def judge(rows: list[ScaleRow]) -> tuple[str, list[bool]]:
        ratios = (f"{row.to_rule.mean:.2f}" if row.to_rule.is_known else "no" for row in rows)
        texts = (
            f"{per_cent(row.completion)} in {ratio}"
            for row, ratio in zip(rows, ratios, strict=True)
        )
        completes = [row.completion > 0.9 for row in rows]
        return " and ".join(texts), completes + [row.to_rule.low < 1 for row in rows]

    measure = "terrains completed, in how many of the better rule's moves, at 42x42 and 84x84"
    return decided(measure, scaled(results)[0], judge)
