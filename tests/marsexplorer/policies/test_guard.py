"""The loop guard of a stack of episodes is, by definition, that of each of them."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from marsexplorer.policies.guard import GUARD_STEPS, update_guard


class LiteralGuard:
    """The definition: a pair met before sets the guard off for GUARD_STEPS moves.

    It goes on until something new is known.
    """

    def __init__(self):
        self.met, self.left, self.stuck_at = set(), 0, -1

    def takes_over(self, cell, known_cells):
        if self.left == 0 and (cell, known_cells) in self.met:
            self.left, self.stuck_at = GUARD_STEPS, known_cells
        self.met.add((cell, known_cells))
        if self.left == 0:
            return False
        if self.left > 1 or known_cells != self.stuck_at:
            self.left -= 1
        return True


@settings(deadline=None)
@given(
    st.lists(
        st.lists(st.tuples(st.integers(0, 3), st.booleans()), min_size=3, max_size=3), max_size=80
    )
)
def test_a_stack_is_guarded_as_each_episode_alone(moves):
    """A move is a cell and whether something new is known there; nothing is forgotten."""
    num, cells = 3, 4
    known_before, known_cells = np.full((num, cells), -1), np.zeros(num, np.int64)
    steps_left = np.zeros(num, np.int64)
    known_at_start = np.full(num, -1)
    is_guarded = np.zeros(num, np.bool_)
    literal = [LiteralGuard() for _ in range(num)]
    for row in moves:
        known_cells += [int(grows) for _, grows in row]
        at = np.array([cell for cell, _ in row])
        update_guard(at, known_cells, known_before, steps_left, known_at_start, is_guarded)
        assert is_guarded.tolist() == [
            guard.takes_over(cell, int(k))
            for guard, cell, k in zip(literal, at, known_cells, strict=True)
        ]
