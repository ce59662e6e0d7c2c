"""Cell statistics against plain loops, and the grid's edges against exact arithmetic."""

from __future__ import annotations

from collections import defaultdict
from decimal import Decimal

import numpy as np
import pytest
from slopewatch.engine.grid.cell_slope import gradient_at
from slopewatch.engine.grid.cell_statistics import cell_statistics, sloping_statistics
from slopewatch.engine.grid.grid import Grid, cell_index, snapped_grid

UTM = (500_000.0, 3_500_000.0)


def cloud(seed: int, n: int = 4000, *, slope: float = 0.6) -> np.ndarray:
    """Points on a millimetre lattice, so that many lie exactly on cells' edges."""
    rng = np.random.default_rng(seed)
    x = rng.integers(0, 6000, n) / 1000 + UTM[0]
    y = rng.integers(0, 4000, n) / 1000 + UTM[1]
    return np.column_stack([x, y, 40.0 + slope * (x - UTM[0]) + rng.normal(0, 0.05, n)])


def exact_cells(points: np.ndarray, cell: str) -> list[tuple[int, int]]:
    """Column from the west and row from the south in exact decimal arithmetic."""
    size = Decimal(cell)
    return [(int(Decimal(f"{x:.3f}") // size), int(Decimal(f"{y:.3f}") // size)) for x, y, _ in points]


@pytest.mark.parametrize("cell", ["0.1", "0.25", "0.3", "1", "0.07"])
def test_points_fall_into_the_cell_that_exact_arithmetic_names(cell):
    points = cloud(1)
    grid = snapped_grid((*points[:, :2].min(0), *points[:, :2].max(0)), float(cell))
    row, column = np.divmod(cell_index(points, grid), grid.columns)
    west = round(grid.west / grid.cell)
    south = round(grid.bounds[1] / grid.cell)
    got = list(zip((column + west).tolist(), (grid.rows - 1 - row + south).tolist(), strict=True))
    assert got == exact_cells(points, cell)


def test_origin_is_a_multiple_of_the_cell_and_two_clouds_share_it():
    a = snapped_grid((500000.013, 3500000.99, 500005.1, 3500003.2), 0.1)
    b = snapped_grid((500001.777, 3500000.42, 500009.9, 3500007.7), 0.1)
    for grid in (a, b):
        assert grid.west == pytest.approx(round(grid.west / 0.1) * 0.1, abs=1e-9)
        assert grid.north == pytest.approx(round(grid.north / 0.1) * 0.1, abs=1e-9)
    assert (b.west - a.west) / 0.1 == pytest.approx(round((b.west - a.west) / 0.1), abs=1e-6)


def test_every_point_of_the_extent_is_inside():
    points = cloud(2)
    grid = snapped_grid((*points[:, :2].min(0), *points[:, :2].max(0)), 0.1)
    assert cell_index(points, grid).min() >= 0


def test_points_outside_are_marked_and_not_counted():
    grid = Grid(west=0.0, north=2.0, cell=1.0, rows=2, columns=2)
    points = np.array([[0.5, 0.5, 1.0], [2.0, 0.5, 9.0], [-0.1, 0.5, 9.0], [0.5, 2.0, 9.0], [0.5, -0.1, 9.0]])
    assert (cell_index(points, grid) >= 0).tolist() == [True, False, False, False, False]
    cells = cell_statistics(points, grid)
    assert cells.count.sum() == 1
    assert cells.on_grid(cells.height)[1, 0] == 1.0


def brute_force(points: np.ndarray, grid: Grid, *, plane: bool) -> dict[tuple[int, int], tuple[float, ...]]:
    """Count, height, variance and the height's variance factor, cell by cell with lstsq."""
    members: dict[tuple[int, int], list[np.ndarray]] = defaultdict(list)
    for point, (column, row) in zip(points, exact_cells(points, f"{grid.cell:g}"), strict=True):
        south = round(grid.bounds[1] / grid.cell)
        members[(grid.rows - 1 - (row - south), column - round(grid.west / grid.cell))].append(point)
    result = {}
    for (row, column), inside in members.items():
        p = np.array(inside)
        centre = (grid.west + (column + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell)
        design = np.ones((len(p), 1))
        if plane and len(p) >= 4:
            tilted = np.column_stack([design, p[:, 0] - centre[0], p[:, 1] - centre[1]])
            spread = np.linalg.det(np.cov(p[:, :2].T, bias=True)) if len(p) > 1 else 0.0
            inverse = np.linalg.pinv(tilted.T @ tilted)
            if spread > 1e-4 * (grid.cell**2 / 12) ** 2 and inverse[0, 0] - 1 / len(p) < 1.0:
                design = tilted
        solution, *_ = np.linalg.lstsq(design, p[:, 2] - 40.0, rcond=None)
        rest = p[:, 2] - 40.0 - design @ solution
        degrees = len(p) - design.shape[1]
        variance = float(rest @ rest / degrees) if degrees > 0 else np.nan
        factor = float(np.linalg.inv(design.T @ design)[0, 0])
        result[(row, column)] = (len(p), float(solution[0]) + 40.0, variance, factor)
    return result


@pytest.mark.parametrize("plane", [False, True])
def test_statistics_equal_a_loop_over_the_cells(plane):
    points = cloud(3, 3000)
    grid = snapped_grid((*points[:, :2].min(0), *points[:, :2].max(0)), 0.3)
    cells = cell_statistics(points, grid, plane=plane)
    expected = brute_force(points, grid, plane=plane)
    assert cells.count.sum() == len(points)
    assert (cells.count > 0).sum() == len(expected)
    for place, (count, height, variance, factor) in expected.items():
        assert cells.count[place] == count
        here = cells.cell == place[0] * grid.columns + place[1]
        assert cells.points[here] == count
        assert cells.height[here] == pytest.approx(height, abs=1e-7)
        assert cells.variance[here] == pytest.approx(variance, abs=1e-9, nan_ok=True)
        assert cells.leverage[here] == pytest.approx(factor, rel=1e-5)


def test_plane_removes_the_error_of_uneven_sampling():
    """On a smooth 45 degree face the cell's mean depends on where its points lie; the plane does not."""
    rng = np.random.default_rng(4)
    points = rng.uniform(0, 5, (20_000, 3))
    points[:, 2] = points[:, 0]
    grid = snapped_grid((0, 0, 4.999, 4.999), 0.5)
    centre = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    mean, plane = (cell_statistics(points, grid, plane=plane) for plane in (False, True))
    mean, plane = (cells.on_grid(cells.height) - centre for cells in (mean, plane))
    assert np.abs(plane).max() < 1e-9 < 1e-3 < np.abs(mean).max()


def test_cells_with_points_have_statistics_and_the_others_none():
    cells = cell_statistics(np.array([[1.5, 0.5, 3.0]]), Grid(0.0, 2.0, 1.0, 2, 2))
    assert cells.cell.tolist() == [3]
    assert (cells.height.tolist(), cells.leverage.tolist()) == ([3.0], [1.0])
    assert np.isnan(cells.variance).all()
    assert np.isnan(cells.on_grid(cells.height)).tolist() == [[True, True], [True, False]]


def test_the_slope_around_is_taken_from_each_point_before_the_cells_are_summed():
    """Against the points themselves, levelled by the slope and summed cell by cell."""
    points = cloud(7, 6000)
    points[0, 2] += 500.0  # one wild point must not cost the others their digits
    grid = snapped_grid((*points[:, :2].min(0), *points[:, :2].max(0)), 0.25)
    known = cell_statistics(points, grid)
    gradient = gradient_at(np.arange(grid.rows * grid.columns), [(known.cell, known.height)], grid, reach=0.3)
    east, north = (component.reshape(grid.shape) for component in gradient)
    row, column = np.divmod(cell_index(points, grid), grid.columns)
    level = points.copy()
    level[:, 2] -= np.nan_to_num(east[row, column]) * (points[:, 0] - (grid.west + (column + 0.5) * grid.cell))
    level[:, 2] -= np.nan_to_num(north[row, column]) * (points[:, 1] - (grid.north - (row + 0.5) * grid.cell))
    expected = cell_statistics(level, grid, plane=True, least=12)
    got = sloping_statistics(points, grid)
    assert np.array_equal(got.tilted, expected.tilted)
    assert 0 < got.tilted.sum() < (got.count > 0).sum()
    for name in ("count", "degrees", "height", "leverage", "variance", "scatter"):
        assert getattr(got, name) == pytest.approx(getattr(expected, name), nan_ok=True, rel=1e-7, abs=1e-8), name
