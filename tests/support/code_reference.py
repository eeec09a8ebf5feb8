"""The authors' environment, literally and slowly, from `marsexplorer.compat`."""

import math
import random
from fractions import Fraction

import numpy as np

MOVES = ((1, 0), (-1, 0), (0, 1), (0, -1))
CLASSES = {"exploConf": (0.99, 0.6), "explorer": (0.95, 0.5)}
"""Preset -> the share that completes, and the rover's value after a move."""


def line(x, y, angle, length, rows, cols):
    """The cells of 200 points from the centre of a cell."""
    ends = x + length * np.cos(angle), y + length * np.sin(angle)
    along = (np.linspace(start, end, 200) for start, end in zip((x, y), ends, strict=True))
    sides = rows, cols
    return list(
        zip(
            *(
                np.clip(np.round(points), 0, side - 1).astype(int).tolist()
                for points, side in zip(along, sides, strict=True)
            ),
            strict=True,
        )
    )


class Twin:
    """One episode on a given terrain, a list of lists with True where blocked."""

    def __init__(self, conf, terrain, preset="exploConf"):
        self.conf, self.terrain = conf, terrain
        self.rows, self.cols = conf["size"]
        self.share, self.rover = CLASSES[preset]
        self.x, self.y = conf["initial"]
        self.known = {}
        self.moves = 0
        self.scan()

    def reach(self, angle):
        length, shorter = self.conf["lidar_range"], min(self.rows, self.cols)
        cells = line(self.x, self.y, angle, length, self.rows, self.cols)
        limited = [(min(x, shorter), min(y, shorter)) for x, y in cells]
        distances = [math.hypot(x - self.x, y - self.y) for x, y in limited if self.terrain[x][y]]
        if not distances:
            return length
        return math.floor(min(distances)) if isinstance(length, int) else min(distances)

    def scan(self):
        channels = self.conf["lidar_channels"]
        for k in range(channels):
            angle = k * (2 * np.pi / channels)
            length = min(self.reach(angle) + 0.5, self.conf["lidar_range"])
            for x, y in line(self.x, self.y, angle, length, self.rows, self.cols):
                self.known[x, y] = 1.0 if self.terrain[x][y] else 0.3
        self.known[self.x, self.y] = 0.6

    def observation(self):
        matrix = np.zeros((self.rows, self.cols, 1))
        for cell, shade in self.known.items():
            matrix[cell] = shade
        matrix[self.x, self.y] = self.rover if self.moves else 0.6
        return matrix

    def step(self, action):
        dx, dy = MOVES[action]
        x, y = self.x + dx, self.y + dy
        leaves = not (0 <= x < self.rows and 0 <= y < self.cols)
        collides = not leaves and self.terrain[x][y]
        if not leaves and not collides:
            self.x, self.y = x, y
        before = len(self.known)
        self.moves += 1
        self.scan()
        ends = (
            (self.moves > self.conf["max_steps"], None),
            (len(self.known) > self.share * self.rows * self.cols, "bonus_reward"),
            (collides, "collision_reward"),
            (leaves, "out_of_bounds_reward"),
        )
        name = next((name for holds, name in ends if holds), None)
        reward = len(self.known) - before - self.conf["movementCost"]
        return self.observation(), self.conf[name] if name else reward, any(h for h, _ in ends)


def shift(noise):
    least, most = -math.floor(noise), math.ceil(noise) - 1
    return random.randint(least, max(least, most))


def draw(conf):
    """The blocked cells of a terrain."""
    rows, cols = conf["size"]
    (first, second), sides = conf["margins"], conf["obstacle_size"]
    obstacles = []
    if conf["number_rows"] is None:
        for _ in range(conf["obstacles"]):
            y, x = (
                random.randint(first, cols - 2 - first),
                random.randint(second, rows - 2 - second),
            )
            obstacles.append((x, y, random.randint(*sides), random.randint(*sides)))
    else:
        for row in spaced(first, rows, conf["number_rows"]):
            for col in spaced(second, cols, conf["number_columns"]):
                x = min(max(row + shift(conf["noise"][0]), 0), rows - 1)
                y = min(max(col + shift(conf["noise"][1]), 0), cols - 1)
                height, width = (random.randint(1, side - 1) for side in sides)
                obstacles.append((x, y, height, width))
    return {
        (min(x + i, rows - 1), min(y + j, cols - 1))
        for x, y, height, width in obstacles
        for i in range(max(1, height))
        for j in range(max(1, width))
    }


def spaced(margin, side, count):
    """Whole numbers evenly spaced within the margins, fractions cut off."""
    gap = Fraction(side - 1 - 2 * margin, max(1, count - 1))
    return [int(margin + k * gap) for k in range(count)]
