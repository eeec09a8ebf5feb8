"""The frontier rules by definition, slow, sharing no code with the package.

A map is a list of lists of codes 0 unknown, 1 free, 2 rover, 3 obstacle. Sight is decided by
clipping the segment between two centres against each obstacle's open square, in fractions.
"""

import math
from fractions import Fraction
from functools import cache
from itertools import product

from tests.support.reference import crosses_interior

DISPLACEMENTS = [(-1, 0), (0, 1), (1, 0), (0, -1)]


def expected_discoveries(grid, row, col, radius):
    """How many unknown cells are in sight of (row, col), unknown ones transparent."""
    return len(expected_cells(grid, row, col, radius))


def expected_cells(grid, row, col, radius):
    """Those cells, [(row, col)]."""
    cells = []
    for r, line in enumerate(grid):
        for c, code in enumerate(line):
            d_row, d_col = r - row, c - col
            if code != 0 or d_row**2 + d_col**2 > radius**2:
                continue
            if not any(
                grid[b_row][b_col] == 3
                and crosses_interior((d_row, d_col), (b_row - row, b_col - col))
                for b_row in range(min(r, row), max(r, row) + 1)
                for b_col in range(min(c, col), max(c, col) + 1)
                if (b_row, b_col) != (r, c)
            ):
                cells.append((r, c))
    return cells


def distances(grid, start):
    """Moves to every cell in reach over known free cells: {(row, col): moves}."""
    moves, edge = {start: 0}, [start]
    while edge:
        edge = [
            moves.setdefault(near, moves[cell] + 1) and near
            for cell in edge
            for near in neighbours(grid, cell)
            if near not in moves
        ]
    return moves


def neighbours(grid, cell):
    for d_row, d_col in DISPLACEMENTS:
        r, c = cell[0] + d_row, cell[1] + d_col
        if 0 <= r < len(grid) and 0 <= c < len(grid[0]) and grid[r][c] in (1, 2):
            yield r, c


def touches_unknown(grid, cell):
    return any(
        grid[r][c] == 0
        for r in range(max(0, cell[0] - 1), min(len(grid), cell[0] + 2))
        for c in range(max(0, cell[1] - 1), min(len(grid[0]), cell[1] + 2))
    )


def decide(grid, visited, rover, heading, radius, rule):
    """The action of `cost` or `utility`, or None when there is no candidate."""
    reach = distances(grid, rover)
    fresh = [cell for cell in reach if cell not in visited]
    discoveries = {cell: expected_discoveries(grid, *cell, radius) for cell in fresh}
    shows = [cell for cell, new in discoveries.items() if new]

    def place(cell):
        return -Fraction(discoveries[cell], reach[cell] ** 2), reach[cell], cell

    if rule == "cost":
        goals = [cell for cell in shows if touches_unknown(grid, cell)] or shows
        nearest = min((reach[cell] for cell in goals), default=None)
        goals = [cell for cell in goals if reach[cell] == nearest]
    else:
        goals = sorted(shows, key=place)[:1]
    return first_action(grid, rover, heading, reach, goals)


def first_action(grid, rover, heading, reach, goals):
    """The action that begins a shortest path to one of the goals, or None.

    Straight on, else north, east, south, west.
    """
    for action in [heading, 0, 1, 2, 3]:
        near = (rover[0] + DISPLACEMENTS[action][0], rover[1] + DISPLACEMENTS[action][1])
        ways = ((distances(grid, goal).get(near), reach[goal] - 1) for goal in goals)
        if near in reach and any(way == wanted for way, wanted in ways):
            return action
    return None


def decide_priced(grid, visited, rover, heading, radius, rule):
    """The action of the priced rule, or None.

    rule  its parameters for a radius of 6, by name
    """
    reach = distances(grid, rover)
    priced = cache(lambda u: price(grid, u, radius, rule))
    values = {}
    for cell, way in reach.items():
        shown = [] if cell in visited else expected_cells(grid, *cell, radius)
        if shown:
            total = sum(priced(u) * fade(u, cell, radius, rule) for u in shown)
            limit = round(rule["limit"] * 1024 * 64)
            values[cell] = min(total, limit) * (way + rule["offset"]) ** -rule["power"]
    goals = sorted(values, key=lambda cell: (-values[cell], reach[cell], cell))[:1]
    return first_action(grid, rover, heading, reach, goals)


def price(grid, cell, radius, rule):
    """What an unknown cell counts, in 1024ths."""
    rows, cols = len(grid), len(grid[0])

    def is_unknown(place):
        row, col = place
        return 0 <= row < rows and 0 <= col < cols and grid[row][col] == 0

    total = 1024
    for half, weight, power in zip((2, 6, 12), rule["weights"], rule["powers"], strict=True):
        square = around(cell, max(1, round(half * radius / 6)))
        unknown = sum(map(is_unknown, square))
        total += round(1024 * weight * (1 - unknown / len(square)) ** power)
    region, edge = {cell}, [cell]
    while edge:
        near = around(edge.pop(), 1)
        new = [place for place in near if is_unknown(place) and place not in region]
        region.update(new)
        edge += new
    shrunk = math.exp(-len(region) / (rule["pocket_cells"] * (radius / 6) ** 2))
    return total + round(1024 * rule["pocket"] * shrunk)


def around(cell, side):
    """The cells of the square of half side `side` round a cell, also off the grid."""
    row, col = cell
    return [*product(range(row - side, row + side + 1), range(col - side, col + side + 1))]


def fade(cell, viewer, radius, rule):
    """What is left of a price over the distance, in 64ths."""
    return round(64 * math.exp(-rule["fade"] * 6 / radius * max(0, math.dist(cell, viewer) - 1)))
