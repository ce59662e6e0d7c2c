"""What a ground extraction reports: areas, densities, ratios, vegetation cover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from laspy import DecompressionSelection
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..core.arrays import Float
from ..crs.working_frame import WorkingFrame
from ..geometry.point_spacing import point_spacing
from ..pointcloud.extent import CheckedRecords, square_metres
from ..pointcloud.header import CloudHeader
from ..pointcloud.records import PLACES, coordinates
from .squares import first_of_runs, square_numbers

VEGETATION_HEIGHT = 0.3
"""Least height (m) above the ground of what counts as vegetation."""
_CROWN_CELL = 0.1


@dataclass(frozen=True)
class FileCoverage:
    """What the points of a file cover: ``area`` (m²) of occupied squares of a metre; west, south, east and north, m.

    ``largest_class`` is that of the points as their bytes are: before LAS 1.4 these hold flags, too.
    """

    area: float
    bounds: tuple[float, float, float, float]
    largest_class: int


def coverage(xyz: Float) -> float:
    """Area (m²) of the squares of a metre that points (n, 2+) cover."""
    return float(len(square_metres(xyz)))


def file_coverage(header: CloudHeader, frame: WorkingFrame) -> FileCoverage:
    """What the points of a file cover in metres of ``frame``.

    Raises:
        InputError: the points are damaged.
    """
    covered, largest = np.empty(0, dtype=np.int64), 0
    class_byte = "classification" if header.point_format > 5 else "raw_classification"
    checked = CheckedRecords(header, PLACES | DecompressionSelection.CLASSIFICATION)
    for records in checked:
        largest = max(largest, int(records[class_byte].max()))
        covered = np.union1d(covered, square_metres(coordinates(records, header, frame.factors)))
    return FileCoverage(float(len(covered)), checked.extent(frame).bounds, largest)


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
    key = square_numbers(xyz, cell)
    order = np.lexsort((xyz[:, 2], key))[::-1]
    highest = flat[order[first_of_runs(key[order])]]
    base = flat[ground]
    _, nearest = cKDTree(base[:, :2]).query(highest[:, :2])
    height = (highest[:, 2] - base[nearest, 2]) / max(np.cos(np.radians(dip)), 0.1)
    return float(np.mean(height > VEGETATION_HEIGHT))
