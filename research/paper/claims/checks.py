"""The paper's statements about its environment, tested without training.

They are in sections 2, 3.2, 3.3, 3.5 and table 1. `python -m research.paper.claims.checks [NAME
...]` plays episodes that seeds fix, and draws terrains. `--out FILE` writes the lines of all
checks, as they are shipped in `data/environment.jsonl`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from humanplay.command.options import PATH
from marsexplorer import policies
from marsexplorer.config import FREE, LEVELS, OBSTACLE, ROVER, UNKNOWN, EnvConfig
from marsexplorer.episode import Episode, score
from marsexplorer.observation import DISPLACEMENTS, Codes
from marsexplorer.rules import R_MOVE
from marsexplorer.terrain import generate
from research.paper.episodes.play import DIFFICULTIES, TERRAINS
from research.paper.jobs import Line, write_lines
from research.paper.tables import per_cent

EPISODES = 40
Cell = tuple[int, int]
MOST_NEW_CELLS = 13
"""At most so many cells come within radius 6 by a move: a disc 13 cells high, moved by one."""


@dataclass(frozen=True)
class Finding:
    """The result of a check: whether the statement holds, and what was measured."""

    holds: bool
    measured: str


def played(config: EnvConfig, policy: str, count: int = EPISODES) -> Iterator[Episode]:
    """Yield ended episodes of a policy by name on the terrains of seeds 0, 1, ...

    policy  "blind" draws any of the four moves
    """
    player = None if policy == "blind" else policies.load(policy)
    for seed in range(count):
        episode, rng = Episode.begin(config, seed=seed), np.random.default_rng(seed)
        if player is not None:
            player.reset(seed)
        while not episode.ended:
            episode.step(player.act(episode.codes) if player is not None else int(rng.integers(4)))
        yield episode


def actions() -> Finding:
    """Four moves, each to a neighbour that shares an edge (eq. 3)."""
    config, ground, moved = EnvConfig(rows=9, cols=9), np.zeros((9, 9), bool), []
    for action in range(len(DISPLACEMENTS)):
        episode = Episode.begin(config, terrain=ground, start=(4, 4))
        episode.step(action)
        moved.append((episode.position[0] - 4, episode.position[1] - 4))
    words = ", ".join(map(str, moved))
    holds = moved == [(-1, 0), (0, 1), (1, 0), (0, -1)]
    return Finding(holds, f"actions 0 to 3 move the rover by {words}")


def is_hidden(target: Cell, rover: Cell, obstacles: Sequence[Cell]) -> bool:
    """Whether the segment between two centres crosses the inside of an obstacle.

    By clipping it to the obstacle's square, exactly; the target does not hide itself.
    """
    for obstacle in obstacles:
        if obstacle == target:
            continue
        low, high = Fraction(0), Fraction(1)
        for begin, end, centre in zip(rover, target, obstacle, strict=True):
            if begin == end:
                if centre != begin:
                    low = high
                continue
            sides = (Fraction(2 * (centre - begin) + side, 2 * (end - begin)) for side in (-1, 1))
            first, last = sorted(sides)
            low, high = max(low, first), min(high, last)
        if low < high:
            return True
    return False


def lidar() -> Finding:
    """A cell is sensed within the radius and in line of sight (eq. 4)."""
    right, cells, scans = 0, 0, 0
    for radius in range(1, 9):
        config, rng = (
            EnvConfig(rows=17, cols=15, sensor_radius=radius),
            np.random.default_rng(radius),
        )
        for share in (0.05, 0.15, 0.3):
            terrain = rng.random((config.rows, config.cols)) < share
            rover = (int(rng.integers(config.rows)), int(rng.integers(config.cols)))
            terrain[rover] = False
            observation = Episode.begin(config, terrain=terrain, start=rover).observation()
            blocked: list[Cell] = [(row, col) for row, col in np.argwhere(terrain).tolist()]
            scans += 1
            for row, col in np.ndindex(terrain.shape):
                is_near = (row - rover[0]) ** 2 + (col - rover[1]) ** 2 <= radius**2
                is_seen = is_near and not is_hidden((row, col), rover, blocked)
                right += is_seen == (observation[row, col] != 0)
                cells += 1
    measured = (
        f"{right:,} of {cells:,} cells in {scans} scans with radii from 1 to 8 are sensed or not as the exact segment "
        "between the centres says"
    )
    return Finding(right == cells, measured)


COST_RULE = "frontier-cost"


def cost() -> Finding:
    """Cost: the rover goes to the nearest frontier cell (section 3.5)."""
    nearer, moves = 0, 0
    for seed in range(EPISODES // 4):
        episode, rule = Episode.begin(EnvConfig(), seed=seed), policies.load(COST_RULE)
        rule.reset(seed)
        while not episode.ended:
            codes, visited = episode.codes.copy(), {(row, col) for row, col in episode.path}
            before = moves_to_frontier(codes, visited, episode.position)
            episode.step(rule.act(episode.codes))
            nearer += moves_to_frontier(codes, visited, episode.position) == before - 1
            moves += 1
    measured = f"`{COST_RULE}`: {nearer:,} of {moves:,} moves begin a shortest known path to the nearest frontier cell"
    return Finding(nearer == moves, measured)


def moves_to_frontier(codes: Codes, visited: set[Cell], rover: Cell) -> int:
    """The moves over known free cells to the nearest unvisited frontier; -1 if none."""
    rows, cols = codes.shape
    ring, reached, moves = [rover], {rover}, 0
    while ring:
        for row, col in ring:
            around = codes[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2]
            if (row, col) not in visited and (around == UNKNOWN).any():
                return moves
        beside = [(row + dr, col + dc) for row, col in ring for dr, dc in DISPLACEMENTS]
        ring = [
            (row, col)
            for row, col in dict.fromkeys(beside)
            if 0 <= row < rows and 0 <= col < cols and codes[row, col] in (FREE, ROVER)
            if (row, col) not in reached
        ]
        reached |= {*ring}
        moves += 1
    return -1


def state() -> Finding:
    """The state matrix holds 0, 0.3, 0.6 and 1, and 0.6 in the rover's cell (eq. 6)."""
    seen_values: set[float] = set()
    moves, rule, is_rover_alone = 0, policies.load("frontier-cost"), True
    for seed in range(EPISODES):
        episode = Episode.begin(EnvConfig(), seed=seed)
        rule.reset(seed)
        while not episode.ended:
            episode.step(rule.act(episode.codes))
            matrix = episode.observation()
            seen_values.update(np.unique(matrix.round(6)).tolist())
            rovers = np.argwhere(matrix == np.float32(0.6)).tolist()
            is_rover_alone &= rovers == [[*episode.position]]
            moves += 1
    values = sorted(round(number, 1) for number in seen_values)
    holds = values == [0.0, 0.3, 0.6, 1.0] and is_rover_alone
    measured = f"values {values} in {moves:,} observations, 0.6 in the rover's cell alone"
    return Finding(holds, measured)


def partial_observability() -> Finding:
    """The cells beyond the lidar's reach leave no trace in any observation (2.5)."""
    config, same, moves = EnvConfig(), 0, 0
    cells = np.argwhere(np.ones((config.rows, config.cols)))
    for seed in range(EPISODES):
        terrain, rule = generate(config, seed), policies.load("frontier-cost")
        first = Episode.begin(config, terrain=terrain)
        seen, actions = [first.observation()], []
        rule.reset(seed)
        while first.coverage < 0.5:
            actions.append(rule.act(first.codes))
            first.step(actions[-1])
            seen.append(first.observation())
        distances = np.linalg.norm(cells[:, None] - np.array(first.path), axis=2).min(1)
        beyond = (distances > config.sensor_radius).reshape(terrain.shape)
        other = Episode.begin(config, terrain=terrain ^ beyond)
        for action, expected in zip([None, *actions], seen, strict=True):
            if action is not None:
                other.step(action)
            same += bool(np.array_equal(other.observation(), expected))
            moves += 1
    measured = (
        f"{same:,} of {moves:,} observations, till half of the cells were known, are the same where every cell beyond the "
        "lidar's reach is an obstacle instead of free, and the other way round"
    )
    return Finding(same == moves, measured)


def reward() -> Finding:
    """A valid move earns its new cells less 0.5, the first scan nothing (eq. 7, 8)."""
    right, moves = 0, 0
    for episode in played(EnvConfig(), "blind", 20 * EPISODES):
        new = np.diff(episode.discoveries)
        valid = episode.steps - int(episode.outcome in ("collided", "out_of_bounds", "explored"))
        right += sum(episode.rewards[k] == new[k] - 0.5 for k in range(valid))
        moves += valid
    measured = f"{right:,} of {moves:,} valid moves earned their new cells less {R_MOVE}"
    return Finding(right == moves and R_MOVE == 0.5, measured)


def invalid() -> Finding:
    """An invalid move costs n, ends the episode, and earns nothing else (eq. 8)."""
    config = EnvConfig()
    ended = [
        (episode.outcome, episode.rewards[-1])
        for episode in played(config, "blind", 20 * EPISODES)
        if episode.outcome in ("collided", "out_of_bounds")
    ]
    crashes = sum(outcome == "collided" for outcome, _ in ended)
    measured = f"{len(ended):,} invalid moves, {crashes:,} of them into obstacles: each gave -{config.n} and ended it"
    return Finding(all(reward == -config.n for _, reward in ended), measured)


def bonus() -> Finding:
    """The move that brings the share to beta earns n more and ends it (eq. 8)."""
    config, right = EnvConfig(), []
    for episode in played(config, "frontier-cost"):
        *_, before, after = episode.discoveries
        gained = episode.rewards[-1] - (after - before - 0.5)
        is_there = after / config.n >= 0.99 > before / config.n
        right.append(is_there and gained == config.n and episode.outcome == "explored")
    measured = f"{len(right)} completed episodes: each ended with the move that passed 99 % and gave {config.n} more"
    return Finding(all(right), measured)


def score_zero() -> Finding:
    """The normalized score is 0 for an invalid first move (section 3.2)."""
    config = EnvConfig()
    episode = Episode.begin(config, seed=0)
    episode.step(0)
    zero = score(config, episode.total)
    return Finding(zero == 0.0, f"north at the start, off the grid: score {zero:g}")


def score_one() -> Finding:
    """The normalized score is 1 for the bonus plus all cells (section 3.2).

    No episode can reach it.
    """
    config = EnvConfig()
    one = score(config, config.r_bonus + config.n)
    reach = np.hypot(*np.indices((config.rows, config.cols))) <= config.sensor_radius
    moves = -(-(config.target - int(reach.sum())) // MOST_NEW_CELLS)
    bounds = []
    for seed in range(500):
        first = Episode.begin(config, seed=seed).discovered
        bounds.append(score(config, config.r_bonus + config.n - first - R_MOVE * moves))
    measured = f"a return of {config.r_bonus + config.n} scores {one:g}; but the first scan earns nothing and moves cost, so "
    measured += f"no episode can score more than {max(bounds):.3f} (mean bound of 500 terrains {np.mean(bounds):.3f})"
    return Finding(one == 1.0, measured)


PRINTED = 0.4273
"""Rainbow's share of the human level in section 3.2."""


def shares() -> Finding:
    """The shares of section 3.2 follow from one another: 85.8, 50.04, 42.73 %."""
    low, high = 0.8575 * 0.50035, 0.8585 * 0.50045
    measured = f"85.8 % times 50.04 % is {per_cent(0.858 * 0.5004, 2)} ({per_cent(low, 2)} to "
    measured += f"{per_cent(high, 2)} with rounding), and "
    measured += f"{per_cent(PRINTED, 2)} is printed"
    return Finding(low <= PRINTED <= high, measured)


DRAWS = 1000
LATTICE = (3, 10, 17)
LARGEST_SIDE = {1: 2, 2: 4}
"""d_m -> the longest side of an obstacle, cells."""


@cache
def drawn(level: str, size: int = 21) -> NDArray[np.bool_]:
    """The terrains of seeds 0..DRAWS-1: bool[DRAWS, size, size]."""
    config = EnvConfig.of(level, size)
    return np.stack([generate(config, seed) for seed in range(DRAWS)])


def obstacles(terrains: NDArray[np.bool_]) -> Iterator[NDArray[np.bool_]]:
    """Yield the separate obstacles of terrains, each in its smallest box.

    bool[rows, cols]
    """
    for terrain in terrains:
        for box in ndimage.find_objects(ndimage.label(terrain)[0]):
            yield terrain[box]


def table_1() -> Finding:
    """Grid 21x21, radius 6, done at 99 %."""
    config = EnvConfig()
    holds = (config.rows, config.cols, config.sensor_radius, config.beta) == (21, 21, 6, 0.99)
    measured = f"defaults: {config.rows}x{config.cols}, radius {config.sensor_radius}, {per_cent(config.beta)} "
    measured += f"({config.target} cells); cut off after {config.limit} moves, of which the paper says nothing"
    return Finding(holds, measured)


def diversity() -> Finding:
    """Each episode has a terrain of its own, and a seed gives it again."""
    config, terrains = EnvConfig(), drawn("random")
    distinct = len({terrain.tobytes() for terrain in terrains})
    again = all((generate(config, k) == terrains[k]).all() for k in range(0, DRAWS, 50))
    measured = f"{distinct:,} distinct terrains in {DRAWS:,} seeds, each the same again"
    return Finding(distinct == DRAWS and again, measured)


def random_obstacles() -> Finding:
    """On `random` the position and the shape of obstacles are random (section 3.2)."""
    terrains = drawn("random")
    shapes = {obstacle.shape for obstacle in obstacles(terrains[:300]) if obstacle.all()}
    inner = terrains[:, 3:-3, 3:-3].mean(0)
    every = {(height, width) for height in (1, 2, 3) for width in (1, 2, 3)}
    measured = f"all {len(every)} shapes of 1 to 3 cells a side occur; away from the edge each cell is blocked in "
    measured += f"{per_cent(inner.min())} to {per_cent(inner.max())} of terrains"
    return Finding(every <= shapes and inner.min() > 0.5 * inner.max(), measured)


def lattice() -> Finding:
    """The fundamental positions stand in 3 rows and 3 columns, equally far apart."""
    terrains = (*drawn("1-1-1"), *drawn("1-2-1"))
    counts = {int(ndimage.label(terrain)[1]) for terrain in terrains}
    measured = f"rows and columns {', '.join(map(str, LATTICE))}; {', '.join(map(str, sorted(counts)))} separate obstacles in "
    measured += f"each of {len(terrains):,} terrains of 1-1-1 and 1-2-1"
    return Finding(counts == {9} and len({*np.diff(LATTICE)}) == 1, measured)


def topology() -> Finding:
    """d_t is the radius of deviation around the fundamental positions."""
    blocked, wanted, longest = {}, {}, LARGEST_SIDE[1]
    for t in (1, 2, 3):
        rows = np.flatnonzero(drawn(f"{t}-1-1").any((0, 2)))
        blocked[f"{t}-1-1"] = (int(rows.min()), int(rows.max()))
        wanted[f"{t}-1-1"] = (LATTICE[0] - t, min(LATTICE[-1] + t + longest - 1, 20))
    text = ", ".join(f"{first} to {last} on {level}" for level, (first, last) in blocked.items())
    measured = f"obstacles of at most {longest} cells a side on rows {LATTICE[0]} to {LATTICE[-1]}, moved by at most d_t, "
    return Finding(blocked == wanted, f"{measured}block rows {text} ({DRAWS:,} terrains each)")


def morphology() -> Finding:
    """d_m decides how large obstacles become."""
    sides, areas = {}, {}
    for level in ("1-1-1", "1-2-1"):
        shapes = np.array([obstacle.shape for obstacle in obstacles(drawn(level))])
        sides[level], areas[level] = int(shapes.max()), float(shapes.prod(1).mean())
    holds = areas["1-2-1"] > areas["1-1-1"] and [*sides.values()] == [*LARGEST_SIDE.values()]
    text = ", ".join(
        f"sides of 1 to {sides[level]} and {areas[level]:.2f} cells in the mean on {level}"
        for level in sides
    )
    return Finding(holds, f"{text} ({DRAWS:,} terrains each)")


def bonus_levels() -> Finding:
    """d_b = 1 gives bonus and penalty, d_b = 2 neither."""
    right = 0
    for name in DIFFICULTIES:
        config = EnvConfig.of(name)
        episode = Episode.begin(config, seed=0)
        episode.step(0)
        wanted = config.n if name.endswith("-1") else 0
        is_paid = config.r_bonus == wanted == -episode.total
        right += is_paid and LEVELS[name].has_bonus == (wanted > 0)
    return Finding(right == 12, f"{right} of 12 levels: n and -n on t-m-1, 0 and 0 on t-m-2")


def combinations() -> Finding:
    """The values of the three elements give 12 levels."""
    names = {f"{t}-{m}-{b}" for t in (1, 2, 3) for m in (1, 2) for b in (1, 2)}
    return Finding(names == set(DIFFICULTIES), f"{len(names)} levels, and `random`")


def entropy(terrains: NDArray[np.bool_]) -> float:
    """The entropy of the cells of terrains, each cell by itself, in bits.

    terrains  bool[count, rows, cols]
    """
    share = terrains.mean(0).clip(1e-12, 1 - 1e-12)
    return float(-(share * np.log2(share) + (1 - share) * np.log2(1 - share)).sum())


def structure() -> Finding:
    """Higher values of d_t and d_m mean obstacles with less structure."""
    bits = {level: entropy(drawn(level)) for level in TERRAINS.values()}
    by_topology = all(bits[f"{t}-{m}-1"] < bits[f"{t + 1}-{m}-1"] for t in (1, 2) for m in (1, 2))
    by_morphology = all(bits[f"{t}-1-1"] < bits[f"{t}-2-1"] for t in (1, 2, 3))
    text = ", ".join(f"{level} {count:.0f}" for level, count in bits.items())
    measured = f"bits of entropy of the cells, each by itself: {text}; `random` {entropy(drawn('random')):.0f}"
    return Finding(by_topology and by_morphology, measured + "; d_b changes no terrain")


def sizes() -> Finding:
    """42x42 and 84x84 grids at level 2-2-1 can be played."""
    points = {side: len(range(LATTICE[0], side, 7)) ** 2 for side in (42, 84)}
    shapes = [Episode.begin(EnvConfig.of("2-2-1", side), seed=0).terrain.shape for side in points]
    text = " and ".join(f"{side}x{side} with {count} obstacles" for side, count in points.items())
    return Finding(shapes == [(42, 42), (84, 84)], f"{text} on the same lattice, 7 cells apart")


def discovered_obstacles(count: int = 100) -> Finding:
    """The discovered obstacles are distributed as drawn (section 3.4), with a rule."""
    seen, there, worst, lowest = 0, 0, 1.0, 1.0
    for level in TERRAINS.values():
        discovered, drawn_there = np.zeros((21, 21)), np.zeros((21, 21))
        for episode in played(EnvConfig.of(level), "frontier-cost", count):
            discovered += episode.codes == OBSTACLE
            drawn_there += episode.terrain
        seen, there = seen + int(discovered.sum()), there + int(drawn_there.sum())
        often = drawn_there >= count // 10
        worst = min(worst, float(np.corrcoef(discovered.ravel(), drawn_there.ravel())[0, 1]))
        lowest = min(lowest, float((discovered[often] / drawn_there[often]).min()))
    measured = f"not with their policy: the rule `frontier-cost` on 6 levels, {count} episodes each, discovered "
    measured += (
        f"{per_cent(seen / there, 1)} of the obstacle cells, and the cell that it saw least often "
    )
    measured += f"{per_cent(lowest)} of the times; "
    measured += f"correlation over the cells of found and drawn at least {worst:.3f}"
    return Finding(worst > 0.95 and lowest > 0.5, measured)


CHECKS: dict[str, Callable[[], Finding]] = {
    "actions": actions,
    "lidar": lidar,
    "state": state,
    "partial-observability": partial_observability,
    "reward": reward,
    "invalid": invalid,
    "bonus": bonus,
    "table-1": table_1,
    "diversity": diversity,
    "random-obstacles": random_obstacles,
    "score-zero": score_zero,
    "score-one": score_one,
    "shares": shares,
    "lattice": lattice,
    "topology": topology,
    "morphology": morphology,
    "bonus-levels": bonus_levels,
    "combinations": combinations,
    "structure": structure,
    "discovered-obstacles": discovered_obstacles,
    "sizes": sizes,
    "cost": cost,
}
"""The claim of docs/paper.md -> its check."""


def run(names: Iterable[str] = CHECKS) -> list[Line]:
    """A line for each check: `kind` "check", `claim`, `holds` and `measured`."""
    findings = ((name, CHECKS[name]()) for name in names)
    return [
        {"kind": "check", "claim": name, "holds": bool(finding.holds), "measured": finding.measured}
        for name, finding in findings
    ]


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(list(CHECKS)), metavar="[NAME]...")
@click.option("--out", type=PATH, help="Also write the lines to this file (JSON Lines).")
def main(names: tuple[str, ...], out: Path | None) -> None:
    """Test the paper's statements on the environment: those named, all without a name."""
    lines = run(names or CHECKS)
    for line in lines:
        held = "holds" if line["holds"] else "does not hold"
        click.echo(f"{line['claim']}: {held}. {line['measured']}.")
    if out is not None:
        write_lines(out, lines)


if __name__ == "__main__":
    main(prog_name="python -m research.paper.claims.checks")
