"""A simulated two-wheeled robot with a laser explores a map by a policy's goals.

The map is in metres. No ROS is needed.

    pip install '.[mars]' matplotlib
    python examples/differential_robot.py --policy frontier-priced --out robot.png
    python examples/differential_robot.py --map office.yaml

The policy sees a grid of cells, and the robot moves in metres. Between them stand two functions:
`cells_known` makes the grid of cells from the map that the laser has drawn, and `next_goal` asks
the policy for a goal in metres. The rest is the robot:

1. The laser measures 720 distances all round. It sees no farther than the lidar of the environment.
2. The mapper follows each beam through pixels of a quarter of a cell: free up to the measured
   distance, occupied there.
3. A cell is an obstacle when any of its pixels is occupied, free when all of them are free, and
   unknown otherwise.
4. The path to the goal leads over free cells. The robot turns towards its next corner and drives
   there.

The frame of the map has x to the east and y to the north, in metres, from its south-west corner.
The pose is taken as known, as a localization reports it; `--noise` disturbs what the wheels do, and
the robot corrects it on its way.
"""

import argparse
import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numba import njit

from marsexplorer import policies
from marsexplorer.config import FREE, OBSTACLE, ROVER, UNKNOWN, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.maps import read_map
from marsexplorer.observation import DISPLACEMENTS

PIXELS_PER_CELL = 4
NOT_SEEN, CLEAR, OCCUPIED = range(3)
BEAMS = 720
TIME_STEP_S = 0.05
SCAN_EVERY = 4
"""Time steps from one scan to the next."""
CORNER = 1e-9
"""Pixel sides between two borders that a beam crosses at their corner."""


@njit
def trace_beam(x, y, angle, reach, rows, cols, pixels, distances):
    """Write the pixels that a beam crosses and their distances; return their number.

    x, y, reach  pixel sides from the south-west corner; angle in radians from east,
                 counter-clockwise
    pixels       int64[...], row * cols + col with row 0 in the north
    """
    # Amanatides and Woo 1987: always step over the nearer of the next two pixel borders; over both
    # where they meet, because a pixel that the beam touches in its corner is not crossed, and two
    # pixels with one distance could not be told apart.
    at_x, at_y, dx, dy = math.floor(x), math.floor(y), math.cos(angle), math.sin(angle)
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    per_x, per_y = 1 / max(abs(dx), 1e-12), 1 / max(abs(dy), 1e-12)
    next_x = (at_x + 1 - x if dx > 0 else x - at_x) * per_x
    next_y = (at_y + 1 - y if dy > 0 else y - at_y) * per_y
    count, distance = 0, 0.0
    while distance <= reach and 0 <= at_x < cols and 0 <= at_y < rows:
        pixels[count], distances[count] = (rows - 1 - at_y) * cols + at_x, distance
        count += 1
        distance = min(next_x, next_y)
        if next_x < distance + CORNER:
            next_x, at_x = next_x + per_x, at_x + step_x
        if next_y < distance + CORNER:
            next_y, at_y = next_y + per_y, at_y + step_y
    return count


@njit
def measure(occupied, x, y, reach, ranges, pixels, distances):
    """Write the range of each beam to the first occupied pixel, in pixel sides.

    Infinite if none is within reach.
    """
    rows, cols = occupied.shape
    for beam in range(len(ranges)):
        count = trace_beam(
            x, y, 2 * math.pi * beam / len(ranges), reach, rows, cols, pixels, distances
        )
        ranges[beam] = math.inf
        for k in range(count):
            if occupied[pixels[k] // cols, pixels[k] % cols]:
                ranges[beam] = distances[k]
                break


@njit
def draw_scan(drawn, x, y, reach, ranges, pixels, distances):
    """Draw a scan into the map uint8[rows, cols]: beams CLEAR, their ends OCCUPIED."""
    rows, cols = drawn.shape
    for beam in range(len(ranges)):
        count = trace_beam(
            x, y, 2 * math.pi * beam / len(ranges), reach, rows, cols, pixels, distances
        )
        for k in range(count):
            is_end = distances[k] > ranges[beam] - CORNER / 2
            drawn[pixels[k] // cols, pixels[k] % cols] = OCCUPIED if is_end else CLEAR
            if is_end:
                break


@dataclass(frozen=True)
class Robot:
    """The robot's properties: metres, metres a second.

    `noise` is the standard deviation of a wheel's speed, as a share.
    """

    radius_m: float
    wheel_base_m: float = 0.3
    wheel_speed_mps: float = 0.6
    noise: float = 0.0


class World:
    """The true map with the robot in it: only this part knows what is not yet seen.

    terrain  bool[rows, cols], True where blocked; cell_m is the side of a cell in metres
    pose     x, y in metres and heading in radians from east, counter-clockwise
    """

    def __init__(self, terrain, start, cell_m, robot, seed):
        self.occupied = np.repeat(np.repeat(terrain, PIXELS_PER_CELL, 0), PIXELS_PER_CELL, 1)
        self.pixel_m, self.robot = cell_m / PIXELS_PER_CELL, robot
        self.pose = (*metres_of(start, len(terrain), cell_m), math.pi / 2)
        self.rng = np.random.default_rng(seed)
        self.driven_m, self.time_s, self.collisions = 0.0, 0.0, 0
        self._scratch = (
            np.zeros(sum(self.occupied.shape) + 2, np.int64),
            np.zeros(sum(self.occupied.shape) + 2),
        )

    def scan(self, reach_m):
        """Distances of the beams in metres, float64[BEAMS]; inf without an echo.

        The first beam points east, the others follow counter-clockwise.
        """
        ranges = np.empty(BEAMS)
        x, y = self.pose[0] / self.pixel_m, self.pose[1] / self.pixel_m
        measure(self.occupied, x, y, reach_m / self.pixel_m, ranges, *self._scratch)
        return ranges * self.pixel_m

    def drive(self, left_mps, right_mps):
        """Turn the wheels at these speeds for one time step."""
        left, right = np.array([left_mps, right_mps]) * (
            1 + self.robot.noise * self.rng.standard_normal(2)
        )
        x, y, heading = self.pose
        speed, turn = (left + right) / 2, (right - left) / self.robot.wheel_base_m
        middle = heading + turn * TIME_STEP_S / 2
        x, y = (
            x + speed * math.cos(middle) * TIME_STEP_S,
            y + speed * math.sin(middle) * TIME_STEP_S,
        )
        self.pose = x, y, (heading + turn * TIME_STEP_S + math.pi) % (2 * math.pi) - math.pi
        self.driven_m += abs(speed) * TIME_STEP_S
        self.time_s += TIME_STEP_S
        self.collisions += self._touches_obstacle()

    def _touches_obstacle(self):
        """Whether the robot's disc overlaps an occupied pixel or the edge of the map."""
        rows, cols = self.occupied.shape
        x, y, radius = (length / self.pixel_m for length in (*self.pose[:2], self.robot.radius_m))
        if x < radius or y < radius or x > cols - radius or y > rows - radius:
            return True
        low_row, low_col = int(rows - y - radius), int(x - radius)
        window = self.occupied[low_row : int(rows - y + radius) + 1, low_col : int(x + radius) + 1]
        found_rows, found_cols = np.nonzero(window)
        to_x = np.maximum(0, np.abs(found_cols + low_col + 0.5 - x) - 0.5)
        to_y = np.maximum(0, np.abs(found_rows + low_row + 0.5 - (rows - y)) - 0.5)
        return bool((to_x**2 + to_y**2 < radius**2).any())


class Mapper:
    """The robot's map, uint8[rows, cols] of pixels: NOT_SEEN, CLEAR or OCCUPIED."""

    def __init__(self, shape, pixel_m):
        self.drawn, self.pixel_m = np.zeros(shape, np.uint8), pixel_m
        self._scratch = np.zeros(sum(shape) + 2, np.int64), np.zeros(sum(shape) + 2)

    def add(self, pose, ranges, reach_m):
        """Draw a scan made at a pose."""
        x, y, reach = pose[0] / self.pixel_m, pose[1] / self.pixel_m, reach_m / self.pixel_m
        draw_scan(self.drawn, x, y, reach, ranges / self.pixel_m, *self._scratch)


def metres_of(cell, rows, cell_m):
    """Return (x, y) in metres of the middle of a cell (row, col)."""
    return (cell[1] + 0.5) * cell_m, (rows - cell[0] - 0.5) * cell_m


def cell_of(pose, rows, cell_m):
    """Return the cell (row, col) that a pose lies in."""
    return rows - 1 - int(pose[1] // cell_m), int(pose[0] // cell_m)


def cells_known(drawn, position):
    """A policy's observation, uint8[rows, cols] codes, of a map of pixels.

    The robot is in the cell `position`.
    """
    rows, cols = (side // PIXELS_PER_CELL for side in drawn.shape)
    blocks = drawn.reshape(rows, PIXELS_PER_CELL, cols, PIXELS_PER_CELL)
    codes = np.where((blocks == CLEAR).all((1, 3)), FREE, UNKNOWN).astype(np.uint8)
    codes[(blocks == OCCUPIED).any((1, 3))] = OBSTACLE
    codes[position] = ROVER
    return codes


def next_goal(policy, codes, cell_m):
    """The policy's next goal, as a cell and in metres.

    It is the cell that it goes to, or that of its next move.
    """
    row, col = np.argwhere(codes == ROVER)[0]
    down, right = DISPLACEMENTS[policy.act(codes)]
    goal = policies.goal_of(policy) or (int(row + down), int(col + right))
    return goal, metres_of(goal, len(codes), cell_m)


def paths_from(codes, position, heading=(0, 1)):
    """Each cell within reach over free cells: {cell: cell before}, breadth first.

    Of several shortest paths it is one that begins straight on, `heading` being the last move
    (rows, cols): a turn takes time.
    """
    rows, cols = codes.shape
    before, queue = {position: position}, deque([position])
    while queue:
        row, col = queue.popleft()
        for down, right in sorted(DISPLACEMENTS, key=lambda move: move != heading):
            cell = row + down, col + right
            if (
                0 <= cell[0] < rows
                and 0 <= cell[1] < cols
                and cell not in before
                and codes[cell] == FREE
            ):
                before[cell] = row, col
                queue.append(cell)
    return before


def has_frontier(codes, cells):
    """Whether any of the cells shares an edge with an unknown one (Yamauchi 1997).

    Then there is more to explore.
    """
    unknown = np.pad(codes == UNKNOWN, 1)
    return any(
        unknown[row + 1 + down, col + 1 + right]
        for row, col in cells
        for down, right in DISPLACEMENTS
    )


def wheel_speeds(robot, pose, target):
    """The speeds (left, right) that turn the robot to a target (x, y) and drive there."""
    to_x, to_y = target[0] - pose[0], target[1] - pose[1]
    off = (math.atan2(to_y, to_x) - pose[2] + math.pi) % (2 * math.pi) - math.pi
    speed = min(robot.wheel_speed_mps, 4 * math.hypot(to_x, to_y)) if abs(off) < 0.1 else 0.0
    turn = 4 * off * robot.wheel_base_m / 2
    shrink = min(1.0, robot.wheel_speed_mps / (abs(speed) + abs(turn)))
    return (speed - turn) * shrink, (speed + turn) * shrink


class Explorer:
    """Drives the robot by a policy's goals, only by what the laser has shown.

    It keeps the course for a picture.
    """

    def __init__(self, world, policy, cell_m, reach_m):
        self.world, self.policy, self.cell_m, self.reach_m = world, policy, cell_m, reach_m
        self.mapper = Mapper(world.occupied.shape, world.pixel_m)
        self.course, self.known = [], []
        self.rows = world.occupied.shape[0] // PIXELS_PER_CELL
        self.codes = self.look()

    def look(self):
        """Scan, draw the scan, and return the cells known now."""
        self.mapper.add(self.world.pose, self.world.scan(self.reach_m), self.reach_m)
        self.codes = cells_known(
            self.mapper.drawn, cell_of(self.world.pose, self.rows, self.cell_m)
        )
        self.course.append(self.world.pose)
        self.known.append((self.world.driven_m, int((self.codes != UNKNOWN).sum())))
        return self.codes

    def explore(self, limit):
        """Explore until no free cell within reach borders on an unknown one.

        Return whether that was reached within `limit` cells.
        """
        heading = 0, 1
        for _ in range(limit):
            position = cell_of(self.world.pose, self.rows, self.cell_m)
            before = paths_from(self.codes, position, heading)
            if not has_frontier(self.codes, before):
                return True
            cell, _ = next_goal(self.policy, self.codes, self.cell_m)
            while (
                before[cell] != position
            ):  # the next cell of the path: on the way the map changes, and the goal may too
                cell = before[cell]
            heading = cell[0] - position[0], cell[1] - position[1]
            self._drive_to(metres_of(cell, self.rows, self.cell_m))
        return False

    def _drive_to(self, target):
        """Drive to a target (x, y) in metres, in the same or in the next cell."""
        time_steps = 0
        while math.dist(self.world.pose[:2], target) > 0.04 * self.cell_m:
            self.world.drive(*wheel_speeds(self.world.robot, self.world.pose, target))
            time_steps += 1
            if time_steps % SCAN_EVERY == 0:
                self.look()
        self.look()


def draw(explorer, path):
    """Write a picture: the robot's map and course, and cells known over metres driven."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.colors import ListedColormap

    figure, (left, right) = pyplot.subplots(
        1, 2, figsize=(12, 6), gridspec_kw={"width_ratios": [2, 1]}, layout="constrained"
    )
    drawn, pixel_m = explorer.mapper.drawn, explorer.mapper.pixel_m
    extent = (0, drawn.shape[1] * pixel_m, 0, drawn.shape[0] * pixel_m)
    left.imshow(
        drawn,
        ListedColormap(["#463b36", "#f0e4d7", "#1c1512"]),
        vmin=0,
        vmax=2,
        extent=extent,
        interpolation="nearest",
    )
    xs, ys, _ = zip(*explorer.course, strict=True)
    left.plot(xs, ys, color="#c2561a", linewidth=1.2)
    left.plot(xs[0], ys[0], "o", color="#1f77b4", label="start")
    left.plot(xs[-1], ys[-1], "s", color="#c2561a", label="end")
    left.set(
        xlabel="x (m)",
        ylabel="y (m)",
        title=f"The map drawn by the laser, and the course by {explorer.policy.name}",
    )
    left.legend(loc="lower left")
    metres, cells = zip(*explorer.known, strict=True)
    right.plot(metres, cells, color="#c2561a")
    right.set(xlabel="metres driven", ylabel="cells known", title="Cells known")
    right.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def main(arguments=None):
    """Explore a map, print what it took and write a picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--level", default="random", help="of the terrain, where no map is given")
    parser.add_argument("--map", help="a map_server file (YAML) to explore instead of a level")
    parser.add_argument("--size", type=int, default=30, help="of the terrain: cells a side")
    parser.add_argument("--seed", type=int, default=1, help="of the terrain and of the noise")
    parser.add_argument(
        "--cell",
        type=float,
        help="side of a cell in metres, 0.5 without a map; the robot takes 0.8 of it",
    )
    parser.add_argument(
        "--noise",
        type=float,
        default=0.05,
        help="standard deviation of a wheel's speed, as a share",
    )
    parser.add_argument("--policy", default="frontier-priced", help="a policy's name or file")
    parser.add_argument("--out", default="robot.png", help="picture to write")
    options = parser.parse_args(arguments)

    cell = options.cell or 0.5
    if options.map:
        grid_map = read_map(options.map, options.cell)
        cell = grid_map.cell
        episode = Episode.begin(grid_map.config(), terrain=grid_map.terrain, start=grid_map.start)
    else:
        episode = Episode.begin(EnvConfig.of(options.level, options.size), seed=options.seed)
    robot = Robot(radius_m=0.4 * cell, wheel_base_m=0.6 * cell, noise=options.noise)
    world = World(episode.terrain, episode.start, cell, robot, options.seed)
    policy = policies.load(options.policy)
    policy.reset(options.seed)
    explorer = Explorer(world, policy, cell, (6 + math.sqrt(0.5)) * cell)
    is_done = explorer.explore(limit=4 * episode.terrain.size)
    draw(explorer, options.out)
    known_cells = explorer.known[-1][1]
    print(
        f"{'explored' if is_done else 'stopped'}: {known_cells} of {episode.terrain.size} cells "
        "known"
    )
    print(
        f"{world.driven_m:.1f} m driven in {world.time_s:.0f} s, {world.collisions} collisions; "
        f"picture: {options.out}"
    )


if __name__ == "__main__":
    main()
