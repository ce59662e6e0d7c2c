"""A slope under plants whose ground is known, and a region on its western part."""

from __future__ import annotations

from pathlib import Path

import geopandas
import numpy as np
from shapely import box
from slopewatch.engine.core.arrays import Bool, Float

RIDGE = (500_000.0, 3_500_000.0)
"""The south-west corner, m."""


def forest(seed: int = 0) -> tuple[Float, Bool]:
    """Points (n, 3) of 20 by 12 m that dips 31 degrees, and which of them (n,) are ground; plants stand 0.5 to 4 m."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform([[0], [0]], [[20], [12]], (2, 30_000))
    ground = rng.uniform(size=x.size) < 0.4
    over = np.where(ground, rng.normal(0, 0.01, x.size), rng.uniform(0.5, 4.0, x.size))
    z = 50 + 0.6 * y + 0.15 * np.sin(x) + over
    return np.column_stack([RIDGE[0] + x, RIDGE[1] + y, z]).round(3), ground


def region(path: Path, width: float) -> Path:
    """A region of the western ``width`` metres."""
    polygon = box(RIDGE[0] - 1, RIDGE[1] - 1, RIDGE[0] + width, RIDGE[1] + 20)
    geopandas.GeoDataFrame(geometry=[polygon], crs=32651).to_file(path)
    return path
