"""Alpha spending against published constants and against simulation, and what the intervals at looks are worth."""

import numpy as np
import pytest

from app.statistics.sequential import boundaries, spent_alpha

PUBLISHED = {
    # DeMets and Lan 1994, Statist. Med. 13(13-14), two-sided 0.05; the first column also from gsDesign (sfLDOF, sfLDPocock)
    ("obrien-fleming", 5): (4.8769, 3.3569, 2.6803, 2.2898, 2.0310),
    ("obrien-fleming", 4): (4.3326, 2.9631, 2.3590, 2.0141),
    ("obrien-fleming", 2): (2.9626, 1.9686),
    ("pocock", 5): (2.4380, 2.4268, 2.4101, 2.3966, 2.3859),
    ("pocock", 2): (2.1570, 2.2010),
}


@pytest.mark.parametrize(("spending", "looks"), PUBLISHED)
def test_boundaries_are_the_published_ones(spending, looks):
    found = boundaries(spending, [look / looks for look in range(1, looks + 1)])
    assert [each.z for each in found] == pytest.approx(PUBLISHED[spending, looks], abs=2e-4)
    assert found[-1].spent == pytest.approx(0.05)


def test_one_look_at_the_end_is_no_sequential_study():
    for spending in ("obrien-fleming", "pocock"):
        (only,) = boundaries(spending, [1.0])
        assert (only.z, only.confidence) == (pytest.approx(1.959964), pytest.approx(0.95))


def test_the_boundaries_of_uneven_looks_hold_in_simulation():
    fractions = (0.3, 0.45, 0.9, 1.0)
    steps = np.sqrt(np.diff((0.0, *fractions)))
    walks = (np.random.default_rng(3).standard_normal((400_000, 4)) * steps).cumsum(1) / np.sqrt(
        fractions
    )
    for spending in ("obrien-fleming", "pocock"):
        found = boundaries(spending, fractions)
        crossed = np.logical_or.accumulate(np.abs(walks) > [each.z for each in found], axis=1).mean(
            0
        )
        assert crossed == pytest.approx([each.spent for each in found], abs=0.001)
        assert [each.spent for each in found] == pytest.approx(
            [spent_alpha(spending, each) for each in fractions]
        )


def test_so_early_a_look_that_nothing_may_be_concluded():
    (first, last) = boundaries("obrien-fleming", [0.01, 1.0])
    assert (first.z, first.confidence) == (float("inf"), 1.0)
    assert last.z == pytest.approx(1.96, abs=1e-3)


@pytest.mark.parametrize("fractions", [(), (0.0, 1.0), (0.5, 0.5), (0.5, 1.1), (0.6, 0.3)])
def test_looks_that_cannot_be_are_refused(fractions):
    with pytest.raises(ValueError, match="must rise"):
        boundaries("pocock", fractions)
    with pytest.raises(ValueError, match=r"0\.\.1"):
        spent_alpha("pocock", 1.5)
