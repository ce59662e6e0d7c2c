"""Ground of a plane slope, written by laspy."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
from pyproj import CRS


def write_plane(
    path: Path, *, seed: int, points: int = 60_000, raised: tuple[float, float, float, float] | None = None
) -> Path:
    """20 x 20 m rising northwards at 30 degrees, noise 5 mm; ``raised`` is (east, north, side, height), metres."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 20, (2, points))
    z = 50 + y * np.tan(np.radians(30)) + rng.normal(0, 0.005, points)
    if raised is not None:
        east, north, side, height = raised
        z += height * ((np.abs(x - east) < side / 2) & (np.abs(y - north) < side / 2))
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    header.add_crs(CRS.from_epsg(32651))
    las = laspy.LasData(header)
    las.x, las.y, las.z = 500_000 + x, 3_500_000 + y, z
    las.classification = np.full(points, 2, dtype=np.uint8)
    las.return_number = las.number_of_returns = np.ones(points, dtype=np.uint8)
    las.write(path)
    return path
