"""Derives figures of docs/paper.md a second time.

`python -m research.paper.second_reading` prints every figure beside what the page has, and fails if
one differs.

It reads the page and the stored files alone: nothing of what draws the page is imported, and the
statistics are written here again.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "paper.md"
TRAININGS = PAGE.with_name("paper-trainings.md")
PAPER, DIFFERENCE = ROOT / "research/paper/data", ROOT / "research/difference/data"
T = {2: 4.302652729911275, 5: 2.570581835636314, 99: 1.9842169515086827}
"""Degrees of freedom -> the two-sided 95 % quantile of Student's t."""
Lines = list[dict[str, Any]]


@dataclass(frozen=True)
class Figure:
    """A figure of the page.

    row      a regular expression of the line that it stands in
    pattern  of the figure in that line, a group a number
    derive   the numbers as text
    in_text  whether it stands in a paragraph, after what `row` matches
    """

    name: str
    row: str
    pattern: str
    derive: Callable[[], Sequence[str]]
    in_text: bool = False


def read(path: Path) -> Lines:
    """The lines of a file."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def trials(file: str, **wanted: str | int) -> Lines:
    """The trials of a file with these fields, by seed."""
    lines = [
        line
        for line in read(PAPER / file)
        if line["kind"] == "trial" and line["trial"].items() >= wanted.items()
    ]
    return sorted(lines, key=lambda line: line["trial"]["seed"])


def half_of(numbers: Sequence[float]) -> float:
    """Half of the 95 % interval of a mean."""
    return T[len(numbers) - 1] * stdev(numbers) / math.sqrt(len(numbers))


def with_half(numbers: Sequence[float], digits: int = 3) -> tuple[str, str]:
    """A mean and half of its interval."""
    return f"{fmean(numbers):.{digits}f}", f"{half_of(numbers):.{digits}f}"


def between(shares: Iterable[float]) -> tuple[str, ...]:
    """The smallest and the largest share in per cent; one if they are equal."""
    both = [*shares]
    return tuple(dict.fromkeys((f"{100 * min(both):.0f}", f"{100 * max(both):.0f}")))


def last_scores(algorithm: str, moves: int) -> tuple[str, str]:
    """The last point of a curve of figure 4, over seeds."""
    lines = trials("figure4.jsonl", algorithm=algorithm, variant="paper", moves=moves)
    return with_half([line["curve"]["score"][-1] for line in lines])


def levels_scores() -> dict[str, list[float]]:
    """Level -> final scores by seed of figure 5, by the letter."""
    scores: dict[str, list[float]] = {}
    for line in trials("figure5.jsonl", variant="paper"):
        scores.setdefault(line["trial"]["level"], []).append(line["curve"]["score"][-1])
    return scores


def on_one_scale() -> dict[str, list[float]]:
    """Level -> final scores by seed, by the letter; the bonus counts everywhere."""
    scores: dict[str, list[float]] = {}
    for line in trials("figure5.jsonl", variant="paper"):
        last = {name: column[-1] for name, column in line["curve"].items() if name != "cpu_s"}
        score = last["score"]
        if line["trial"]["level"].endswith("2"):  # 0 to 441 there, -441 to 882 on the others
            returned = 441 * score
            returned += 441 * last["explored"] - 441 * (last["collided"] + last["out_of_bounds"])
            score = (returned + 441) / 1323
        scores.setdefault(line["trial"]["level"], []).append(score)
    return scores


def effect(element: int) -> list[float]:
    """The spread of a mean score between the settings of an element, by seed."""
    scores = on_one_scale()
    settings = sorted({level.split("-")[element] for level in scores})
    spreads = []
    for seed in range(3):
        means = [
            fmean(scores[level][seed] for level in scores if level.split("-")[element] == setting)
            for setting in settings
        ]
        spreads.append(max(means) - min(means))
    return spreads


def morphology(setting: str) -> list[float]:
    """The mean score with one d_m, by seed."""
    scores = on_one_scale()
    return [
        fmean(scores[level][seed] for level in scores if level.split("-")[1] == setting)
        for seed in range(3)
    ]


def effect_difference(elements: tuple[int, int]) -> tuple[str, str]:
    """One effect less another, over seeds."""
    first, second = (effect(element) for element in elements)
    return with_half([a - b for a, b in zip(first, second, strict=True)])


def clean_shares(policy: str) -> list[float]:
    """The share of a U that never goes back of a policy, by level."""
    shares = []
    for line in read(PAPER / f"figure6-{policy}.jsonl"):
        if line["level"] == "random":
            continue
        shares.append(fmean(is_clean(course) for course in line["courses"]))
    return shares


def is_clean(course: str) -> bool:
    """Whether a course enters four quadrants as a U does, in three changes."""
    entered, changes = course.split(":")
    is_u = len(entered) == 4 and int(entered[2]) == (int(entered[0]) + 2) % 4
    return is_u and changes == "3"


def walk_share(null: str) -> tuple[str]:
    """The share of a U that never goes back of walks that nobody trained."""
    (walks,) = (line for line in read(PAPER / "figure6-null.jsonl") if line["null"] == null)
    return (f"{100 * fmean(map(is_clean, walks['courses'])):.0f}",)


def commonest(policy: str) -> tuple[str, ...]:
    """The share of the commonest order of quadrants on each level, as a range."""
    orders = [
        [course.split(":")[0] for course in line["courses"]]
        for line in read(PAPER / f"figure6-{policy}.jsonl")
        if line["level"] != "random"
    ]
    ((order, _),) = Counter(name for level in orders for name in level).most_common(1)
    return between(level.count(order) / len(level) for level in orders)


def of_size(policy: str, size: int) -> dict[str, Any]:
    """The line of figure 7 of a policy on level 2-2-1."""
    lines = read(PAPER / f"figure7-{policy}.jsonl")
    (line,) = (line for line in lines if (line["level"], line["rows"]) == ("2-2-1", size))
    return line


def knees(policy: str) -> tuple[str, ...]:
    """The share of the moves from 90 % on at both sizes."""
    texts: list[str] = []
    for size in (42, 84):
        reached = of_size(policy, size)["reached"]
        pairs = zip(reached["90"], reached["99"], strict=True)
        texts += with_half([100 * (whole - before) / whole for before, whole in pairs if whole], 0)
    return tuple(texts)


def to_rule(policy: str, share: str, size: int) -> str:
    """Mean moves to a share over those of the better rule."""
    means = {}
    for name in (policy, "frontier-cost", "frontier-utility"):
        moves = of_size(name, size)["reached"][share]
        means[name] = fmean(number if number is not None else size * size for number in moves)
    moves_of_policy = means.pop(policy)
    return f"{moves_of_policy / min(means.values()):.2f}"


def ratios(policy: str) -> tuple[str, ...]:
    """All ten ratios of a policy to the better rule."""
    shares = ("50", "75", "90", "95", "99")
    return tuple(to_rule(policy, share, size) for size in (42, 84) for share in shares)


def collided_and_completed(policy: str) -> tuple[str, ...]:
    """The shares of both on the densest levels."""
    lines = [
        line
        for line in read(PAPER / f"figure6-{policy}.jsonl")
        if line["level"] in ("3-2-1", "3-2-2")
    ]
    return tuple(
        text
        for end in ("collided", "explored")
        for text in between(line["outcomes"].get(end, 0) / line["played"] for line in lines)
    )


def between_levels(levels: Sequence[str]) -> tuple[str, str]:
    """Mean moves on the levels in the middle, of trainings on some levels."""
    ends = ("1-1-1", "1-1-2", "3-2-1", "3-2-2")
    by_policy: dict[str, list[float]] = {}
    for line in read(PAPER / "generalisation.jsonl"):
        trained_on = line["policy"].removeprefix("ppo-works-")[:5]
        if trained_on in levels and line["level"] not in ends:
            by_policy.setdefault(line["policy"], []).append(line["steps_to_99"])
    means = [fmean(moves) for moves in by_policy.values()]
    return with_half(means, 1)


def last_five(column: str, **wanted: str) -> dict[int, float]:
    """Seed -> the mean of a column over the last five lines of a training's curve."""
    means = {}
    for line in read(DIFFERENCE / "trainings.jsonl"):
        training = line["training"]
        if training.items() >= wanted.items():
            means[training["seed"]] = fmean(line["curve"][column][-5:])
    return means


def world_effect() -> tuple[str, ...]:
    """The effect of the world on coverage, with its interval over seeds."""
    differences: dict[int, list[float]] = {0: [], 1: [], 2: []}
    for estimates in ("text", "code"):
        for leaving in ("free", "costs"):
            kind = {
                "estimates": estimates,
                "leaving": leaving,
                "passes": "light",
                "level": "videos",
            }
            code = last_five("coverage", world="code", **kind)
            text = last_five("coverage", world="text", **kind)
            for seed, numbers in differences.items():
                numbers.append(code[seed] - text[seed])
    by_seed = [fmean(numbers) for numbers in differences.values()]
    mean, half = fmean(by_seed), half_of(by_seed)
    return f"{mean:+.2f}", f"{mean - half:+.2f}", f"{mean + half:+.2f}"


def passes_effect() -> tuple[str, ...]:
    """The effect of full passes on coverage, with its interval over seeds."""
    kind = {"world": "code", "estimates": "code", "leaving": "free", "level": "videos"}
    full, light = (last_five("coverage", passes=passes, **kind) for passes in ("full", "light"))
    by_seed = [full[seed] - light[seed] for seed in range(3)]
    mean, half = fmean(by_seed), half_of(by_seed)
    return f"{mean:+.2f}", f"{mean - half:+.2f}", f"{mean + half:+.2f}"


def held_out(column: str) -> tuple[str, str]:
    """A column of the full passes in the code's world on terrains kept apart.

    Of the seeds whose episodes are mostly a U, and of the others.
    """
    wanted = {"world": "code", "estimates": "code", "passes": "full", "level": "videos"}
    lines = [
        line
        for line in read(DIFFERENCE / "trainings.jsonl")
        if line["training"].items() >= wanted.items()
    ]
    lines.sort(key=lambda line: line["training"]["seed"])
    groups = (
        [line["result"][column] for line in lines if (line["result"]["clean_u"] > 0.5) == is_maker]
        for is_maker in (True, False)
    )
    makers, others = (" and ".join(f"{100 * share:.1f}" for share in group) for group in groups)
    return makers, others


def verdicts() -> tuple[str, ...]:
    """How many definitions are reproduced, by the tables of what is implemented."""
    both = (page.read_text().split("## What is implemented")[1] for page in (PAGE, TRAININGS))
    rows = [line for text in both for line in text.splitlines() if line.startswith("|`")]
    return (str(sum(line.endswith("|reproduced|") for line in rows)),)


NUMBER = r"([+-]?\d+(?:\.\d+)?)"
PAIR, RANGE = rf"{NUMBER} ± {NUMBER}", rf"{NUMBER} to {NUMBER}"
EFFECT = rf" {NUMBER} \({NUMBER} to {NUMBER}\)"
FIVE = " ".join([NUMBER] * 5)


def row(name: str) -> str:
    """The row of a claim."""
    return rf"^\|`{name}`\|.*$"


FIGURES = (
    Figure(
        "PPO's score", row("best"), f"at the end ppo {PAIR}", lambda: last_scores("ppo", 9_000_000)
    ),
    Figure("Rainbow's", row("best"), f"rainbow {PAIR}", lambda: last_scores("rainbow", 2_250_000)),
    Figure("A2C's", row("best"), f"a2c {PAIR}", lambda: last_scores("a2c", 9_000_000)),
    Figure("SAC's", row("best"), f"sac {PAIR}", lambda: last_scores("sac", 225_000)),
    Figure("d_t", row("morphology-first"), f"values: d_t {PAIR}", lambda: with_half(effect(0))),
    Figure("d_m", row("morphology-first"), f"d_m {PAIR}", lambda: with_half(effect(1))),
    Figure("d_b", row("morphology-first"), f"d_b {PAIR}", lambda: with_half(effect(2))),
    Figure(
        "d_m less d_t",
        row("morphology-first"),
        f"d_m less d_t {PAIR}",
        lambda: effect_difference((1, 0)),
    ),
    Figure(
        "d_m less d_b",
        row("morphology-first"),
        f"d_m less d_b {PAIR}",
        lambda: effect_difference((1, 2)),
    ),
    Figure(
        "d_t less d_b",
        row("bonus-little"),
        f"d_t less d_b {PAIR}",
        lambda: effect_difference((0, 2)),
    ),
    Figure(
        "d_m = 1",
        row("morphology-degrades"),
        f"everywhere {PAIR} with d_m = 1",
        lambda: with_half(morphology("1")),
    ),
    Figure(
        "d_m = 2",
        row("morphology-degrades"),
        f"{PAIR} with d_m = 2",
        lambda: with_half(morphology("2")),
    ),
    Figure("3-2-1", row("hardest"), f"3-2-1 {PAIR}", lambda: with_half(levels_scores()["3-2-1"])),
    Figure("3-2-2", row("hardest"), f"3-2-2 {PAIR}", lambda: with_half(levels_scores()["3-2-2"])),
    Figure(
        "easy",
        row("harder-generalises"),
        f"1-1-2 {PAIR}",
        lambda: between_levels(("1-1-1", "1-1-2")),
    ),
    Figure(
        "hard",
        row("harder-generalises"),
        f"3-2-2 {PAIR}",
        lambda: between_levels(("3-2-1", "3-2-2")),
    ),
    Figure(
        "one family", row("same-family"), f"`ppo-earlier` {RANGE}", lambda: commonest("ppo-earlier")
    ),
    Figure(
        "by the letter",
        row("same-family"),
        f"`ppo-paper-21-s2` {RANGE}",
        lambda: commonest("ppo-paper-21-s2"),
    ),
    Figure(
        "a U",
        row("hilbert"),
        f"`ppo-earlier` {RANGE}",
        lambda: between(clean_shares("ppo-earlier")),
    ),
    Figure(
        "a U of the rule",
        row("hilbert"),
        f"`frontier-cost` {RANGE} %; `frontier-u",
        lambda: between(clean_shares("frontier-cost")),
    ),
    Figure(
        "walks by lidar", row("hilbert"), f"walks by `lidar` {NUMBER}", lambda: walk_share("lidar")
    ),
    Figure(
        "walks by blocks",
        row("hilbert"),
        f"walks by `blocks` {NUMBER}",
        lambda: walk_share("blocks"),
    ),
    Figure(
        "collided",
        row("dexterous"),
        f"`ppo-paper-21-s2` {RANGE} % and {NUMBER} %",
        lambda: collided_and_completed("ppo-paper-21-s2"),
    ),
    Figure(
        "ten ratios",
        row("less-distance"),
        f"`ppo-works` {FIVE} and {FIVE}",
        lambda: ratios("ppo-works"),
    ),
    Figure(
        "ten others",
        row("less-distance"),
        f"`ppo-earlier` {FIVE} and {FIVE}",
        lambda: ratios("ppo-earlier"),
    ),
    Figure(
        "knee",
        row("knee"),
        f"`frontier-cost` {PAIR} % and {PAIR} %",
        lambda: knees("frontier-cost"),
    ),
    Figure(
        "knee of utility",
        row("knee"),
        f"`frontier-utility` {PAIR} % and {PAIR} %",
        lambda: knees("frontier-utility"),
    ),
    Figure(
        "no knee", row("no-knee"), f"`ppo-works` {PAIR} % and {PAIR} %", lambda: knees("ppo-works")
    ),
    Figure(
        "larger",
        row("scales"),
        rf"`ppo-works` 100 % in {NUMBER} and 100 % in {NUMBER}",
        lambda: (to_rule("ppo-works", "99", 42), to_rule("ppo-works", "99", 84)),
    ),
    Figure("world", r"^- makes the difference: .*$", f"the world{EFFECT}", world_effect),
    Figure(
        "passes",
        r"^- undecided whether enough to count: .*$",
        f"the gradient steps{EFFECT}",
        passes_effect,
    ),
    Figure(
        "code, full",
        r"^\|videos\|full\|code\|.*$",
        rf"800,000\|{RANGE} %\|",
        lambda: between(
            last_five("coverage", world="code", passes="full", level="videos").values()
        ),
    ),
    Figure(
        "a U by seed",
        r"Most\s+episodes\s+are",
        r"seeds: ([\d.]+) %.*it is ([\d.]+ and [\d.]+) %",
        lambda: held_out("clean_u"),
        in_text=True,
    ),
    Figure(
        "completed",
        r"Most\s+episodes\s+are",
        r"where ([\d.]+) %.*where ([\d.]+ and [\d.]+) %",
        lambda: held_out("explored"),
        in_text=True,
    ),
    Figure(
        "left",
        r"Most\s+episodes\s+are",
        r"and ([\d.]+) % leave.* and ([\d.]+ and [\d.]+) % leave",
        lambda: held_out("out_of_bounds"),
        in_text=True,
    ),
    Figure("reproduced", r"^Of \d+ definitions: .*$", r"(\d+) reproduced", verdicts),
)
"""More than thirty, of stored trainings, episodes and walks."""


def on_the_page(figure: Figure, text: str) -> tuple[str, ...]:
    """The numbers of a figure as they stand on the page; empty if it has none."""
    for start in re.finditer(figure.row, text, re.M):
        paragraph = text[start.start() :].split("\n\n")[0] if figure.in_text else start[0]
        if numbers := re.search(figure.pattern, " ".join(paragraph.split())):
            return numbers.groups()
    return ()


def compare() -> list[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    """Each figure's name, its numbers on the page, and those derived here."""
    text = PAGE.read_text() + TRAININGS.read_text()
    return [(figure.name, on_the_page(figure, text), tuple(figure.derive())) for figure in FIGURES]


def main() -> None:
    """Print every figure, and fail if one differs."""
    rows = compare()
    for name, page, derived in rows:
        mark = "equal" if page == derived else "DIFFERS"
        print(f"{mark:8} {name:18} page {' '.join(page)}; derived {' '.join(derived)}")
    wrong = sum(page != derived for _, page, derived in rows)
    print(f"{len(rows) - wrong} of {len(rows)} figures are equal")
    raise SystemExit(wrong > 0)


if __name__ == "__main__":
    main()
