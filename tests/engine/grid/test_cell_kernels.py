"""Cells of points by compiled loops: numpy's to the last bit, and right by each cell's own points."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from slopewatch.engine.change.difference import difference
from slopewatch.engine.core import compiled
from slopewatch.engine.grid import cell_slope, cell_statistics
from slopewatch.engine.grid.cell_statistics import sloping_statistics
from slopewatch.engine.grid.grid import Grid, cell_index
from slopewatch.engine.statistics import window_sums
from slopewatch.interface.parameters import ChangeParameters
from slopewatch.tests.builders.equal_results import same
from slopewatch.tests.builders.kernels import assert_equal_ways

GRID = Grid(500_000.0, 3_500_000.0, 0.5, 20, 30)
FRAME = GRID.west, GRID.bounds[1], GRID.north, GRID.cell, 1.0 / GRID.cell


@pytest.fixture
def switch(monkeypatch: pytest.MonkeyPatch):
    """Turns kernels on or off, whatever the amount of work."""

    def to(on: bool) -> None:
        event = threading.Event()
        if on:
            event.set()
        monkeypatch.setattr(compiled, "_AT_WORK", event)
        monkeypatch.setattr(compiled, "_refused", lambda: not on)

    return to


def points(count: int, seed: int = 1, beyond: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-beyond, 15.0 + beyond, count), rng.uniform(-beyond, 10.0 + beyond, count)
    z = 700.0 + 0.8 * x - 0.3 * y + rng.normal(0, 0.05, count)
    return np.column_stack([GRID.west + x, GRID.north - y, z])


def two(kernel, *arguments) -> tuple:
    """Both ways give the same bits; the result."""
    plain = kernel.plain(*arguments)
    found = (compiled.compiled_loop(kernel.loop) or kernel.loop)(*arguments)
    assert all(np.array_equal(one, other) for one, other in zip(found, plain, strict=True))
    return plain


@pytest.mark.parametrize("beyond", [0.0, 2.0])
def test_sums_are_those_of_numpy_and_of_each_cells_points(beyond):
    xyz = points(3000, beyond=beyond)
    count, sums = two(cell_statistics._cell_sums, xyz, FRAME, GRID.shape, 701.0)
    index = cell_index(xyz, GRID)
    assert np.array_equal(count, np.bincount(index[index >= 0], minlength=600))
    held = np.flatnonzero(count)
    for k in range(0, held.size, 40):
        own = xyz[index == held[k]]
        row, column = divmod(int(held[k]), 30)
        centre = GRID.west + (column + 0.5) * 0.5, GRID.north - (row + 0.5) * 0.5
        u, v, z = own[:, 0] - centre[0], own[:, 1] - centre[1], own[:, 2] - 701.0
        products = np.cov([u, v, z], bias=True) * len(own)
        expected = [z.mean(), products[2, 2], u.mean(), v.mean(), products[0, 0], products[1, 1], products[0, 1]]
        assert sums[:7, k] == pytest.approx(expected, abs=1e-9)
        assert sums[7:, k] == pytest.approx(products[2, :2], abs=1e-9)


@pytest.mark.parametrize("least", [4, 12])
def test_values_are_those_of_numpy(least):
    """With planes and without, cells of one point, slopes that are not known."""
    rng = np.random.default_rng(3)
    count, sums = two(cell_statistics._cell_sums, points(4000), FRAME, GRID.shape, 701.0)
    n = count[count > 0]
    gradient = rng.normal(0, 0.5, (2, n.size))
    gradient[:, rng.random(n.size) < 0.2] = np.nan
    found = assert_equal_ways(cell_statistics._cell_values, sums, n, gradient, (701.0, 0.25, least))
    assert 0 < np.count_nonzero(found[4]) < n.size


@pytest.mark.slow
@pytest.mark.parametrize("radius", [2, 3, 5, 14])
@pytest.mark.parametrize("band", [1, 10**6])
def test_planes_are_those_of_numpy(radius, band, monkeypatch):
    """Of one surface and two with holes, in one part and in many; least squares in ``test_cell_slope``."""
    monkeypatch.setattr(window_sums, "_BAND", band)
    rng = np.random.default_rng(radius)
    shape = (70, 50)
    cells = [np.flatnonzero(rng.random(shape) < share) for share in (0.3, 0.5)]
    heights = [0.2 * (cell % 50) + rng.normal(0, 0.3, cell.size) for cell in cells]
    wanted = np.flatnonzero(rng.random(shape) < 0.4)
    lines = window_sums.Windows(wanted, shape, radius).lines
    for number in (1, 2):
        starts = np.cumsum([0, *(cell.size for cell in cells[:number])])
        surfaces = np.concatenate(cells[:number]), np.concatenate(heights[:number]), starts
        found = assert_equal_ways(cell_slope._window_planes, wanted, surfaces, shape, radius, lines)
        assert np.nanmedian(found[0]) == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize("beyond", [0.0, 3.0])
def test_statistics_are_the_same_with_and_without_loops(switch, beyond):
    """Also where points lie outside the grid."""
    xyz = points(20_000, beyond=beyond)
    found = []
    for on in (False, True):
        switch(on)
        found.append(sloping_statistics(np.asfortranarray(xyz) if on else xyz, GRID))
    assert found[0].tilted.any()
    same(found[1], found[0])


def test_a_difference_is_the_same_with_and_without_loops(switch):
    first, second = points(40_000, 1), points(35_000, 2)
    second[:, 2] += np.where(np.hypot(second[:, 0] - GRID.west - 5, second[:, 1] - GRID.north + 5) < 1.5, -0.4, 0.0)
    found = []
    for on in (False, True):
        switch(on)
        found.append(difference(first, second, ChangeParameters(cell=0.2, adaptive=False)))
    assert found[0].significant.any()
    assert found[0].model.kind == "calibrated"
    same(found[1], found[0])
