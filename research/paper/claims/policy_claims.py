"""What the paper says of the trained policy (figures 6 and 7), measured from the episodes that policies played.

The paper speaks of the policy that PPO learnt. Policies whose name begins with LETTER were trained by the letter of the paper,
for as many moves. All others whose name begins with LEARNT were trained by PPO with other settings, or for less, as the shipped
`ppo-paper` was. A claim is reproduced when it holds everywhere for a policy of the first kind. It is reproduced in part when it
holds somewhere for any, and each is named with its numbers. Where it holds for none it is undecided: those by the letter made a
twentieth of the paper's gradient steps.
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
from research.paper.tables import Estimate

DENSEST = ("3-2-1", "3-2-2")
LEARNT, LETTER = "ppo", "ppo-paper-"
SIZES = (42, 84)
LEVEL = "2-2-1"
Own = TypeVar("Own")
Judge = Callable[[Own], tuple[str, list[bool]]]
"""What there is of a policy -> its numbers in words, and where the claim holds."""


def learners(lines: Sequence[Line]) -> dict[str, dict[str, Line]]:
    """Return policy -> level -> result of figure 6, for those that stand for the paper's and played all of its 12 levels."""
    found: dict[str, dict[str, Line]] = {}
    for line in lines:
        if line["policy"].startswith(LEARNT) and line["level"] in DIFFICULTIES:
            found.setdefault(line["policy"], {})[line["level"]] = line
    return {policy: own for policy, own in found.items() if len(own) == len(DIFFICULTIES)}


def span(shares: Sequence[float]) -> str:
    """Return the range of shares in words."""
    low, high = f"{min(shares):.2f}", f"{max(shares):.2f}"
    return low if low == high else f"{low} to {high}"


def decided(
    what: str, own: Mapping[str, Own], judge: Judge[Own], others: Sequence[str] = ()
) -> Judgement:
    """Return the judgement on a claim about policies, NOTHING without one; `others` is said after what is measured of them."""
    if not own:
        return NOTHING
    found = {policy: judge(each) for policy, each in own.items()}
    somewhere = PARTLY if any(any(held) for _, held in found.values()) else UNDECIDED
    whole = any(all(held) for policy, (_, held) in found.items() if policy.startswith(LETTER))
    words = [*(f"`{policy}` {text}" for policy, (text, _) in found.items()), *others]
    return Judgement(f"{what}: {'; '.join(words)}", REPRODUCED if whole else somewhere)


def of_learners(what: str) -> Callable[[Judge[dict[str, Line]]], Decide]:
    """Return what makes a claim about figure 6 of `judge`, which is given a policy's results by level."""
    return lambda judge: lambda results: decided(what, learners(results.plays[6]), judge)


def never_back(line: Line) -> Rate:
    """Return how often a policy or a walk visits the quadrants in a U and never goes back."""
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

    def judge(own: dict[str, Line]) -> tuple[str, list[bool]]:
        rates = {level: never_back(line) for level, line in own.items()}
        held = [
            rate.low > max([0.5, *(of[level].high for of in rules.values() if level in of)])
            for level, rate in rates.items()
        ]
        shares = span([rate.mean for rate in rates.values()])
        return f"{shares}, a majority and above both rules on {sum(held)}", held

    others = [
        f"`{rule}` {span([rate.mean for rate in of.values()] or [nan])}"
        for rule, of in rules.items()
    ]
    others += [f"walks by `{walk['null']}` {never_back(walk).mean:.2f}" for walk in results.walks]
    what = "share of a U without going back on a level"
    return decided(what, learners(results.plays[6]), judge, others)


@of_learners("share of a level's episodes in the commonest order of quadrants")
def same_family(own: dict[str, Line]) -> tuple[str, list[bool]]:
    """The same family of trajectories was generated in all cases and with great confidence."""
    orders = [
        [QuadrantCourse.of_code(code).entered for code in line["courses"]] for line in own.values()
    ]
    every = [order for each in orders for order in each]
    common = max(set(every), key=every.count)
    shares = [each.count(common) / len(each) for each in orders]
    return span(shares), [share > 0.9 for share in shares]


@of_learners("shares of the episodes there that collided and were completed")
def dexterous(own: dict[str, Line]) -> tuple[str, list[bool]]:
    """The policy adapts to obstacles and avoids encounters, also on 3-2-1 and 3-2-2."""
    crashed, explored = (
        [own[level]["outcomes"].get(outcome, 0) / own[level]["played"] for level in DENSEST]
        for outcome in ("collided", "explored")
    )
    pairs = zip(crashed, explored, strict=True)
    return f"{span(crashed)} and {span(explored)}", [a < 0.05 and b > 0.9 for a, b in pairs]


@of_learners("correlation, and levels of 12 without blind spots")
def no_blind_spots(own: dict[str, Line]) -> tuple[str, list[bool]]:
    """The arrangement of the obstacles that a policy discovers matches the drawn distribution."""
    found = [obstacles_of(line) for line in own.values()]
    held = [not each.blind_spots for each in found]
    return f"{span([each.correlation for each in found])} and {sum(held)}", held


def discovered(results: Results) -> Judgement:
    """The same, with what the check of a rule found in front."""
    policies, check = no_blind_spots(results), results.checks.get("discovered-obstacles")
    parts = [check["measured"] if check else "", policies.measured]
    return Judgement("; ".join(filter(None, parts)), policies.verdict)


def scaled(results: Results) -> tuple[dict[str, list[ScaleRow]], dict[str, list[ScaleRow]]]:
    """Return (learners, rules): policy -> its rows at 42 and 84 on 2-2-1, those with both sizes alone.

    Both are empty unless both rules are there.
    """
    rows: dict[str, list[ScaleRow]] = {}
    for row in sorted(scale_rows(results.plays[7]), key=lambda each: each.size):
        if row.level == LEVEL and row.size in SIZES:
            rows.setdefault(row.policy, []).append(row)
    whole = {policy: each for policy, each in rows.items() if len(each) == len(SIZES)}
    if not whole.keys() >= {*RULES}:
        return {}, {}
    return (
        {policy: each for policy, each in whole.items() if policy.startswith(LEARNT)},
        {policy: each for policy, each in whole.items() if policy in RULES},
    )


def less_distance(results: Results) -> Judgement:
    """PPO travels less distance than the rules to explore the same share of the terrain."""
    places = group_by_place(results.plays[7])
    groups = [places.get((LEVEL, size), {}) for size in SIZES]

    def judge(policy: str) -> tuple[str, list[bool]]:
        ratios = [[to_better_rule(group, policy, share) for share in PER_CENT] for group in groups]
        held = [ratio.high < 1 for each in ratios for ratio in each]
        texts = (
            " ".join(f"{ratio.mean:.2f}" if ratio.is_known else "none" for ratio in each)
            for each in ratios
        )
        return f"{' and '.join(texts)}, less with certainty at {sum(held)} of 10", held

    what = f"moves over the better rule's to {', '.join(map(str, PER_CENT))} % at 42x42 and 84x84"
    return decided(what, {policy: policy for policy in scaled(results)[0]}, judge)


def to_better_rule(group: Mapping[str, Line], policy: str, per_cent: int) -> Estimate:
    """Return the ratio of a policy's moves to a share of the cells to those of the rule that is better at that share."""
    rules = (group[rule] for rule in RULES)
    better = min(rules, key=lambda line: float(steps_of(line, per_cent).mean()))
    return compare(group[policy], better, per_cent)


def last_shares(rows: Sequence[ScaleRow]) -> str:
    """Return the share of the moves that the last per cents take, in words."""
    return " and ".join(row.last_share.text(2) for row in rows)


def knee(results: Results) -> Judgement:
    """The rules have a knee: distant parts are left for the end."""
    _, rules = scaled(results)
    if not rules:
        return NOTHING
    held = [row.last_share.low > CONSTANT_PACE for rows in rules.values() for row in rows]
    what = f"share of the moves from 90 to 99 % of coverage ({CONSTANT_PACE:.2f} at a constant pace), 42x42 and 84x84"
    words = (f"`{policy}` {last_shares(rows)}" for policy, rows in rules.items())
    return Judgement(f"{what}: {'; '.join(words)}", partly(held))


def no_knee(results: Results) -> Judgement:
    """PPO has no such knee."""
    own, rules = scaled(results)

    def judge(rows: list[ScaleRow]) -> tuple[str, list[bool]]:
        pairs = zip(rows, *rules.values(), strict=True)
        held = [all(row.last_share.high < rule.last_share.low for rule in of) for row, *of in pairs]
        return last_shares(rows), held

    return decided("the same share", own, judge)


def scales(results: Results) -> Judgement:
    """Learning extends to larger terrains: it completes them, and keeps up with the rules."""

    def judge(rows: list[ScaleRow]) -> tuple[str, list[bool]]:
        ratios = (f"{row.to_rule.mean:.2f}" if row.to_rule.is_known else "no" for row in rows)
        texts = (
            f"{row.completion:.0%} in {ratio}" for row, ratio in zip(rows, ratios, strict=True)
        )
        completes = [row.completion > 0.9 for row in rows]
        return " and ".join(texts), completes + [row.to_rule.low < 1 for row in rows]

    what = "terrains completed, in how many of the better rule's moves, at 42x42 and 84x84"
    return decided(what, scaled(results)[0], judge)
