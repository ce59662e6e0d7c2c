"""The moderated variance against a loop over its window."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.grid.cell_statistics import cell_statistics
from slopewatch.engine.grid.grid import snapped_grid
from slopewatch.engine.grid.pooled_variance import pooled_variance


def slope(seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 20, (2, count))
    return np.column_stack([x, y, 100.0 + 0.4 * x + rng.normal(0, 0.02, count)])


def test_pooled_variance_is_the_weighted_sum_of_own_and_neighbourhood():
    points = slope(5, 2000)
    cells = cell_statistics(points, snapped_grid((0, 0, 19.99, 19.99), 0.5))
    got = cells.on_grid(pooled_variance(cells, radius=2))
    degrees_of, variance_of = cells.on_grid(cells.degrees, 0.0), cells.on_grid(cells.variance)
    row, column = 20, 17
    squares = degrees = 0.0
    for r in range(row - 2, row + 3):
        for c in range(column - 2, column + 3):
            if degrees_of[r, c] > 0:
                squares += variance_of[r, c] * degrees_of[r, c]
                degrees += degrees_of[r, c]
    own = np.nan_to_num(variance_of[row, column]) * degrees_of[row, column]
    assert got[row, column] == pytest.approx((own + 8 * squares / degrees) / (degrees_of[row, column] + 8))
