"""The order of quadrants on hand-made paths, and the null of random walks."""

from collections import Counter

import numpy as np
import pytest

from research.paper.episodes.quadrants import (
    NO_QUADRANT,
    QuadrantCourse,
    quadrant_course,
    quadrant_map,
    rate_of,
)
from research.paper.episodes.walks import hamiltonian_paths, nearest_walk, random_hamiltonian_path

NW, NE, SE, SW = range(4)


def walk(cols, *corners):
    """The flat cells of a walk from (0, 0) through the corners given, rows first."""
    row, col, cells = 0, 0, [0]
    for to_row, to_col in corners:
        while (row, col) != (to_row, to_col):
            down = int(np.sign(to_row - row))
            row, col = row + down, col + (0 if down else int(np.sign(to_col - col)))
            cells.append(row * cols + col)
    return cells


def are_steps(path, cols):
    row, col = np.divmod(np.asarray(path), cols)
    return (abs(np.diff(row)) + abs(np.diff(col)) == 1).all()


def test_an_odd_side_has_a_middle_that_is_in_no_quadrant_and_an_even_one_has_none():
    assert quadrant_map(3, 4).tolist() == [[NW, NW, NE, NE], [NO_QUADRANT] * 4, [SW, SW, SE, SE]]
    assert quadrant_map(2, 3).tolist() == [[NW, NO_QUADRANT, NE], [SW, NO_QUADRANT, SE]]


@pytest.mark.parametrize(
    ("corners", "code", "makes_u", "never_goes_back"),
    [
        ([(5, 0), (5, 8), (0, 8)], "0321:3", True, True),
        ([(0, 8), (5, 8), (5, 0)], "0123:3", True, True),
        ([(0, 8), (0, 0), (5, 0), (5, 8)], "0132:4", False, False),
        ([(5, 0), (0, 0), (5, 0), (5, 8), (0, 8)], "0321:5", True, False),
        ([(5, 0), (5, 3)], "03:1", False, False),
        ([(5, 0), (5, 4), (5, 0)], "03:1", False, False),
        ([(0, 3)], "0:0", False, False),
    ],
)
def test_courses_of_known_walks(corners, code, makes_u, never_goes_back):
    course = quadrant_course(walk(9, *corners), 6, 9)
    assert (course.code, course.makes_u, course.never_goes_back) == (code, makes_u, never_goes_back)
    assert QuadrantCourse.of_code(code) == course


def test_through_the_middle_cell_three_changes_need_not_be_a_u():
    """From NW by the middle to SE, NE, and by the middle to SW: once each, no U."""
    course = quadrant_course([0, 1, 4, 7, 8, 5, 2, 1, 4, 3, 6], 3, 3)
    assert (course.entered, course.changes) == ((NW, SE, NE, SW), 3)
    assert (course.makes_u, course.never_goes_back) == (False, False)


@pytest.mark.parametrize("code", ["", "0321", "0321:x", "0331:3", "04:1"])
def test_what_is_no_code_is_refused(code):
    with pytest.raises(ValueError, match="code of a course"):
        QuadrantCourse.of_code(code)


def test_a_rate_has_the_interval_of_wilson_and_a_count_of_all_cases_has_none():
    rate = rate_of([True] * 15 + [False] * 133)
    assert (rate.count, rate.total) == (15, 148)
    # Newcombe 1998, table I, method 3
    assert (round(rate.low, 4), round(rate.high, 4)) == (0.0624, 0.1605)
    counted = rate_of([True, False], is_complete=True)
    assert counted.low == counted.high == 0.5
    with pytest.raises(ValueError, match="at least one"):
        rate_of([])


def test_random_hamiltonian_paths_are_equally_likely():
    draws = Counter(tuple(random_hamiltonian_path(4, 4, seed).tolist()) for seed in range(1560))
    assert set(draws) == {tuple(path) for path in hamiltonian_paths(4, 4)}
    chi_square = sum((count - 30) ** 2 / 30 for count in draws.values())
    assert chi_square < 77.4  # the 99 % point for 51 degrees of freedom; the seeds are fixed


def test_walks_begin_in_the_corner_go_a_cell_at_a_time_and_sweep_the_grid():
    path, everywhere = random_hamiltonian_path(6, 9, 5), nearest_walk(6, 9, 0, 1.0, 5)
    assert len(path) == 54
    for walked in (path, everywhere):
        assert walked[0] == 0
        assert set(walked) == set(range(54))
        assert are_steps(walked, 9)
    assert len({tuple(nearest_walk(6, 9, 0, 1.0, seed)) for seed in range(5)}) == 5
    seeing = nearest_walk(6, 9, 3, 0.99, 5)
    assert are_steps(seeing, 9)
    row, col = np.divmod(np.arange(54), 9)
    seen = np.zeros(54, bool)
    for cell in seeing:
        assert seen.sum() < 0.99 * 54
        seen |= (row - cell // 9) ** 2 + (col - cell % 9) ** 2 <= 9
    assert seen.sum() >= 0.99 * 54
