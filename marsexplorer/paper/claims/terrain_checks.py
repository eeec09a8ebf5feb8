"""What the paper says of terrains and levels (table 1, sections 3.2, 3.3 and 3.5), tested by drawing them."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from marsexplorer.config import LEVELS, OBSTACLE, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.paper.claims.rule_checks import Finding, played
from marsexplorer.terrain import generate

TERRAINS = 1000
FAMILIES = ("1-1-1", "1-2-1", "2-1-1", "2-2-1", "3-1-1", "3-2-1")
"""The levels whose terrains differ: t-m-2 has those of t-m-1."""
LATTICE = (3, 10, 17)
LARGEST_SIDE = {1: 2, 2: 4}
"""d_m -> the longest side of an obstacle, cells."""


@cache
def drawn(level: str, size: int = 21) -> NDArray[np.bool_]:
    """Return the terrains of seeds 0..TERRAINS-1: bool[TERRAINS, size, size]."""
    config = EnvConfig.of(level, size)
    return np.stack([generate(config, seed) for seed in range(TERRAINS)])


def table_1() -> Finding:
    """Grid 21x21, radius 6, done at 99 %."""
    config = EnvConfig()
    holds = (config.rows, config.cols, config.sensor_radius, config.beta) == (21, 21, 6, 0.99)
    measured = f"defaults: {config.rows}x{config.cols}, radius {config.sensor_radius}, {config.beta:.0%} ({config.target} cells)"
    return Finding(
        holds, f"{measured}; cut off after {config.limit} moves, of which the paper says nothing"
    )


def diversity() -> Finding:
    """Each episode has a terrain of its own, and a seed gives it again."""
    terrains = drawn("random")
    distinct = len({each.tobytes() for each in terrains})
    again = all(
        (generate(EnvConfig(), seed) == terrains[seed]).all() for seed in range(0, TERRAINS, 50)
    )
    return Finding(
        distinct == TERRAINS and again,
        f"{distinct:,} distinct terrains in {TERRAINS:,} seeds, each the same again",
    )


def random_obstacles() -> Finding:
    """On `random` the position and the shape of obstacles are random (section 3.2)."""
    shapes, terrains = set(), drawn("random")
    for each in terrains[:300]:
        for part in ndimage.find_objects(ndimage.label(each)[0]):
            if each[part].all():
                shapes.add(each[part].shape)
    inner = terrains[:, 3:-3, 3:-3].mean(0)
    every = {(height, width) for height in (1, 2, 3) for width in (1, 2, 3)}
    measured = f"all {len(every)} shapes of 1 to 3 cells a side occur; away from the edge each cell is blocked in "
    measured += f"{inner.min():.0%} to {inner.max():.0%} of terrains"
    return Finding(every <= shapes and inner.min() > 0.5 * inner.max(), measured)


def lattice() -> Finding:
    """The fundamental positions stand in 3 rows and 3 columns, equally far apart."""
    counts = set()
    for level in ("1-1-1", "1-2-1"):
        counts |= {int(ndimage.label(each)[1]) for each in drawn(level)}
    steps = set(np.diff(LATTICE).tolist())
    measured = f"rows and columns {', '.join(map(str, LATTICE))}; {', '.join(map(str, sorted(counts)))} separate obstacles in "
    return Finding(
        counts == {9} and len(steps) == 1,
        measured + f"each of {2 * TERRAINS:,} terrains of 1-1-1 and 1-2-1",
    )


def topology() -> Finding:
    """d_t is the radius of deviation around the fundamental positions."""
    found, longest = {}, LARGEST_SIDE[1]
    for level in ("1-1-1", "2-1-1", "3-1-1"):
        rows = np.flatnonzero(drawn(level).any((0, 2)))
        found[level] = (int(rows.min()), int(rows.max()))
    wanted = {
        f"{t}-1-1": (LATTICE[0] - t, min(LATTICE[-1] + t + longest - 1, 20)) for t in (1, 2, 3)
    }
    text = ", ".join(f"{first} to {last} on {level}" for level, (first, last) in found.items())
    measured = f"obstacles of at most {longest} cells a side on rows {LATTICE[0]} to {LATTICE[-1]}, moved by at most d_t, block rows "
    return Finding(found == wanted, f"{measured}{text} ({TERRAINS:,} terrains each)")


def morphology() -> Finding:
    """d_m decides how large obstacles become."""
    sides, areas = {}, {}
    for level in ("1-1-1", "1-2-1"):
        parts = [
            part for each in drawn(level) for part in ndimage.find_objects(ndimage.label(each)[0])
        ]
        shapes = np.array([[axis.stop - axis.start for axis in part] for part in parts])
        sides[level], areas[level] = int(shapes.max()), float(shapes.prod(1).mean())
    holds = areas["1-2-1"] > areas["1-1-1"] and [*sides.values()] == [2, 4]
    text = ", ".join(
        f"sides of 1 to {sides[each]} and {areas[each]:.2f} cells in the mean on {each}"
        for each in sides
    )
    return Finding(holds, f"{text} ({TERRAINS:,} terrains each)")


def bonus_levels() -> Finding:
    """d_b = 1 gives bonus and penalty, d_b = 2 neither."""
    right = 0
    for name, level in LEVELS.items():
        if name != "random":
            config = EnvConfig.of(name)
            episode = Episode.begin(config, seed=0)
            episode.step(0)
            wanted = config.n if name.endswith("-1") else 0
            right += config.r_bonus == wanted == -episode.total and level.has_bonus == (wanted > 0)
    return Finding(right == 12, f"{right} of 12 levels: n and -n on t-m-1, 0 and 0 on t-m-2")


def combinations() -> Finding:
    """The values of the three elements give 12 levels."""
    names = {f"{t}-{m}-{b}" for t in (1, 2, 3) for m in (1, 2) for b in (1, 2)}
    return Finding(names == set(LEVELS) - {"random"}, f"{len(names)} levels, and `random`")


def entropy(terrains: NDArray[np.bool_]) -> float:
    """Return the entropy of the cells of terrains bool[count, rows, cols], each cell by itself, in bits."""
    share = terrains.mean(0).clip(1e-12, 1 - 1e-12)
    return float(-(share * np.log2(share) + (1 - share) * np.log2(1 - share)).sum())


def structure() -> Finding:
    """Higher values of d_t and d_m mean obstacles with less structure."""
    bits = {level: entropy(drawn(level)) for level in FAMILIES}
    by_topology = all(bits[f"{t}-{m}-1"] < bits[f"{t + 1}-{m}-1"] for t in (1, 2) for m in (1, 2))
    by_morphology = all(bits[f"{t}-1-1"] < bits[f"{t}-2-1"] for t in (1, 2, 3))
    text = ", ".join(f"{level} {value:.0f}" for level, value in bits.items())
    measured = f"bits of entropy of the cells, each by itself: {text}; `random` {entropy(drawn('random')):.0f}"
    return Finding(by_topology and by_morphology, measured + "; d_b changes no terrain")


def sizes() -> Finding:
    """42x42 and 84x84 grids at level 2-2-1 can be played."""
    points = {side: len(range(LATTICE[0], side, 7)) ** 2 for side in (42, 84)}
    shapes = [Episode.begin(EnvConfig.of("2-2-1", side), seed=0).terrain.shape for side in points]
    text = " and ".join(f"{side}x{side} with {count} obstacles" for side, count in points.items())
    return Finding(shapes == [(42, 42), (84, 84)], f"{text} on the same lattice, 7 cells apart")


def discovered_obstacles(count: int = 100) -> Finding:
    """The obstacles that are discovered are distributed as they were drawn (section 3.4), here with a rule."""
    seen, there, worst, lowest = 0, 0, 1.0, 1.0
    for level in FAMILIES:
        found, drawn_there = np.zeros((21, 21)), np.zeros((21, 21))
        for episode in played(EnvConfig.of(level), "frontier-cost", count):
            found += episode.codes == OBSTACLE
            drawn_there += episode.terrain
        seen, there = seen + int(found.sum()), there + int(drawn_there.sum())
        often = drawn_there >= count // 10
        worst = min(worst, float(np.corrcoef(found.ravel(), drawn_there.ravel())[0, 1]))
        lowest = min(lowest, float((found[often] / drawn_there[often]).min()))
    measured = f"not with their policy: the rule `frontier-cost` on 6 levels, {count} episodes each, discovered "
    measured += f"{seen / there:.1%} of the obstacle cells, and the cell that it saw least often {lowest:.0%} of the times; "
    measured += f"correlation over the cells of found and drawn at least {worst:.3f}"
    return Finding(worst > 0.95 and lowest > 0.5, measured)
