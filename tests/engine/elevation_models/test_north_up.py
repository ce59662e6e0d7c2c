"""Models on turned, sheared, oblong and upside-down grids against the surface that they were made of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from rasterio.errors import NotGeoreferencedWarning
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.elevation_models.model import ElevationModel, read_model
from slopewatch.engine.elevation_models.north_up import resampled
from slopewatch.engine.grid.grid import Grid
from slopewatch.tests.builders.elevation_models import NORTH, WEST, hills, hills_at, write_model, write_turned


def _truth(grid: Grid, number: int = 10) -> np.ndarray:
    """Means of the surface over the cells, by so many places along a side."""
    offsets = (np.arange(number) + 0.5) / number
    total = np.zeros(grid.shape)
    for down in offsets:
        for across in offsets:
            x = grid.west - WEST + (np.arange(grid.columns) + across) * grid.cell
            y = grid.north - NORTH - (np.arange(grid.rows)[:, None] + down) * grid.cell
            total += hills_at(x, y)
    return total / number**2


@pytest.mark.parametrize(
    ("angle", "sides", "shear", "upside_down", "words"),
    [
        (20.0, (1.0, 1.0), 0.0, False, "1 by 1 m, turned by 20 degrees;"),
        (-63.0, (1.0, 0.8), 0.0, False, "1 by 0.8 m, turned by -63 degrees;"),
        (0.0, (0.5, 1.0), 0.0, False, "0.5 by 1 m, turned by 0 degrees;"),
        (130.0, (1.0, 1.0), 12.0, False, "turned by 130 degrees and sheared;"),
        (5.0, (0.7, 0.7), 0.0, True, "turned by 5 degrees;"),
    ],
)
def test_the_surface_stays_where_it_is(
    tmp_path: Path, angle: float, sides: tuple[float, float], shear: float, upside_down: bool, words: str
) -> None:
    path = write_turned(tmp_path / "a.tif", angle, sides, (80, 90), shear=shear, upside_down=upside_down)
    model = read_model(path)
    assert words in model.regridded
    assert model.regridded.endswith(f"to a north-up grid of {model.grid.cell:.3g} m, which smooths them.")
    assert model.grid.cell == pytest.approx(max(sides[0], model.grid.cell if shear else sides[1]))
    known = np.isfinite(model.heights)
    area = abs(rasterio.open(path).transform.determinant) * 80 * 90
    assert known.sum() * model.grid.cell**2 == pytest.approx(area, rel=0.08)
    error = (model.heights - _truth(model.grid))[known]
    # half a second derivative (below 0.1 a metre) times the smoothing by some 0.3 m²
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert abs(np.median(error)) < 0.005


def test_a_plane_keeps_its_heights_to_rounding() -> None:
    affine = Affine.translation(1000.0, 2000.0) * Affine.rotation(31.0) * Affine.shear(8.0) * Affine.scale(1.2, -0.9)
    column, row = np.meshgrid(np.arange(60) + 0.5, np.arange(50) + 0.5)
    x, y = affine * (column, row)
    grid = Grid(1010.0, 2000.0, 1.3, 30, 30)
    found = resampled(1500 + 0.4 * x - 0.7 * y, affine, grid)
    middles = 1010.0 + (np.arange(30) + 0.5) * 1.3, 2000.0 - (np.arange(30) + 0.5)[:, None] * 1.3
    truth = 1500 + 0.4 * middles[0] - 0.7 * middles[1]
    inside = _within(affine, (50, 60), middles, 1.5)
    assert inside.sum() > 300
    assert np.abs(found - truth)[inside].max() < 1e-8


def test_what_only_runs_the_other_way_keeps_its_heights(tmp_path: Path) -> None:
    heights = hills(30, 40)
    plain = read_model(write_model(tmp_path / "a.tif", heights))
    assert plain.regridded == ""
    ways = {
        "south-up": (heights[::-1], Affine(1, 0, WEST, 0, 1, NORTH - 30)),
        "east to west": (heights[:, ::-1], Affine(-1, 0, WEST + 40, 0, -1, NORTH)),
        "by columns": (heights.T, Affine(0, 1, WEST, -1, 0, NORTH)),
        "by columns from the south": (heights[::-1].T, Affine(0, 1, WEST, 1, 0, NORTH - 30)),
    }
    for name, (array, affine) in ways.items():
        model = _written(tmp_path / "b.tif", array, affine)
        assert model.grid == plain.grid, name
        assert np.array_equal(model.heights, plain.heights), name
        assert "were put in order" in model.regridded


def _written(path: Path, heights: np.ndarray, affine: Affine) -> ElevationModel:
    profile = {"count": 1, "height": heights.shape[0], "width": heights.shape[1], "dtype": "float32"}
    with rasterio.open(path, "w", driver="GTiff", crs="EPSG:32651", transform=affine, **profile) as target:
        target.write(heights.astype("float32")[None])
    return read_model(path)


def test_unknown_ground_stays_unknown() -> None:
    affine = Affine.translation(0.0, 0.0) * Affine.rotation(30.0) * Affine.scale(1.0, -1.0)
    column, row = np.meshgrid(np.arange(80) + 0.5, np.arange(80) + 0.5)
    x, y = affine * (column, row)
    inside = np.hypot(x - 54.0, y - 5.0) < 12.0  # the middle of the model is about there
    heights = np.where(inside, np.nan, 100.0)
    grid = Grid(30.0, 30.0, 1.0, 50, 50)
    found = resampled(heights, affine, grid)
    px, py = 30.5 + np.arange(50), 29.5 - np.arange(50)[:, None]
    far = np.hypot(px - 54.0, py - 5.0)
    assert np.isnan(found[far < 12.0]).all()
    assert np.nanmax(np.abs(found - 100.0)) < 1e-9
    assert np.isfinite(found[(far > 14.0) & _within(affine, (80, 80), (px, py), 1.0)]).all()


def _within(affine: Affine, shape: tuple[int, int], places: tuple[np.ndarray, np.ndarray], margin: float) -> np.ndarray:
    """Which of places on a grid lie within a raster, by more than so many of its cells."""
    column, row = ~affine * np.meshgrid(*(p.ravel() for p in places))
    return np.minimum(np.minimum(column, shape[1] - column), np.minimum(row, shape[0] - row)) > margin


def test_what_has_no_place_or_no_area_is_refused(tmp_path: Path) -> None:
    with pytest.warns(NotGeoreferencedWarning), pytest.raises(InputError, match=r"b\.tif' does not say where it lies"):
        _written(tmp_path / "b.tif", hills(20, 20), Affine.identity())
    with pytest.raises(InputError, match=r"cells of 1 by 200, which are no areas to compare"):
        _written(tmp_path / "c.tif", hills(20, 20), Affine(1, 0, WEST, 0, -200, NORTH))
    with pytest.raises(InputError, match="no areas to compare"):
        _written(tmp_path / "d.tif", hills(20, 20), Affine(1, 1, WEST, 1, 1, NORTH))
