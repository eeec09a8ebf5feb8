"""What the paper says of the trained policy (figures 6 and 7), measured from the episodes that policies played.

The paper speaks of the policy that PPO learnt. Policies whose name begins with LETTER were trained by the letter of the paper;
all others whose name begins with LEARNT were trained by PPO with other settings. A claim is reproduced when it holds everywhere
for a policy of the first kind. It is reproduced in part when it holds somewhere for any, and each is named with its numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from marsexplorer.config import LEVELS
from marsexplorer.evaluation import RULES
from research.paper.claims.results import (
    NOT_REPRODUCED,
    NOT_YET,
    NOTHING,
    PARTLY,
    REPRODUCED,
    Judgement,
    Results,
    partly,
)
from research.paper.episodes.play import Line
from research.paper.episodes.quadrants import (
    QuadrantCourse,
    Rate,
    course_rates,
    obstacles_of,
)
from research.paper.episodes.scale import (
    PER_CENT,
    Estimate,
    ScaleRow,
    compare,
    group_by_place,
    scale_rows,
    steps_of,
)

PAPER_LEVELS = tuple(level for level in LEVELS if level != "random")
DENSEST = ("3-2-1", "3-2-2")
LEARNT, LETTER = "ppo", "ppo-paper"
SIZES = (42, 84)
LEVEL = "2-2-1"
CONSTANT_PACE = 9 / 99
"""Share of the moves from 90 to 99 % where coverage grows at a constant pace."""


def learners(lines: Sequence[Line]) -> dict[str, dict[str, Line]]:
    """Return policy -> level -> result of figure 6, for those that stand for the paper's and played all of its 12 levels."""
    found: dict[str, dict[str, Line]] = {}
    for line in lines:
        if line["policy"].startswith(LEARNT) and line["level"] in PAPER_LEVELS:
            found.setdefault(line["policy"], {})[line["level"]] = line
    return {
        policy: by_level for policy, by_level in found.items() if len(by_level) == len(PAPER_LEVELS)
    }


def span(shares: Sequence[float]) -> str:
    """Return the range of shares in words."""
    low, high = f"{min(shares):.2f}", f"{max(shares):.2f}"
    return low if low == high else f"{low} to {high}"


def decided(parts: Sequence[str], held: Mapping[str, Sequence[bool]]) -> Judgement:
    """Return the judgement from its sentences and, for each policy, where the claim held."""
    if any(all(places) for policy, places in held.items() if policy.startswith(LETTER)):
        return Judgement("; ".join(parts), REPRODUCED)
    somewhere = any(any(places) for places in held.values())
    return Judgement("; ".join(parts), PARTLY if somewhere else NOT_REPRODUCED)


def never_back(line: Line) -> Rate:
    """Return how often a policy or a walk visits the quadrants in a U and never goes back."""
    return course_rates(line)[1]


def hilbert(results: Results) -> Judgement:
    """The pattern is the first order of the Hilbert curve."""
    own = learners(results.plays[6])
    if not own or not results.walks:
        return NOTHING
    rules = {
        (line["policy"], line["level"]): never_back(line)
        for line in results.plays[6]
        if line["policy"] in RULES
    }
    parts, held = [], {}
    for policy, by_level in own.items():
        rates = {level: never_back(line) for level, line in by_level.items()}
        held[policy] = [
            rate.low > 0.5
            and all(rate.low > other.high for (_, at), other in rules.items() if at == level)
            for level, rate in rates.items()
        ]
        shares = span([rate.share for rate in rates.values()])
        parts.append(f"`{policy}` {shares}, a majority and above both rules on {sum(held[policy])}")
    for rule in RULES:
        shares = span(
            [rate.share for (policy, _), rate in rules.items() if policy == rule] or [float("nan")]
        )
        parts.append(f"`{rule}` {shares}")
    parts += [f"walks by `{walk['null']}` {never_back(walk).share:.2f}" for walk in results.walks]
    return decided(
        [f"share of a U without going back on the 12 levels: {parts[0]}", *parts[1:]], held
    )


def same_family(results: Results) -> Judgement:
    """The same family of trajectories was generated in all cases and with great confidence."""
    own = learners(results.plays[6])
    parts, held = [], {}
    for policy, by_level in own.items():
        orders = [
            [QuadrantCourse.of_code(code).entered for code in line["courses"]]
            for line in by_level.values()
        ]
        every = [order for each in orders for order in each]
        common = max(set(every), key=every.count)
        shares = [each.count(common) / len(each) for each in orders]
        held[policy] = [share > 0.9 for share in shares]
        parts.append(f"`{policy}` {span(shares)}")
    parts[:1] = [
        f"share of a level's episodes in the commonest order of quadrants: {part}"
        for part in parts[:1]
    ]
    return decided(parts, held) if own else NOTHING


def dexterous(results: Results) -> Judgement:
    """The policy adapts to obstacles and avoids encounters, also on 3-2-1 and 3-2-2."""
    own = learners(results.plays[6])
    parts, held = [], {}
    for policy, by_level in own.items():
        lines = [by_level[level] for level in DENSEST]
        crashed = [line["outcomes"].get("collided", 0) / line["played"] for line in lines]
        explored = [line["outcomes"].get("explored", 0) / line["played"] for line in lines]
        held[policy] = [
            crash < 0.05 and done > 0.9 for crash, done in zip(crashed, explored, strict=True)
        ]
        parts.append(f"`{policy}` {span(crashed)} and {span(explored)}")
    parts[:1] = [
        f"shares of the episodes there that collided and were completed: {part}"
        for part in parts[:1]
    ]
    return decided(parts, held) if own else NOTHING


def discovered(results: Results) -> Judgement:
    """The arrangement of discovered obstacles matches the drawn distribution: no blind spots."""
    own = learners(results.plays[6])
    check = results.checks.get("discovered-obstacles")
    parts, held = [check["measured"]] if check else [], {}
    for policy, by_level in own.items():
        found = [obstacles_of(line) for line in by_level.values()]
        held[policy] = [not each.blind_spots for each in found]
        correlations = span([each.correlation for each in found])
        parts.append(f"`{policy}` {correlations} and {sum(held[policy])}")
    if own:
        first = 1 if check else 0
        parts[first] = f"correlation, and levels of 12 without blind spots: {parts[first]}"
        return decided(parts, held)
    return Judgement("; ".join(parts), NOT_YET)


def scaled(results: Results) -> tuple[dict[str, list[ScaleRow]], dict[str, list[ScaleRow]]]:
    """Return (learners, rules): policy -> its rows at 42 and 84 on 2-2-1, those with both sizes alone."""
    rows: dict[str, list[ScaleRow]] = {}
    for row in sorted(scale_rows(results.plays[7]), key=lambda each: each.size):
        if row.level == LEVEL and row.size in SIZES:
            rows.setdefault(row.policy, []).append(row)
    whole = {policy: each for policy, each in rows.items() if len(each) == len(SIZES)}
    return (
        {policy: each for policy, each in whole.items() if policy.startswith(LEARNT)},
        {policy: each for policy, each in whole.items() if policy in RULES},
    )


def less_distance(results: Results) -> Judgement:
    """PPO travels less distance than the rules to explore the same share of the terrain."""
    places = group_by_place(results.plays[7])
    groups = [places.get((LEVEL, size), {}) for size in SIZES]
    own = [policy for policy in groups[0] if policy.startswith(LEARNT) and policy in groups[1]]
    if not own or not all(rule in group for rule in RULES for group in groups):
        return NOTHING
    parts, held = [], {}
    for policy in own:
        ratios = [[to_better_rule(group, policy, share) for share in PER_CENT] for group in groups]
        held[policy] = [ratio is not None and ratio.high < 1 for each in ratios for ratio in each]
        texts = [
            " ".join(f"{ratio.mean:.2f}" if ratio else "none" for ratio in each) for each in ratios
        ]
        parts.append(
            f"`{policy}` {texts[0]} and {texts[1]}, less with certainty at {sum(held[policy])} of 10"
        )
    return decided(
        [
            f"moves over the better rule's to {', '.join(map(str, PER_CENT))} % at 42x42 and 84x84: {parts[0]}",
            *parts[1:],
        ],
        held,
    )


def to_better_rule(group: Mapping[str, Line], policy: str, per_cent: int) -> Estimate | None:
    """Return the ratio of a policy's moves to a share of the cells to those of the rule that is better at that share."""
    better = min(
        (group[rule] for rule in RULES), key=lambda line: float(steps_of(line, per_cent).mean())
    )
    return compare(group[policy], better, per_cent)


def last_shares(policies: dict[str, list[ScaleRow]]) -> list[str]:
    """Return the share of the moves that the last per cents take, in words."""
    texts = []
    for policy, rows in policies.items():
        shares = [row.last_share for row in rows]
        texts.append(
            f"`{policy}` "
            + " and ".join(f"{s.mean:.2f} ± {s.high - s.mean:.2f}" if s else "none" for s in shares)
        )
    return texts


def knee(results: Results) -> Judgement:
    """The rules have a knee: distant parts are left for the end."""
    _, rules = scaled(results)
    if len(rules) < len(RULES):
        return NOTHING
    held = [
        row.last_share is not None and row.last_share.low > CONSTANT_PACE
        for rows in rules.values()
        for row in rows
    ]
    words = f"share of the moves from 90 to 99 % of coverage ({CONSTANT_PACE:.2f} at a constant pace), 42x42 and 84x84: "
    return Judgement(words + "; ".join(last_shares(rules)), partly(held))


def no_knee(results: Results) -> Judgement:
    """PPO has no such knee."""
    own, rules = scaled(results)
    if not own or len(rules) < len(RULES):
        return NOTHING
    held = {}
    for policy, rows in own.items():
        pairs = [
            (row.last_share, [rule[k].last_share for rule in rules.values()])
            for k, row in enumerate(rows)
        ]
        held[policy] = [
            mine is not None and all(each and mine.high < each.low for each in theirs)
            for mine, theirs in pairs
        ]
    return decided(["the same share: " + "; ".join(last_shares(own))], held)


def scales(results: Results) -> Judgement:
    """Learning extends to larger terrains: it completes them, and keeps up with the rules."""
    own, rules = scaled(results)
    parts, held = [], {}
    for policy, rows in own.items():
        completes = [row.completion > 0.9 for row in rows]
        held[policy] = [
            *completes,
            *(row.to_rule is not None and row.to_rule.low < 1 for row in rows),
        ]
        ratios = [f"{row.to_rule.mean:.2f}" if row.to_rule else "no" for row in rows]
        pairs = zip(rows, ratios, strict=True)
        texts = [f"{row.completion:.0%} in {ratio}" for row, ratio in pairs]
        parts.append(f"`{policy}` {' and '.join(texts)}")
    words = "terrains completed, in how many of the better rule's moves, at 42x42 and 84x84: "
    parts[:1] = [words + part for part in parts[:1]]
    return decided(parts, held) if own and rules else NOTHING
