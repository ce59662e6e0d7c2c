"""Compiled sums over cells are numpy's, bit for bit; that numpy's are right is shown in test_plane_cells."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.core.compiled import compiled_loop
from slopewatch.engine.geometry.plane_kernels import moved_sums, plane_heights, power_sums, product_sums

from tests.builders.kernels import assert_equal_ways

COUNT, ROWS = 700, 6


@pytest.fixture
def points() -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(7)
    key = rng.integers(0, ROWS * ROWS - 3, COUNT)  # the last cells are empty
    x, y = rng.uniform(-0.5, 0.5, (2, COUNT))
    return key, x, y, rng.normal(0, 3, COUNT), rng.random(COUNT) * (rng.random(COUNT) < 0.7)


def test_sums_of_products(points):
    key, x, y, z, weight = points
    sums = assert_equal_ways(product_sums, key, x, y, z, weight, ROWS * ROWS)
    inside = key == 4
    assert sums[8, 4] == pytest.approx((weight * z * y)[inside].sum())
    assert not sums[:, -1].any()


def test_sums_of_powers(points):
    key, _, _, z, weight = points
    sums = assert_equal_ways(power_sums, key, z, weight > 0.2, ROWS * ROWS)
    inside = (key == 4) & (weight > 0.2)
    assert sums[:, 4] == pytest.approx([(z[inside] ** power).sum() for power in range(5)])


@pytest.mark.parametrize("pool", [(0.5, 1.0, 0.5), (0.0, 1.0, 0.0)])
@pytest.mark.parametrize("shape", [(4, 9), (1, 36), (36, 1)])
def test_sums_moved_to_the_cells_around(points, shape, pool):
    sums = product_sums(*points, ROWS * ROWS).reshape(9, *shape)
    assert_equal_ways(moved_sums, sums, pool)


def test_heights_of_planes(points):
    key, x, y, _, _ = points
    planes = np.random.default_rng(8).normal(size=(3, ROWS * ROWS))
    planes[:, 2] = np.nan
    heights = assert_equal_ways(plane_heights, key, x, y, *planes)
    assert np.isnan(heights[key == 2]).all()


def test_a_number_of_no_cell_is_refused(points):
    """Compiled, it would write into other memory."""
    key, x, y, z, weight = points
    key = np.where(key == 3, ROWS * ROWS, key)
    for kernel, arguments in (
        (product_sums, (key, x, y, z, weight, ROWS * ROWS)),
        (power_sums, (key, z, weight >= 0, ROWS * ROWS)),
        (plane_heights, (key, x, y, *np.zeros((3, ROWS * ROWS)))),
    ):
        with pytest.raises(IndexError):
            (compiled_loop(kernel.loop) or kernel.loop)(*arguments)
