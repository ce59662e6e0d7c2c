"""What a ground extraction reports: areas, densities, ratios, vegetation cover."""

from __future__ import annotations

import numpy as np
from laspy import DecompressionSelection
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..core.arrays import Float
from ..geometry.point_spacing import point_spacing
from ..pointcloud.decoding_check import DecodedBounds
from ..pointcloud.header import CloudHeader
from ..pointcloud.records import PLACES, read_records

COVERAGE_CELL = 1.0
VEGETATION_HEIGHT = 0.3
"""Least height (m) above the ground of what counts as vegetation."""
_CROWN_CELL = 0.1


class Coverage:
    """Area seen from above that points cover: occupied cells of ``COVERAGE_CELL`` metres. Points come in parts.

    ``largest_class`` is that of the points of a file, as its bytes are: before LAS 1.4 these hold flags, too.
    """

    def __init__(self) -> None:
        self._cells = np.empty(0, dtype=np.int64)
        self.low = np.full(2, np.inf)
        self.high = np.full(2, -np.inf)
        self.largest_class = 0

    def add(self, x: Float, y: Float) -> None:
        column, row = (np.floor(v / COVERAGE_CELL).astype(np.int64) for v in (x, y))
        self._cells = np.union1d(self._cells, (column << 32) + row)
        for axis, v in enumerate((x, y)):
            self.low[axis] = min(self.low[axis], float(v.min()))
            self.high[axis] = max(self.high[axis], float(v.max()))

    @property
    def area(self) -> float:
        """Square metres."""
        return len(self._cells) * COVERAGE_CELL**2

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        return float(self.low[0]), float(self.low[1]), float(self.high[0]), float(self.high[1])


def coverage(xyz: Float) -> float:
    """Area (m²) that points (n, 2+) cover, see ``Coverage``."""
    covered = Coverage()
    if len(xyz):
        covered.add(xyz[:, 0], xyz[:, 1])
    return covered.area


def file_coverage(header: CloudHeader, factor: float) -> Coverage:
    """What the points of a file cover; ``factor`` turns its x and y into metres.

    Raises:
        InputError: the points are damaged.
    """
    covered, decoded = Coverage(), DecodedBounds(header)
    class_byte = "classification" if header.point_format > 5 else "raw_classification"
    for records in read_records(header, selection=PLACES | DecompressionSelection.CLASSIFICATION):
        decoded.add(records)
        covered.largest_class = max(covered.largest_class, int(records[class_byte].max()))
        covered.add(
            *((records[field] * header.scales[axis] + header.offsets[axis]) * factor for axis, field in enumerate("XY"))
        )
    decoded.finish()
    return covered


def vegetation_cover(xyz: Float, flat: Float, ground: NDArray[np.bool_], dip: float) -> float:
    """Share of the ground that lies under plants, seen from above: C_v of the published workflow.

    The canopy cover of Jennings et al. 1999 (doi:10.1093/forestry/72.1.59), the vertical projection of crowns: cells
    whose highest point stands more than VEGETATION_HEIGHT above the ground, of all cells with points.

    Args:
        xyz: (n, 3) all points in metres.
        flat: (n, 3) the same points in the slope's frame.
        ground: (n,) which of them are ground.
        dip: angle of the slope's plane to the horizontal, degrees.
    """
    if not ground.any():
        return 0.0
    cell = max(_CROWN_CELL, 2.0 * point_spacing(xyz[:, :2]))
    index = np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / cell).astype(np.int64)
    key = index[:, 0] * (int(index[:, 1].max()) + 1) + index[:, 1]
    order = np.lexsort((xyz[:, 2], key))
    last = np.ones(len(order), dtype=bool)
    last[:-1] = key[order][1:] != key[order][:-1]
    highest = flat[order[last]]
    base = flat[ground]
    _, nearest = cKDTree(base[:, :2]).query(highest[:, :2])
    height = (highest[:, 2] - base[nearest, 2]) / max(np.cos(np.radians(dip)), 0.1)
    return float(np.mean(height > VEGETATION_HEIGHT))
