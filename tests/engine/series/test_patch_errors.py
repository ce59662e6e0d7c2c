"""Errors of means on patches, against errors that were put in."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from slopewatch.engine.series.patch_errors import away_from, patch_errors

SHAPE = (160, 160)


def test_independent_errors_leave_no_excess():
    change = np.random.default_rng(0).normal(0, 0.02, SHAPE)
    found = patch_errors(change, np.full(SHAPE, 0.02**2), np.ones(SHAPE, dtype=bool))
    assert found.sides == (2, 4, 8, 16, 32)
    assert all(e**0.5 < 0.003 for e in found.excess[:4])


def test_what_neighbours_share_is_found():
    rng = np.random.default_rng(1)
    shared = ndimage.gaussian_filter(rng.normal(size=SHAPE), 12, mode="wrap")
    shared *= 0.01 / shared.std()
    change = shared + rng.normal(0, 0.02, SHAPE)
    found = patch_errors(change, np.full(SHAPE, 0.02**2), np.ones(SHAPE, dtype=bool))
    assert found.excess_of(8 * 8) ** 0.5 == pytest.approx(0.01, rel=0.35)
    assert found.excess_of(8 * 8) == found.excess[2] == found.excess_of(15 * 15)
    assert found.excess_of(1) == 0.0


def test_moved_and_unmeasured_cells_do_not_count():
    rng = np.random.default_rng(2)
    change, moved = rng.normal(0, 0.02, SHAPE), np.zeros(SHAPE, dtype=bool)
    moved[40:80, 40:80] = True
    change[moved] += 5.0
    change[:, 100:] = np.nan
    found = patch_errors(change, np.full(SHAPE, 0.02**2), away_from(moved, 3))
    assert max(found.excess[:3]) ** 0.5 < 0.004
    nothing = patch_errors(np.full(SHAPE, np.nan), change, ~moved)
    assert (nothing.sides, nothing.excess_of(100)) == ((), 0.0)


def test_away_from_keeps_its_distance():
    moved = np.zeros((20, 20), dtype=bool)
    moved[10, 10] = True
    away = away_from(moved, 2)
    rows, columns = np.nonzero(~away)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (8, 12, 8, 12)
    assert away_from(np.zeros((3, 3), dtype=bool), 2).all()
