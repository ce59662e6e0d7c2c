"""Regions of interest that hold nothing, and regions without a reference system around a cloud in feet."""

from __future__ import annotations

from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.ground.extraction import extract_ground


def write(path: Path, xyz: np.ndarray, crs: int) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz.min(axis=0))
    header.add_crs(CRS.from_epsg(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.return_number = las.number_of_returns = np.ones(len(xyz), dtype=np.uint8)
    las.write(path)
    return path


def field(side: float, n: int, low: tuple[float, float]) -> np.ndarray:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, side, (2, n))
    return np.column_stack([low[0] + x, low[1] + y, 50 + 0.4 * x + rng.normal(0, 0.01, n)])


def test_a_region_between_the_points_is_named_with_the_cloud(tmp_path):
    low = (500_000.0, 3_500_000.0)
    cloud = write(
        tmp_path / "two.laz", np.vstack([field(10, 3000, low), field(10, 3000, (low[0] + 90, low[1]))]), 32651
    )
    region = tmp_path / "gap.gpkg"
    box = shapely.box(low[0] + 40, low[1] + 2, low[0] + 50, low[1] + 8)
    geopandas.GeoDataFrame(geometry=[box], crs=32651).to_file(region)
    with pytest.raises(InputError, match=r"two\.laz.*gap\.gpkg"):
        extract_ground(cloud, tmp_path / "ground.laz", roi=region)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["gap.gpkg", "two.laz"]


def test_a_region_without_a_system_is_in_the_clouds_own_feet(tmp_path):
    low = (6_000_000.0, 2_000_000.0)  # US survey feet
    cloud = write(tmp_path / "feet.laz", field(100, 20_000, low), 2227)
    box = shapely.box(low[0], low[1], low[0] + 50, low[1] + 100)
    shapefile = tmp_path / "half.shp"
    geopandas.GeoDataFrame(geometry=[box]).to_file(shapefile)
    result = extract_ground(cloud, tmp_path / "ground.laz", roi=shapefile)
    assert result.roi_points == pytest.approx(10_000, rel=0.03)
    assert result.roi_area == pytest.approx(50 * 100 * (1200 / 3937) ** 2, rel=1e-6)
