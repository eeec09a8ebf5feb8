"""Lidar, rules and terrains, slow and literal, sharing no code with the package."""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import numpy as np

MASK = 2**64 - 1
GOLDEN = 0x9E3779B97F4A7C15


@cache
def crosses_interior(target, square):
    """Whether the line from cell (0, 0) to `target` meets the inside of `square`.

    The segment is t * target for 0 < t < 1; the square is |row - r| < 1/2, |col - c| < 1/2. Each
    axis limits t to an open interval; the segment meets the square when the intervals and (0, 1)
    have a common point.
    """
    low, high = Fraction(0), Fraction(1)
    for direction, centre in zip(target, square, strict=True):
        near, far = Fraction(2 * centre - 1, 2), Fraction(2 * centre + 1, 2)
        if direction == 0:
            if not near < 0 < far:
                return False
            continue
        ends = sorted((near / direction, far / direction))
        low, high = max(low, ends[0]), min(high, ends[1])
    return low < high


@cache
def lines_of_sight(radius):
    """The offsets whose interior the line of sight to each offset crosses."""
    offsets = [(r, c) for r in range(-radius, radius + 1) for c in range(-radius, radius + 1)]
    return {
        q: [b for b in offsets if b not in ((0, 0), q) and crosses_interior(q, b)]
        for q in offsets
        if q[0] ** 2 + q[1] ** 2 <= radius**2
    }


def visible(terrain, row, col, radius):
    """bool[rows, cols]: what the lidar at (row, col) sees."""
    rows, cols = terrain.shape
    seen = np.zeros_like(terrain)
    for (dr, dc), between in lines_of_sight(radius).items():
        r, c = row + dr, col + dc
        if 0 <= r < rows and 0 <= c < cols:
            seen[r, c] = not any(terrain[row + br, col + bc] for br, bc in between)
    return seen


def visible_from_everywhere(terrain, radius):
    """`visible` for every cell at once: bool[rows, cols, rows, cols].

    One shifted map for each cell that a line crosses.
    """
    rows, cols = terrain.shape
    padded = np.pad(terrain, radius)

    def shifted(dr, dc):
        return padded[radius + dr : radius + dr + rows, radius + dc : radius + dc + cols]

    seen = np.zeros((rows, cols, rows, cols), bool)
    r, c = np.indices((rows, cols))
    for (dr, dc), between in lines_of_sight(radius).items():
        clear = (r + dr >= 0) & (r + dr < rows) & (c + dc >= 0) & (c + dc < cols)
        for br, bc in between:
            clear = clear & ~shifted(br, bc)
        at_r, at_c = np.nonzero(clear)
        seen[at_r, at_c, at_r + dr, at_c + dc] = True
    return seen


class World:
    """The rules of section 2, with a set of discovered cells and plain conditions."""

    def __init__(self, terrain, radius=6, beta=0.99, max_steps=None, pays=True, start=(0, 0)):
        self.terrain, self.radius, self.beta = terrain, radius, beta
        self.n = terrain.size
        self.max_steps = self.n if max_steps is None else max_steps
        self.bonus = self.n if pays else 0
        self.position, self.steps, self.total, self.outcome = start, 0, 0.0, None
        self.discovered = set()
        self.scan()

    def scan(self):
        before, seen = len(self.discovered), visible(self.terrain, *self.position, self.radius)
        self.discovered |= set(zip(*np.nonzero(seen), strict=True))
        return len(self.discovered) - before

    def step(self, action):
        dr, dc = [(-1, 0), (0, 1), (1, 0), (0, -1)][action]
        row, col = self.position[0] + dr, self.position[1] + dc
        self.steps += 1
        if not (0 <= row < self.terrain.shape[0] and 0 <= col < self.terrain.shape[1]):
            self.outcome, reward = "out_of_bounds", -float(self.bonus)
        elif self.terrain[row, col]:
            self.outcome, reward = "collided", -float(self.bonus)
        else:
            self.position = (row, col)
            reward = self.scan() - 0.5
            if len(self.discovered) / self.n >= self.beta:
                self.outcome, reward = "explored", reward + self.bonus
            elif self.steps >= self.max_steps:
                self.outcome = "timed_out"
        self.total += reward
        return reward

    def observation(self):
        state = np.zeros(self.terrain.shape, np.float32)
        for cell in self.discovered:
            state[cell] = 1.0 if self.terrain[cell] else 0.3
        state[self.position] = 0.6
        return state


def mix(z):
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


def numbers(seed, draw):
    """An iterator over the generator's numbers, below a changing bound.

    A function of m gives the next whole number below m.
    """
    key, k = mix((mix((seed + GOLDEN) & MASK) + draw) & MASK), 0

    def below(m):
        nonlocal k
        k += 1
        return ((mix((key + k * GOLDEN) & MASK) >> 32) * m) >> 32

    return below


def draw_terrain(level, rows, cols, seed, draw):
    if level in ("building", "cave"):
        return (draw_building if level == "building" else draw_cave)(rows, cols, seed, draw)
    below = numbers(seed, draw)
    terrain = np.zeros((rows, cols), bool)
    if level == "random":
        for _ in range(max(1, round(Fraction(12 * rows * cols, 441)))):
            height, width = 1 + below(3), 1 + below(3)
            top, left = below(rows - height + 1), below(cols - width + 1)
            terrain[top : top + height, left : left + width] = True
        return terrain
    t, m = int(level[0]), int(level[2])
    for row in range(3, rows, 7):
        for col in range(3, cols, 7):
            r, c = row + below(2 * t + 1) - t, col + below(2 * t + 1) - t
            height, width = 1 + below(2 * m if m == 2 else 2), 1 + below(2 * m if m == 2 else 2)
            top, left = r - (height - 1) // 2, c - (width - 1) // 2
            terrain[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)] = True
    return terrain


def draw_building(rows, cols, seed, draw):
    """Recursive division into rooms with doorways and corridors, on lists of cells."""
    below = numbers(seed, draw)
    terrain = np.zeros((rows, cols), bool)

    def wall(cells):
        for row, col in cells:
            terrain[row, col] = True
        for _ in range(1 + (below(2) if len(cells) >= 9 else 0)):
            terrain[cells[2 * below((len(cells) + 1) // 2)]] = False

    def divide(top, left, bottom, right):
        height, width = bottom - top, right - left
        if max(height, width) <= 6 + below(5):
            if min(height, width) >= 5 and below(3) > 0:
                tall, wide = 1 + below(height - 2), 1 + below(width - 2)
                at = top + 1 + below(height - 1 - tall), left + 1 + below(width - 1 - wide)
                terrain[at[0] : at[0] + tall, at[1] : at[1] + wide] = True
            return
        side, other = max(height, width), min(height, width)
        corridor = 1 + 2 * below(2) if other >= 13 else 0
        thickness = corridor + 2 if corridor else 1
        cut = 3 + 2 * below((side - thickness - 6) // 2 + 1)
        for place in (cut, cut + thickness - 1) if corridor else (cut,):
            if height >= width:
                wall([(top + place, c) for c in range(left, right)])
            else:
                wall([(r, left + place) for r in range(top, bottom)])
        if height >= width:
            first, second = (
                (top, left, top + cut, right),
                (top + cut + thickness, left, bottom, right),
            )
        else:
            first, second = (
                (top, left, bottom, left + cut),
                (top, left + cut + thickness, bottom, right),
            )
        parts = (first, second) if cut <= side - cut - thickness else (second, first)
        for part in parts:
            divide(*part)

    divide(0, 0, rows, cols)
    return terrain


def draw_cave(rows, cols, seed, draw):
    """A cellular automaton with rock all round, connected to a mouth in the corner."""
    below = numbers(seed, draw)
    rock = np.array([[below(100) < 43 for _ in range(cols)] for _ in range(rows)])
    for _ in range(4):
        padded = np.pad(rock, 1, constant_values=True)
        squares = (padded[r : r + rows, c : c + cols] for r in range(3) for c in range(3))
        rock = sum(square.astype(int) for square in squares) >= 5
    for step in range(rows + cols):
        row, col = step // 2, (step + 1) // 2
        if row >= rows or col >= cols or not rock[row, col]:
            break
        rock[row, col] = False
    inside = reached_from(rock, (0, 0))
    return np.array([[(row, col) not in inside for col in range(cols)] for row in range(rows)])


def reached_from(terrain, start):
    """The cells that moves lead to from a free cell."""
    reached, edge = {start}, [start]
    while edge:
        row, col = edge.pop()
        for r, c in ((row - 1, col), (row, col + 1), (row + 1, col), (row, col - 1)):
            is_inside = 0 <= r < terrain.shape[0] and 0 <= c < terrain.shape[1]
            if is_inside and not terrain[r, c] and (r, c) not in reached:
                reached.add((r, c))
                edge.append((r, c))
    return reached


def is_solvable(terrain, radius, beta):
    """Start free, all free cells reached by flood, and enough cells seen."""
    if terrain[0, 0]:
        return False
    reached = reached_from(terrain, (0, 0))
    if len(reached) != int((~terrain).sum()):
        return False
    seen = visible_from_everywhere(terrain, radius)[~terrain].any(axis=0)
    return seen.sum() / terrain.size >= beta


def terrain_of(level, rows, cols, seed, radius=6, beta=0.99):
    for draw in range(1000):
        terrain = draw_terrain(level, rows, cols, seed, draw)
        if is_solvable(terrain, radius, beta):
            return terrain
    return None
