"""Clouds that lie on the disk, sorted by places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pyproj import CRS
from slopewatch.engine.displacement.stored_ground import StoredGround
from slopewatch.engine.pointcloud.in_parts import SpooledCloud, point_dtype


def on_disk(xyz: np.ndarray, file: Path, at_once: int) -> StoredGround:
    """Ground points (n, 3) in ``file``, of which ``at_once`` may be in memory."""
    records = np.empty(len(xyz), point_dtype(0))
    records["xyz"] = xyz
    records.tofile(file)
    return StoredGround.of(SpooledCloud(file, len(xyz), 0, 0, CRS.from_epsg(32651), file), at_once)
