"""The surface of a shaded relief, closed over its gaps for the eye."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.report.maps import closed


def test_gaps_are_closed_on_the_slope_and_the_outside_is_not() -> None:
    rows, columns = np.mgrid[0:80, 0:100]
    slope = 3.0 + 0.08 * columns - 0.05 * rows
    known = np.full(slope.shape, np.nan)
    known[10:70, 10:90] = slope[10:70, 10:90]
    rng = np.random.default_rng(0)
    known[rng.uniform(size=slope.shape) < 0.6] = np.nan
    known[30:36, 40:46] = np.nan
    filled = closed(known, 0.1, 1.0)
    inside = np.zeros(slope.shape, dtype=bool)
    inside[12:68, 12:88] = True
    assert np.isfinite(filled[inside]).all()
    np.testing.assert_allclose(filled[inside], slope[inside], atol=1e-9)
    assert np.isnan(filled[:5]).all()
    assert np.isnan(filled[:, 95:]).all()


def test_gaps_are_closed_alike_in_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    """A surface in bands of 40 lines with what reaches into them, and every third line and column of it."""
    rng = np.random.default_rng(1)
    rows, columns = np.mgrid[0:400, 0:300]
    heights = 3.0 + 0.08 * columns - 0.05 * rows + rng.normal(0, 0.02, rows.shape)
    heights[(rng.uniform(size=rows.shape) < 0.5) | (np.abs(columns - 0.5 * rows - 50) > 30)] = np.nan
    heights[180:230] = np.nan
    whole = closed(heights, 0.1, 1.0)
    monkeypatch.setattr("slopewatch.engine.report.maps._CELLS_AT_ONCE", 40 * 300)
    np.testing.assert_array_equal(closed(heights, 0.1, 1.0), whole)
    np.testing.assert_array_equal(closed(heights, 0.1, 1.0, every=3), whole[1::3, 1::3])
