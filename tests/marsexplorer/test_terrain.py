"""Terrains: a pure function of the seed, as documented, always solvable."""

import hashlib
import re
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings

from marsexplorer import bitmap
from marsexplorer import terrain as terrains
from marsexplorer.bitmap import fill_runs
from marsexplorer.compiled import kernel
from marsexplorer.config import LEVELS, MAX_SEED, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.terrain import attempts, generate, next_seed
from tests.support import reference, strategies


@settings(max_examples=80, deadline=None)
@given(strategies.configs(max_side=26), strategies.seeds)
def test_the_compiled_generator_draws_what_the_documentation_says(config, seed):
    shape, sight = (config.rows, config.cols), (config.sensor_radius, config.beta)
    literal = reference.terrain_of(config.level, *shape, seed, *sight)
    if literal is None:
        with pytest.raises(ValueError, match="no solvable terrain"):
            generate(config, seed)
    else:
        assert (generate(config, seed) == literal).all()


@pytest.mark.parametrize("level", sorted(LEVELS))
def test_every_terrain_is_solvable_at_the_sizes_of_the_paper(level):
    for size, seeds in (((21, 21), 6), ((42, 42), 3), ((70, 84), 1)):
        for seed in range(seeds):
            terrain = generate(EnvConfig.of(level, size), seed)
            assert reference.is_solvable(terrain, 6, 0.99), (size, seed)


@pytest.mark.parametrize("radius", [1, 2, 3])
def test_the_rule_for_what_can_be_discovered_holds_for_dense_terrains(radius):
    rng = np.random.default_rng(radius)
    agreed = {True: 0, False: 0}
    for _ in range(200):
        rows, cols = rng.integers(5, 12).item(), rng.integers(5, 12).item()
        config = EnvConfig("random", rows, cols, radius, float(rng.choice([0.8, 0.9, 0.97])))
        terrain = rng.random((rows, cols)) < rng.choice([0.05, 0.2, 0.35])
        bits = bitmap.pack(terrain, config)
        shape = (bitmap.shape_of(config), bitmap.row_masks(config))
        solvable = bool(is_solvable(bits, np.zeros_like(bits), *shape))
        assert solvable == reference.is_solvable(terrain, radius, config.beta)
        agreed[solvable] += 1
    assert min(agreed.values()) > 10


@kernel
def filled_runs(reached, free):
    """`fill_runs` by itself."""
    return fill_runs(reached, free)


@kernel
def is_solvable(bits, reach, shape, masks):
    """Do `terrain.is_solvable` for one terrain in arrays of its own."""
    return terrains.is_solvable(bits, 0, reach, 0, shape, masks)


def test_terrains_stay_the_same_for_ever():
    digest = hashlib.sha256()
    for level in sorted(LEVELS):
        for size in ((21, 21), (13, 70), (84, 30)):
            for seed in (0, 7, MAX_SEED):
                digest.update(np.packbits(generate(EnvConfig.of(level, size), seed)).tobytes())
    assert digest.hexdigest() == "66983179ff197e579b51bd3239ba5880efdf2886ea3f3d765118a9eb2c11a14d"


def test_no_solvable_draw_is_a_clear_error():
    config = EnvConfig.of("3-2-1", (60, 84), beta=1.0)
    assert attempts(config, 1) == 0
    with pytest.raises(ValueError, match="choose another seed, a smaller size or a lower beta"):
        generate(config, 1)
    with pytest.raises(ValueError, match="with seed 1,"):
        Episode.begin(config, seed=1)


def test_seeds_follow_one_another_within_range():
    seed, seen = 0, set()
    for _ in range(1000):
        seed = next_seed(seed)
        assert 0 <= seed <= MAX_SEED
        seen.add(seed)
    assert len(seen) == 1000
    assert next_seed(0) == reference.mix(reference.GOLDEN) >> 11


@pytest.mark.parametrize(
    ("seed", "error"), [(-1, ValueError), (2**53, ValueError), (1.5, TypeError), (True, TypeError)]
)
def test_a_bad_seed_is_refused(seed, error):
    with pytest.raises(error, match="seed must be"):
        generate(EnvConfig(), seed)


def test_packing_is_undone_by_unpacking():
    for size, radius in (((5, 9), 1), ((21, 21), 6), ((7, 70), 8), ((12, 200), 31)):
        config = EnvConfig.of("random", size, sensor_radius=radius)
        cells = np.random.default_rng(1).random(size) < 0.5
        assert (bitmap.unpack(bitmap.pack(cells, config), config) == cells).all()


def filled(reached, free):
    """The free bits connected with a reached one, run by run, by definition."""
    runs = [(match.start(), match.end()) for match in re.finditer("1+", f"{free:064b}")]
    of_run = [((1 << 64 - a) - 1) & ~((1 << 64 - b) - 1) for a, b in runs]
    return sum(run for run in of_run if run & reached)


def test_runs_of_free_bits_are_filled_from_any_of_their_bits():
    random = Random(5)
    for _ in range(1500):
        free = random.getrandbits(64) | random.getrandbits(64) * (random.random() < 0.7)
        reached = free & (random.getrandbits(64) | random.choice([0, random.getrandbits(64)]))
        assert filled_runs(np.uint64(reached), np.uint64(free)) == filled(reached, free)
