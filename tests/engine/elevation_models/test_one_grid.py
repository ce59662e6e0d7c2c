"""Models of different grids against sums over the cells' areas by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS, Transformer
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.elevation_models.model import ElevationModel, read_model
from slopewatch.engine.elevation_models.one_grid import on_grid_by_area, on_one_grid
from slopewatch.engine.grid.grid import Grid
from slopewatch.tests.builders.elevation_models import NORTH, WEST, hills, write_model


def _by_hand(heights: np.ndarray, own: Grid, grid: Grid) -> np.ndarray:
    found = np.full(grid.shape, np.nan)
    for row in range(grid.rows):
        for column in range(grid.columns):
            west, north = grid.west + column * grid.cell, grid.north - row * grid.cell
            total = area = 0.0
            for i in range(own.rows):
                for j in range(own.columns):
                    x, y = own.west + j * own.cell, own.north - i * own.cell
                    wide = min(west + grid.cell, x + own.cell) - max(west, x)
                    high = min(north, y) - max(north - grid.cell, y - own.cell)
                    if wide > 1e-12 and high > 1e-12 and np.isfinite(heights[i, j]):
                        total, area = total + heights[i, j] * wide * high, area + wide * high
            if area >= 0.5 * grid.cell**2:
                found[row, column] = total / area
    return found


@pytest.mark.parametrize(
    "to", [Grid(100.3, 207.9, 2.5, 3, 4), Grid(99.0, 209.0, 1.0, 7, 7), Grid(101.25, 208.0, 1, 5, 5)]
)
def test_means_over_areas(to: Grid) -> None:
    heights = np.random.default_rng(3).normal(1500.0, 2.0, (10, 12))
    heights[4, 5] = heights[7:, :3] = np.nan
    own = Grid(100.0, 208.0, 1.0, 10, 12)
    assert on_grid_by_area(heights, own, to) == pytest.approx(_by_hand(heights, own, to), nan_ok=True)


def _model(folder: Path, name: str, cell: float, west: float = WEST, crs: str = "EPSG:32651") -> ElevationModel:
    side = round(80 / cell)
    return read_model(write_model(folder / name, hills(side, side, cell), cell=cell, west=west, crs=crs))


def test_the_coarser_grid_is_taken_and_both_are_cut(tmp_path: Path) -> None:
    fine, coarse = _model(tmp_path, "fine.tif", 0.5, WEST + 10), _model(tmp_path, "coarse.tif", 2.0)
    (first, second), sentences = on_one_grid([fine, coarse])
    assert first.grid == second.grid == Grid(WEST + 10, NORTH, 2.0, 40, 35)
    assert np.array_equal(second.heights, coarse.heights[:, 5:])
    assert first.heights[3, 3] == pytest.approx(fine.heights[12:16, 12:16].mean())
    assert len(sentences) == 1
    assert "cells of 0.5 m; they were averaged to those of 2 m" in sentences[0]


def test_another_projection_is_warped(tmp_path: Path) -> None:
    there = Transformer.from_crs(32651, 32650, always_xy=True).transform(WEST + 40, NORTH - 40)
    plane = 100.0 + np.zeros((120, 120))
    other = read_model(
        write_model(tmp_path / "b.tif", plane, west=there[0] - 60, north=there[1] + 60, crs="EPSG:32650")
    )
    (first, second), sentences = on_one_grid([_model(tmp_path, "a.tif", 1.0), other])
    assert first.grid == second.grid
    assert np.isfinite(second.heights).mean() > 0.9
    assert np.nanmax(np.abs(second.heights - 100.0)) < 1e-6
    assert "warped from" in sentences[0]
    assert CRS(second.crs).equals(other.crs)


def test_what_is_refused(tmp_path: Path) -> None:
    first = _model(tmp_path, "a.tif", 1.0)
    with pytest.raises(InputError, match=r"do not overlap: they lie 920 m apart"):
        on_one_grid([first, _model(tmp_path, "b.tif", 1.0, WEST + 1000)])
    with pytest.raises(InputError, match=r"no detail can be invented, so give a cell of 1 m or more"):
        on_one_grid([first, _model(tmp_path, "c.tif", 0.5)], 0.5)
