"""Valid moves stay on the grid and off known obstacles, for one rover or many."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from marsexplorer.observation import DISPLACEMENTS, action_masks, valid_actions


def literal(codes, row, col):
    rows, cols = codes.shape
    places = [(row + down, col + right) for down, right in DISPLACEMENTS]
    return [0 <= r < rows and 0 <= c < cols and codes[r, c] != 3 for r, c in places]


@settings(deadline=None)
@given(arrays(np.uint8, (3, 4, 6), elements=st.integers(0, 3)), st.data())
def test_masks_and_actions_are_the_literal_ones(codes, data):
    positions = np.array(
        [[data.draw(st.integers(0, 3)), data.draw(st.integers(0, 5))] for _ in codes]
    )
    expected = [literal(grid, *position) for grid, position in zip(codes, positions, strict=True)]
    assert action_masks(codes, positions).tolist() == expected
    for grid, (row, col), mask in zip(codes, positions.tolist(), expected, strict=True):
        assert valid_actions(grid, row, col) == [action for action in range(4) if mask[action]]
