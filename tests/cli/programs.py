"""The program run as users start it, and small clouds for it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import laspy
import numpy as np
from pyproj import CRS


def run(*arguments: object, **options) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "slopewatch.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=120, **options)


def write_plane(path: Path, *, lowered: float = 0.0, crs: int | None = 32651, x: float = 0.0) -> Path:
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
