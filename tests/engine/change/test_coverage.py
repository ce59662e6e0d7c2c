"""What was compared, against distances to all points, and what larger cells would compare, against such cells."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.spatial import cKDTree
from slopewatch.engine.change.coverage import cell_that_compares, seen
from slopewatch.engine.change.difference import Areas, difference
from slopewatch.interface.parameters import ChangeParameters
from slopewatch.interface.seen import COMPARED, EXCLUDED, NOT_IN_BOTH, NOT_IN_FIRST, NOT_IN_LATER, OUTSIDE


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
    assert seen(grown).share(COMPARED) > 0.9
    assert grown.common_cell_rate == pytest.approx(fine.common_cell_rate, rel=0.01)
    assert seen(fine).share(COMPARED) == pytest.approx(fine.valid.sum() * 0.01 / 400, rel=0.02)


def test_what_both_surveys_reached_counts_by_itself():
    """The second survey ends in the middle: all that both reached is compared, half of what either did."""
    first, second = slope(1, 4000), slope(2, 4000)
    change = difference(first, second[second[:, 0] < 10], ChangeParameters(cell=1.0))
    assert seen(change).share(COMPARED) == pytest.approx(0.5, abs=0.05)
    assert seen(change).share_of_both > 0.9


@pytest.mark.parametrize("cell", [0.2, 0.5, 1.0, 2.0])
def test_only_cells_with_ground_of_both_surveys_nearby_are_compared(cell):
    """Distances to all points say which survey sees a cell; each survey has a hole of its own, and both share one."""
    first, second = slope(3, 900), slope(4, 900)
    first = first[np.hypot(first[:, 0] - 6, first[:, 1] - 6) > 3.5]
    second = second[np.hypot(second[:, 0] - 14, second[:, 1] - 13) > 4.0]
    first = first[np.hypot(*(np.array([13.0, 4.0]) - first[:, :2]).T) > 3.0]
    second = second[np.hypot(*(np.array([13.5, 4.5]) - second[:, :2]).T) > 3.0]
    areas = Areas(shapely.box(-1, -1, 21, 21))
    change = difference(first, second, ChangeParameters(cell=cell), areas=areas)
    classes, grid = seen(change).classes, change.grid
    east, north = np.meshgrid(
        grid.west + (np.arange(grid.columns) + 0.5) * cell, grid.north - (np.arange(grid.rows) + 0.5) * cell
    )
    middles = np.column_stack([east.ravel(), north.ravel()])
    near = []
    for points in (first, second):
        own = np.zeros(grid.shape, dtype=bool)
        own[((grid.north - points[:, 1]) / cell).astype(int), ((points[:, 0] - grid.west) / cell).astype(int)] = True
        near.append(own | (cKDTree(points[:, :2]).query(middles)[0].reshape(grid.shape) <= 1.0))
    assert (near[0] & near[1])[change.valid].all()
    for missing, one, other in ((NOT_IN_FIRST, ~near[0], near[1]), (NOT_IN_LATER, near[0], ~near[1])):
        assert (classes == missing)[(one & other) & (classes != OUTSIDE)].all()
        assert (one & other)[classes == missing].all()
    assert ((classes == NOT_IN_BOTH) | (classes == OUTSIDE))[~near[0] & ~near[1]].all()
    assert (classes == COMPARED).sum() == change.valid.sum() > 0.5 * (near[0] & near[1]).sum()
    assert seen(change).shares()["compared"] == pytest.approx(change.valid.sum() / (classes != OUTSIDE).sum())


@pytest.mark.parametrize("adaptive", [True, False])
def test_an_excluded_area_is_a_class_and_is_not_compared(adaptive):
    areas = Areas(shapely.box(0, 0, 20, 20), excluded=shapely.box(5, 5, 9, 9))
    change = difference(slope(1, 8000), slope(2, 8000), ChangeParameters(cell=0.5, adaptive=adaptive), areas=areas)
    found = seen(change)
    assert found.area(EXCLUDED) == pytest.approx(16.0, rel=0.3)
    assert not change.valid[found.classes == EXCLUDED].any()
    assert found.share(EXCLUDED) == pytest.approx(found.area(EXCLUDED) / found.slope_area)
