"""Places that one survey has missed, against windows counted one by one, and what chance makes."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.missed_places import MISSED, missed_places


def by_hand(first, second, most):
    """The same with loops."""
    rows, columns = first.shape
    missed = np.zeros(first.shape, dtype=bool)

    def total(counts, i, j, reach):
        return counts[max(i - reach, 0) : i + reach + 1, max(j - reach, 0) : j + reach + 1].sum()

    for i in range(rows):
        for j in range(columns):
            for reach in [r for r in (1, 2, 4, 8) if r <= most]:
                for own, other in ((first, second), (second, first)):
                    around = [total(c, i, j, 8 * reach) for c in (own, other)]
                    seen = total(other, i, j, reach)
                    if total(own, i, j, reach) == 0 and seen and seen * around[0] >= MISSED * around[1]:
                        missed[i, j] = True
    return missed


@pytest.mark.parametrize("most", [1, 4])
def test_windows_are_those_counted_one_by_one(most):
    rng = np.random.default_rng(1)
    first, second = rng.poisson(1.5, (30, 40)), rng.poisson(2.5, (30, 40))
    second[8:16, 10:19] = 0
    first[20:23, 25:28] = 0
    found = missed_places(first, second, most, np.ones(first.shape, dtype=bool))
    assert np.array_equal(found, by_hand(first, second, most))
    assert found[12, 14]
    within = np.zeros(first.shape, dtype=bool)
    within[:, :12] = True
    assert np.array_equal(missed_places(first, second, most, within), found & within)


@pytest.mark.parametrize(("first", "second"), [(0.3, 0.3), (2.0, 0.2), (0.1, 3.0)])
def test_chance_leaves_out_hardly_a_cell_whatever_the_densities(first, second):
    rng = np.random.default_rng(2)
    counts = rng.poisson(first, (300, 300)), rng.poisson(second, (300, 300))
    assert missed_places(*counts, 8, np.ones((300, 300), dtype=bool)).mean() < 0.005


def test_what_neither_or_only_one_survey_reaches_at_all_is_not_missed():
    first, second = np.full((40, 40), 3), np.zeros((40, 40), dtype=int)
    every = np.ones((40, 40), dtype=bool)
    assert not missed_places(second, second, 4, every).any()
    assert not missed_places(first, second, 4, every).any(), "with no point around nothing is expected"
