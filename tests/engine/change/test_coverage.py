"""What larger cells would compare, against the difference on such cells."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.change.coverage import cell_that_compares, compared_share
from slopewatch.engine.change.difference import difference
from slopewatch.interface.parameters import ChangeParameters


def slope(seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 20, (2, count))
    return np.column_stack([x, y, 100.0 + 0.4 * x + rng.normal(0, 0.02, count)])


def test_the_cell_that_is_advised_compares_what_it_promises():
    first, second = slope(1, 3000), slope(2, 3000)
    fine = difference(first, second, ChangeParameters(cell=0.1, adaptive=False))
    advised = cell_that_compares(fine)
    assert advised is not None
    assert difference(first, second, ChangeParameters(cell=advised, adaptive=False)).common_cell_rate > 0.75
    assert fine.common_cell_rate < 0.2
    # cells that grow compare more, and do not make the surveys denser
    grown = difference(first, second, ChangeParameters(cell=0.1))
    assert compared_share(grown) > 0.9
    assert grown.common_cell_rate == pytest.approx(fine.common_cell_rate, rel=0.01)
    assert compared_share(fine) == pytest.approx(fine.valid.sum() * 0.01 / 400, rel=0.02)


def test_what_both_surveys_reached_counts_by_itself():
    """The second survey ends in the middle: all that both reached is compared, half of what either did."""
    first, second = slope(1, 4000), slope(2, 4000)
    change = difference(first, second[second[:, 0] < 10], ChangeParameters(cell=1.0))
    assert compared_share(change) == pytest.approx(0.5, abs=0.03)
    assert compared_share(change, both=True) > 0.97
