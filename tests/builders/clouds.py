"""Clouds written by laspy, an independent writer, for the tests of the engine's readers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

LasFile = Callable[..., Path]


@pytest.fixture(scope="session")
def las_file() -> LasFile:
    """Writes a slope of ``points`` points, 30 x 20 m, as the given path's extension says."""

    def write(
        path: Path,
        *,
        points: int = 2000,
        point_format: int = 7,
        version: str = "1.4",
        crs: int | str | None = 32651,
        seed: int = 0,
        scale: float = 0.001,
        change: Callable[[laspy.LasData], None] | None = None,
    ) -> Path:
        rng = np.random.default_rng(seed)
        header = laspy.LasHeader(point_format=point_format, version=version)
        header.scales, header.offsets = [scale] * 3, [500_000, 3_500_000, 0]
        if crs is not None:
            header.add_crs(CRS.from_user_input(crs), keep_compatibility=version != "1.4")
        las = laspy.LasData(header)
        u, v = np.sort(rng.uniform(0, 30, points)), rng.uniform(0, 20, points)
        las.x, las.y, las.z = 500_000 + u, 3_500_000 + v, 50 + 0.8 * v + rng.normal(0, 0.02, points)
        las.intensity = rng.integers(0, 2000, points)
        las.classification = rng.integers(1, 6, points)
        las.return_number, las.number_of_returns = rng.integers(1, 4, points), np.full(points, 3)
        las.point_source_id = rng.integers(0, 9, points)
        names = set(las.point_format.dimension_names)
        if "gps_time" in names:
            las.gps_time = np.sort(rng.uniform(0, 60, points))
        if "red" in names:
            las.red, las.green, las.blue = (rng.integers(0, 65536, points) for _ in range(3))
        if change is not None:
            change(las)
        las.write(path)
        return path

    return write


def write_sunk_slope(path: Path, *, lowered: float = 0.0, crs: int | None = 32651, x: float = 0.0) -> Path:
    """A 12 m slope of 20 thousand ground points; its western third is lowered."""
    rng = np.random.default_rng([*path.name.encode()])
    u, v = rng.uniform(0, 12, (2, 20_000))
    z = 50 + 0.5 * v + rng.normal(0, 0.01, u.size) - np.where(u < 4, lowered, 0)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    if crs:
        header.add_crs(CRS.from_epsg(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = 500_000 + x + u, 3_500_000 + v, z
    las.return_number = las.number_of_returns = np.ones(u.size, dtype=np.uint8)
    las.write(path)
    return path
