"""The generator is SplitMix64 for ever, in Python and in compiled code alike."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from marsexplorer.compiled import kernel
from marsexplorer.random_numbers import (
    below,
    draw_below,
    mix,
    next_number,
    numbered,
    numbered_below,
    uniform,
)

GAMMA, ALL_BITS = 0x9E3779B97F4A7C15, 2**64 - 1


def literal(value):
    """SplitMix64's output for a state, in Python's whole numbers."""
    z = (value + GAMMA) & ALL_BITS
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & ALL_BITS
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & ALL_BITS
    return z ^ (z >> 31)


@kernel
def all_of_them(key, k, limit, state, draws):
    """Write what each compiled function gives."""
    draws[0] = np.float64(numbered(key, k) >> np.uint64(11))
    draws[1] = numbered_below(key, k, limit)
    state[0] = key
    draws[2] = np.float64(next_number(state) >> np.uint64(11))
    draws[3] = below(state, limit)
    draws[4] = uniform(state)


def test_the_generator_never_changes():
    assert mix(0) == 0xE220A8397B1DCDAF  # splitmix64's published first output for seed 0


@settings(deadline=None)
@given(st.integers(-(2**63), 2**65), st.integers(0, 2**64), st.integers(1, 2**32))
def test_python_draws_are_the_literal_ones(seed, counter, limit):
    assert mix(seed) == literal(seed & ALL_BITS)
    expected = literal(literal(seed & ALL_BITS) ^ (counter & ALL_BITS)) * limit >> 64
    assert draw_below(seed, counter, limit) == expected


@settings(deadline=None)
@given(st.integers(0, ALL_BITS), st.integers(1, 2**20), st.integers(1, 2**32))
def test_compiled_draws_are_the_literal_ones(key, k, limit):
    state, draws = np.zeros(1, np.uint64), np.zeros(5)
    all_of_them(np.uint64(key), k, limit, state, draws)
    kth = literal(key + (k - 1) * GAMMA)
    assert draws[0] == kth >> 11
    assert draws[1] == (kth >> 32) * limit >> 32
    assert draws[2] == literal(key) >> 11
    assert draws[3] == (literal(key + GAMMA) >> 32) * limit >> 32
    assert draws[4] == (literal(key + 2 * GAMMA) >> 11) / 2**53
    assert int(state[0]) == (key + 3 * GAMMA) & ALL_BITS
