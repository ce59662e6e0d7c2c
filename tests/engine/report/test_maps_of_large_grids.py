"""Maps of a slope that lies oblique in its rectangle: the cells with data are what takes memory."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.grid.geotiff import read_raster, write_bands, write_raster
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.grid.listed_raster import read_listed
from slopewatch.engine.report.maps import cell_sizes, change_map, closed, densities, hillshades
from slopewatch.engine.statistics.layout import Laid, Layout

UTM = CRS.from_epsg(32651)
SIDE, HALF = 3600, 100
GRID = Grid(500_000.0, 3_500_000.0, 0.1, SIDE, SIDE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Rasters of a run with a slope along the diagonal, 5 % of the rectangle."""
    made = tmp_path_factory.mktemp("run")
    row, column = np.nonzero(np.abs(np.subtract.outer(np.arange(SIDE), np.arange(SIDE))) < HALF)
    layout, rng = Layout(GRID.shape, row * SIDE + column), np.random.default_rng(1)

    def held(values: np.ndarray) -> Laid:
        return Laid(values.astype(np.float32), layout)

    height = 0.03 * row + rng.normal(0, 0.02, row.size)
    dz = rng.normal(0, 0.05, row.size)
    write = {"description": "what", "unit": "m", "tags": {}}
    write_raster(made / "elevation_change.tif", held(dz), GRID, UTM, **write)
    write_raster(made / "level_of_detection.tif", held(np.full(row.size, 0.08)), GRID, UTM, **write)
    write_raster(made / "significant_change.tif", held(np.where(np.abs(dz) > 0.08, dz, np.nan)), GRID, UTM, **write)
    write_raster(made / "cell_size.tif", held(0.1 * 2.0 ** (column % 3)), GRID, UTM, **write)
    both = {"earlier": held(height), "later": held(height + dz)}
    write_bands(made / "surface_heights.tif", both, GRID, UTM, unit="m", tags={})
    counts = {"earlier": held(1.0 + row % 4), "later": held(1.0 + column % 3)}
    write_bands(made / "point_counts.tif", counts, GRID, UTM, unit="points", tags={})
    return made


@pytest.mark.parametrize(
    "draw", [lambda f: change_map(f, 0.3, ("2024", "2025")), hillshades, densities, cell_sizes], ids=list("chds")
)
def test_no_map_holds_the_rectangle(folder, draw):
    draw(folder)  # fonts, colours and what else is kept
    tracemalloc.start()
    try:
        draw(folder)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    rectangle = 4 * SIDE * SIDE
    assert peak < 4 * rectangle  # a picture of 900 to 1,400 pixels a side, and what matplotlib makes of it


def test_listed_cells_are_those_with_data(folder):
    names = ("elevation_change", "significant_change")
    found = read_listed([(folder / f"{name}.tif", 1) for name in names])
    for name, values in zip(names, found.values, strict=True):
        np.testing.assert_array_equal(
            found.layout.on_grid(values, np.nan), read_raster(folder / f"{name}.tif").array, err_msg=name
        )
    assert found.grid == GRID


def test_gaps_of_listed_heights_are_closed_alike(folder):
    part = read_raster(folder / "surface_heights.tif", 2).array[:400, :500]
    listed = np.flatnonzero(np.isfinite(part))
    held = Laid(part.ravel()[listed], Layout(part.shape, listed))
    np.testing.assert_array_equal(closed(held, 0.1, 1.0, every=2), closed(part, 0.1, 1.0, every=2))


def test_rasters_of_two_grids_are_refused(folder, tmp_path):
    other = Grid(GRID.west, GRID.north, 0.2, 40, 40)
    write_raster(tmp_path / "a.tif", np.ones(other.shape, np.float32), other, UTM, description="", unit="m", tags={})
    with pytest.raises(InputError, match="another grid"):
        read_listed([(folder / "elevation_change.tif", 1), (tmp_path / "a.tif", 1)])
