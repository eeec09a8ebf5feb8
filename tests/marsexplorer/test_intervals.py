"""Student's t and Wilson's interval as SciPy has them."""

import math

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from marsexplorer.intervals import t_exceeded, t_quantile, t_tail, wilson_interval

FREEDOMS = st.integers(1, 10_000) | st.floats(0.1, 1e6)


@settings(deadline=None)
@given(FREEDOMS, st.floats(1e-12, 0.49))
def test_the_quantiles_of_student_are_those_of_scipy(freedom, tail):
    expected = scipy.stats.t.isf(tail, freedom)
    assert t_exceeded(freedom, tail) == pytest.approx(expected, rel=1e-10)
    assert t_exceeded(freedom, 0.5) == 0


@pytest.mark.parametrize("freedom", [*range(1, 31), 39.5, 40, 100, 1000, 1e6])
def test_the_quantiles_of_every_confidence_are_those_of_scipy(freedom):
    for confidence in (0.02, 0.1, 0.5, 0.8, 0.9, 0.95, 0.99, 0.999):
        expected = scipy.special.stdtrit(freedom, (1 + confidence) / 2)
        assert t_quantile(freedom, confidence) == pytest.approx(expected, rel=1e-10)


def test_the_quantile_of_no_number_ends_and_is_none():
    assert math.isnan(t_quantile(math.nan))


@settings(deadline=None)
@given(FREEDOMS, st.floats(-100, 100))
def test_the_tail_of_student_is_that_of_scipy(freedom, value):
    expected = scipy.stats.t.sf(value, freedom)
    assert t_tail(value, freedom) == pytest.approx(expected, rel=1e-10, abs=1e-14)


@settings(deadline=None)
@given(st.integers(1, 5000), st.floats(0, 1), st.floats(0.01, 0.9999))
def test_wilson_is_that_of_scipy(total, share, confidence):
    count = round(share * total)
    expected = scipy.stats.binomtest(count, total).proportion_ci(confidence, "wilson")
    assert wilson_interval(count, total, confidence) == pytest.approx(tuple(expected), abs=1e-10)
    assert np.all(np.array(wilson_interval(count, total, confidence)) >= 0)
