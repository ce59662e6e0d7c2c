"""Cells that grow, through the command line, on sparse clouds whose change is known."""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from pyproj import CRS
from slopewatch.interface.seen import COMPARED, LABELS, NODATA, NOT_IN_LATER, OUTSIDE
from slopewatch.tests.builders.program import run


def write_slope(path: Path, seed: int, lowered: float = 0.0) -> Path:
    """30 x 20 m at 39 degrees, 6 points/m²; 6 x 8 m of it are lowered."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, 30, 3600), rng.uniform(0, 20, 3600)
    moved = (u > 12) & (u < 18) & (v > 6) & (v < 14)
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    header.add_crs(CRS.from_epsg(32651))
    las = laspy.LasData(header)
    las.x, las.y = 500_000 + u, 3_500_000 + v
    las.z = 50 + 0.8 * v + rng.normal(0, 0.03, 3600) - lowered * moved
    las.write(path)
    return path


def change(*arguments: object) -> dict:
    done = run("change", *arguments, "--progress", "json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_sparse_ground_speaks_where_cells_grow(tmp_path):
    clouds = [
        write_slope(tmp_path / f"{year}-05-01.laz", year, lowered) for year, lowered in ((2024, 0.0), (2025, 0.15))
    ]
    options = (*clouds, "--registration-error", 0.002, "--cell", 0.1)
    fixed = change(*options, "--output-dir", tmp_path / "fixed", "--no-adaptive")
    grown = change(*options, "--output-dir", tmp_path / "grown")
    again = change(*options, "--output-dir", tmp_path / "again", "--adaptive")
    assert "cell_size" not in fixed["outputs"]
    assert fixed["metrics"]["compared_share"] < 0.05
    assert grown["metrics"]["compared_share"] > 0.95
    assert grown["metrics"]["common_cell_rate"] == pytest.approx(fixed["metrics"]["common_cell_rate"], rel=0.01)
    path = Path(grown["outputs"]["cell_size"])
    assert path.with_suffix(".qml").stat().st_size > 0
    with rasterio.open(path) as raster:
        sizes = raster.read(1, masked=True)
        assert raster.units == ("m",)
    assert set(np.round(np.unique(sizes.compressed()).astype(float), 3)) <= {0.1, 0.2, 0.4, 0.8, 1.6}
    with rasterio.open(grown["outputs"]["elevation_change"]) as raster:
        dz = raster.read(1, masked=True)
        rows, columns = np.indices(dz.shape)
        x, y = raster.transform * (columns + 0.5, rows + 0.5)
    assert np.array_equal(dz.mask, sizes.mask)
    with rasterio.open(grown["outputs"]["seen"]) as raster:
        seen, colours, tags = raster.read(1), raster.colormap(1), raster.tags()
        assert (raster.dtypes, raster.nodata) == (("uint8",), NODATA)
    assert np.array_equal(seen == COMPARED, ~dz.mask)
    assert colours[NOT_IN_LATER] != colours[COMPARED]
    assert tags["CLASS_3"] == LABELS[NOT_IN_LATER]
    inside = (x > 500_013.6) & (x < 500_016.4) & (y > 3_500_007.6) & (y < 3_500_012.4)
    assert dz[inside].mean() == pytest.approx(-0.15, abs=0.01)
    assert grown["metrics"]["zone_count"] == 1
    assert grown["metrics"]["zone_area_m2"] == pytest.approx(48, rel=0.25)
    assert grown["metrics"]["cell_size_median_m"] == pytest.approx(float(np.ma.median(sizes)))
    record = json.loads((tmp_path / "grown" / "run.json").read_text())
    shares = record["seen"]
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["compared"] == grown["metrics"]["compared_share"]
    assert shares["not_in_later"] == pytest.approx((seen == NOT_IN_LATER).sum() / (seen != OUTSIDE).sum())
    assert record["parameters"]["change"]["adaptive"] is True
    for name in ("elevation_change", "level_of_detection", "cell_size", "zones"):
        assert Path(grown["outputs"][name]).read_bytes() == Path(again["outputs"][name]).read_bytes(), name


@pytest.mark.parametrize("options", [("--cell", 1, "--largest-cell", 1.6), ("--profile", "paper", "--cell", 1)])
def test_large_cells_and_the_published_profile_have_one_size(tmp_path, options):
    clouds = [write_slope(tmp_path / f"{year}-05-01.laz", year) for year in (2024, 2025)]
    found = change(*clouds, *options, "--output-dir", tmp_path / "out")
    assert "cell_size" not in found["outputs"]
    assert "grown_cells" not in found["metrics"]
    assert found["metrics"]["compared_share"] > 0.9
