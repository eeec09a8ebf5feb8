"""Random numbers that stay the same for ever: SplitMix64, written out.

Steele, Lea and Flood 2014, "Fast splittable pseudorandom number generators". No library version can
change what a seed gives, and the n-th number of a stream needs none of those before it. The streams
of terrains, planners, searches and synthetic players all come from here. Everything is modulo 2^64:

    finalize(z)              z ^= z >> 30; z *= 0xBF58476D1CE4E5B9; z ^= z >> 27; z *=
                             0x94D049BB133111EB; z ^ z >> 31
    numbered(key, k)         finalize(key + k GAMMA): the k-th number (k = 1, 2, ...) of the stream
                             that a key names
    next_number(state)       the same, with a running key in uint64[1]
    scaled(number, limit)    a whole number below the limit: the upper 32 bits times the limit,
                             shifted right by 32

`mix` and `draw_below` are for Python, the others for compiled code.
"""

from __future__ import annotations

import numpy as np

from marsexplorer.compiled import inlined, kernel

GAMMA = np.uint64(0x9E3779B97F4A7C15)
"""The odd step of the counter: 2^64 divided by the golden ratio."""

MASK64 = 2**64 - 1


@inlined
def finalize(z):
    """64 well-mixed bits of a uint64."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@inlined
def numbered(key, k):
    """The k-th number, uint64, k = 1, 2, ..., of the stream that a uint64 names."""
    return finalize(key + np.uint64(k) * GAMMA)


@inlined
def next_number(state):
    """The next number, uint64, of the stream whose running key is state, uint64[1]."""
    state[0] += GAMMA
    return finalize(state[0])


@inlined
def scaled(number, limit):
    """A whole number in 0..limit-1 (int64) from 64 random bits; limit is at most 2^32."""
    return np.int64(((number >> np.uint64(32)) * np.uint64(limit)) >> np.uint64(32))


@kernel
def numbered_below(key, k, limit):
    """The k-th whole number in 0..limit-1 (int64) of the stream that a uint64 names."""
    return scaled(numbered(key, k), limit)


@inlined
def below(state, limit):
    """The next whole number in 0..limit-1 (int64) of a stream.

    state  uint64[1], the running key
    """
    return scaled(next_number(state), limit)


@inlined
def uniform(state):
    """The next float64 in [0, 1) of the stream whose running key is state, uint64[1]."""
    return np.float64(next_number(state) >> np.uint64(11)) / 9007199254740992.0


@kernel
def first_number(key):
    """The first number, uint64, of the stream that a key (uint64) names."""
    return finalize(key + GAMMA)


def mix(name: int) -> int:
    """The first number of a stream, 0..2^64-1, named by the lowest 64 bits of `name`."""
    return int(first_number(np.uint64(int(name) & MASK64)))


def draw_below(seed: int, counter: int, limit: int) -> int:
    """The counter-th whole number in 0..limit-1 of the stream that `seed` names."""
    return (mix(mix(seed) ^ (int(counter) & MASK64)) * limit) >> 64
