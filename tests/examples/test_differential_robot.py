"""The simulated robot sees as a laser does, hits nothing and maps what it can."""

import importlib.util
import math
from collections import deque
from pathlib import Path

import numpy as np
import pytest

from marsexplorer import policies
from marsexplorer.config import FREE, OBSTACLE, ROVER, UNKNOWN
from marsexplorer.maps import GridMap, write_map

PATH = Path(__file__).parents[2] / "examples" / "differential_robot.py"
CELL_M = 0.5
REACH_M = 3.3

TERRAIN = np.array([[mark == "#" for mark in row] for row in (
    ".....#........",
    ".###.#.####...",
    ".#.#...#..#...",
    ".#.#####..#.#.",
    ".#........#.#.",
    ".##########.#.",
    "............#.",
    ".##..#...####.",
    ".##...........",
)])  # fmt: skip
"""A room within a room, 9 rows of 14 cells; (2, 2) is reached by the way round, and every free cell can be."""


@pytest.fixture(scope="module")
def robots():
    spec = importlib.util.spec_from_file_location("differential_robot", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def explorer_of(robots, terrain, name="frontier-utility", noise=0.05, start=(0, 0)):
    robot = robots.Robot(radius_m=0.4 * CELL_M, wheel_base_m=0.6 * CELL_M, noise=noise)
    world = robots.World(terrain, start, CELL_M, robot, seed=3)
    return robots.Explorer(world, policies.load(name), CELL_M, REACH_M)


def reachable(terrain, start=(0, 0)):
    """Return the free cells connected with the start."""
    reached, queue = {start}, deque([start])
    while queue:
        row, col = queue.popleft()
        for cell in ((row - 1, col), (row, col + 1), (row + 1, col), (row, col - 1)):
            inside = 0 <= cell[0] < terrain.shape[0] and 0 <= cell[1] < terrain.shape[1]
            if inside and cell not in reached and not terrain[cell]:
                reached.add(cell)
                queue.append(cell)
    return reached


def test_a_beam_ends_where_marching_along_it_ends(robots):
    world = explorer_of(robots, TERRAIN, start=(4, 5)).world
    world.pose = (2.9, 2.3, 0.0)
    ranges = world.scan(REACH_M)
    height, distances = TERRAIN.shape[0] * CELL_M, np.arange(0, REACH_M, 0.002)
    walls = np.pad(TERRAIN, 9)  # beyond the map there are none
    for beam in range(0, robots.BEAMS, 13):
        angle = 2 * math.pi * beam / robots.BEAMS
        x, y = 2.9 + distances * math.cos(angle), 2.3 + distances * math.sin(angle)
        hits = walls[((height - y) // CELL_M).astype(int) + 9, (x // CELL_M).astype(int) + 9]
        marched = distances[hits.argmax()] if hits.any() else math.inf
        assert ranges[beam] == pytest.approx(marched, abs=0.003), f"beam {beam}"


@pytest.mark.parametrize("name", ["frontier-cost", "frontier-utility"])
def test_the_robot_knows_in_the_end_every_cell_that_it_can_reach_and_has_hit_nothing(robots, name):
    explorer = explorer_of(robots, TERRAIN, name)
    assert explorer.explore(limit=500)
    codes, cells = explorer.codes, reachable(TERRAIN)
    assert all(codes[cell] in (FREE, ROVER) for cell in cells)
    assert not TERRAIN[codes == FREE].any()
    assert TERRAIN[codes == OBSTACLE].all()
    assert explorer.world.collisions == 0
    assert explorer.world.driven_m > 20 * CELL_M


def test_a_cell_is_known_when_its_pixels_are(robots):
    drawn = np.full((8, 12), robots.CLEAR, np.uint8)
    drawn[0, 0], drawn[1, 1], drawn[6, 9] = robots.NOT_SEEN, robots.OCCUPIED, robots.NOT_SEEN
    codes = robots.cells_known(drawn, (1, 0)).tolist()
    assert codes == [[OBSTACLE, FREE, FREE], [ROVER, FREE, UNKNOWN]]


def test_metres_and_cells_are_two_names_of_one_place(robots):
    assert robots.metres_of((0, 2), 9, 0.5) == (1.25, 4.25)
    assert robots.cell_of((1.25, 4.25, 0.0), 9, 0.5) == (0, 2)


def test_the_wheels_disturb_the_course_and_the_seed_fixes_it(robots):
    courses = []
    for noise in (0.0, 0.1, 0.1):
        explorer = explorer_of(robots, TERRAIN[5:], noise=noise, start=(1, 0))
        assert explorer.explore(limit=200)
        assert not TERRAIN[5:][explorer.codes == FREE].any()
        # At the start, beams meet corners of pixels exactly.
        assert TERRAIN[5:][explorer.codes == OBSTACLE].all()
        courses.append(explorer.course)
    assert courses[0] != courses[1] == courses[2]


def test_a_robot_that_leaves_its_cell_is_seen_to_collide(robots):
    world = explorer_of(robots, TERRAIN).world
    for _ in range(40):
        world.drive(0.5, 0.5)  # north, off the map
    assert world.collisions > 20


def test_the_command_prints_what_the_robot_did_and_writes_a_picture(robots, tmp_path, capsys):
    robots.main(["--size", "8", "--out", str(tmp_path / "robot.png")])
    output = capsys.readouterr().out
    assert output.startswith("explored: ")
    assert " 0 collisions; " in output
    assert (tmp_path / "robot.png").read_bytes().startswith(b"\x89PNG")


def test_the_command_explores_a_map_file(robots, tmp_path, capsys):
    write_map(GridMap(TERRAIN, CELL_M, (0.0, 0.0, 0.0), (8, 0)), tmp_path / "rooms.yaml")
    robots.main(["--map", str(tmp_path / "rooms.yaml"), "--out", str(tmp_path / "robot.png")])
    words = capsys.readouterr().out.split()
    assert (words[0], words[3]) == ("explored:", str(TERRAIN.size))
    assert int(words[1]) >= (~TERRAIN).sum()  # all free cells, and the obstacles that can be seen
