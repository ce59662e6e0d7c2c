"""Meshes of a ground with gaps, compared with triangles found one by one."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.grid.geotiff import Raster
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.handover.surfaces import heights_at, mesh

_CELL = 0.5


def ground(heights: np.ndarray) -> Raster:
    grid = Grid(1000.0, 2000.0, _CELL, *heights.shape)
    return Raster(heights.astype(np.float32), grid, CRS.from_epsg(32651), "", "m", {})


def with_gaps(rows: int, columns: int, share: float, seed: int) -> np.ndarray:
    chance = np.random.default_rng(seed)
    heights = chance.uniform(0, 10, (rows, columns))
    heights[chance.random((rows, columns)) < share] = np.nan
    return heights


def test_a_square_has_two_triangles_or_one_or_none() -> None:
    heights = with_gaps(9, 11, 0.25, 3)
    made = mesh(ground(heights), 10_000)
    covered = 0.0
    for row in range(8):
        for column in range(10):
            known = np.isfinite(heights[row : row + 2, column : column + 2]).sum()
            covered += {4: 1.0, 3: 0.5}.get(int(known), 0.0) * _CELL**2
    triangles = shapely.polygons(made.points[made.faces][:, :, :2])
    assert shapely.area(triangles).sum() == pytest.approx(covered)
    assert shapely.area(shapely.union_all(triangles)) == pytest.approx(covered)  # no two overlap
    assert shapely.is_ccw(shapely.get_exterior_ring(triangles)).all()
    assert len(np.unique(made.faces)) == len(made.points)  # no point without a triangle


def test_points_are_cells_of_the_raster_and_no_more_than_wanted() -> None:
    heights = with_gaps(40, 60, 0.1, 4)
    made = mesh(ground(heights), 150)
    assert 60 < len(made.points) <= 150
    assert made.step_m > _CELL
    columns = np.rint((made.points[:, 0] - 1000.0) / _CELL - 0.5).astype(int)
    rows = np.rint((2000.0 - made.points[:, 1]) / _CELL - 0.5).astype(int)
    assert made.points[:, 2] == pytest.approx(heights[rows, columns], abs=1e-5)


def test_the_diagonal_joins_the_corners_that_differ_less() -> None:
    made = mesh(ground(np.array([[0.0, 5.0], [5.3, 0.1]])), 100)
    shared = set(made.faces[0]) & set(made.faces[1])
    assert sorted(made.points[sorted(shared), 2]) == pytest.approx([0.0, 0.1])


def test_a_strip_of_one_row_is_no_surface() -> None:
    assert len(mesh(ground(np.arange(5.0)[None]), 100).faces) == 0


def test_heights_are_those_of_the_cell_or_of_the_nearest_known_one() -> None:
    heights = with_gaps(12, 15, 0.4, 5)
    surface = ground(heights)
    chance = np.random.default_rng(6)
    xy = np.column_stack([chance.uniform(999, 1009, 200), chance.uniform(1993, 2001, 200)])
    rows, columns = np.nonzero(np.isfinite(heights))
    for (x, y), found in zip(xy, heights_at(surface, xy), strict=True):
        row = np.clip(int((2000.0 - y) // _CELL), 0, 11)
        column = np.clip(int((x - 1000.0) // _CELL), 0, 14)
        apart = np.hypot(rows - row, columns - column)
        nearest = heights[rows, columns][apart <= apart.min() + 1e-9]
        assert np.abs(nearest - found).min() < 1e-5
