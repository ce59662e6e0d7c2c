"""A steep plane surveyed twice, part of it raised along its normal, and M3C2 on such files."""

from __future__ import annotations

from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import DetailParameters, DistanceParameters, InputParameters
from slopewatch.workflows.m3c2 import m3c2_step
from slopewatch.workflows.settings import DistanceSettings

DIP = np.radians(50)


NORMAL = np.array([0.0, -np.sin(DIP), np.cos(DIP)])


BULGE = 0.3


def steep(points, seed, *, raised=0.0, shift=(0.0, 0.0, 0.0)):
    """A face of 50 degrees, 12 x 12 m; its western third is raised along the normal."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, 12, (2, points))
    out = rng.normal(0, 0.01, points) + np.where(u < 4, raised, 0.0)
    return np.column_stack([u, v * np.cos(DIP), v * np.sin(DIP)]) + out[:, None] * NORMAL + [5e5, 3.5e6, 50] + shift


def write(path: Path, xyz, *, crs=32651, **dimensions) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, xyz[0].round()
    if crs:
        header.add_crs(CRS.from_user_input(crs))
    for name in dimensions:
        header.add_extra_dim(laspy.ExtraBytesParams(name, "f8"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.return_number = las.number_of_returns = np.ones(len(xyz), dtype=np.uint8)
    las.classification = np.full(len(xyz), 2)
    for name, values in dimensions.items():
        las[name] = values
    las.write(path)
    return path


def region(path: Path, polygon: shapely.Polygon, crs: str = "EPSG:32651") -> Path:
    """A file with one polygon of EPSG:32651, kept in ``crs``."""
    gpd.GeoDataFrame(geometry=[polygon], crs="EPSG:32651").to_crs(crs).to_file(path)
    return path


@pytest.fixture(scope="session")
def pair(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("pair")
    return (
        write(folder / "slope_2024-05-01.laz", steep(16_000, 1)),
        write(folder / "slope_2025-05-01.laz", steep(14_000, 2, raised=BULGE)),
    )


def run(first, second, output, *, progress=None, crs="", height_unit="auto", details=None, **given):
    options = {name: given.pop(name, None) for name in ("raster_dir", "core", "transform_path", "roi", "stable")}
    inputs, details = InputParameters(crs=crs, height_unit=height_unit), details or DetailParameters()
    settings = DistanceSettings(inputs, DistanceParameters(**given), details=details)
    return m3c2_step(first, second, output, settings, dates=(None, None), progress=progress or Progress(), **options)
