"""Moving by parts of a cell."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.elevation_models.shift import shifted


@pytest.mark.parametrize(("columns", "rows"), [(0.25, 0.0), (-1.6, 2.3), (3.0, -1.0)])
def test_a_curved_surface_is_moved_exactly(columns: float, rows: float) -> None:
    def surface(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 0.03 * x**2 - 0.02 * y**2 + 0.4 * x + 12.0

    x, y = np.arange(20.0), np.arange(16.0)[:, None]
    found = shifted(surface(x, y), columns, rows)
    inner = np.s_[5:-5, 5:-5]
    assert found[inner] == pytest.approx(surface(x + columns, y + rows)[inner], abs=1e-9)


def test_next_to_a_gap_it_is_linear_and_in_it_unknown() -> None:
    heights = np.tile(np.arange(8.0) ** 2, (3, 1))
    heights[:, 5] = np.nan
    found = shifted(heights, 0.5, 0.0)[1]
    assert found[3] == pytest.approx((9 + 16) / 2)
    assert np.isnan(found[[4, 5, 7]]).all()
    assert found[1] == pytest.approx(1.5**2)
