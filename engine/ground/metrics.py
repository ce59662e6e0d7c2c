"""What a ground extraction reports: areas, densities, ratios, vegetation cover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from laspy import DecompressionSelection
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Bool, Float, Index
from ..crs.working_frame import WorkingFrame
from ..geometry.numbered import lowest_of_each
from ..geometry.point_spacing import point_spacing
from ..pointcloud.extent import CheckedRecords, square_metres
from ..pointcloud.header import CloudHeader
from ..pointcloud.near_area import NearArea
from ..pointcloud.records import PLACES, coordinates
from .result import MIN_VEGETATION_HEIGHT_M
from .squares import square_numbers
from .tally import Tally, metre_squares, square_places

_CROWN_CELL = 0.1


@dataclass(frozen=True)
class FileCoverage:
    """What the points of a file cover: ``area`` (m²) of occupied squares of a metre; west, south, east and north, m.

    ``largest_class`` is that of the points as their bytes are: before LAS 1.4 these hold flags, too. ``has_class_12``
    is of formats before 6 only. ``places`` (m, 2) and ``counts`` (m,) are squares of a metre with the points that were
    counted, and these.
    """

    area: float
    bounds: tuple[float, float, float, float]
    largest_class: int
    has_class_12: bool
    places: Index
    counts: Float

    @property
    def points(self) -> int:
        """How many points were counted."""
        return int(self.counts.sum())


def coverage(xyz: Float) -> float:
    """Area (m²) of the squares of a metre that points (n, 2+) cover."""
    return float(len(square_metres(xyz)))


def file_coverage(
    header: CloudHeader,
    frame: WorkingFrame,
    counted: BaseGeometry | None = None,
    near: NearArea | None = None,
) -> FileCoverage:
    """What the points of a file cover in metres of ``frame``.

    Args:
        counted: points within this polygon are counted; all by default, none for an empty one.
        near: takes all records as they are read.

    Raises:
        InputError: the points are damaged.
    """
    covered, largest, has_class_12 = np.empty(0, dtype=np.int64), 0, False
    class_byte = "classification" if header.point_format > 5 else "raw_classification"
    checked = CheckedRecords(header, PLACES | DecompressionSelection.CLASSIFICATION if near is None else None)
    squares = Tally()
    if counted is not None:
        shapely.prepare(counted)
    for records in checked:
        if near is not None:
            near.add(records)
        largest = max(largest, int(records[class_byte].max()))
        if header.point_format < 6:
            has_class_12 = has_class_12 or bool((np.asarray(records["classification"]) == 12).any())
        xyz = coordinates(records, header, frame.factors)
        covered = np.union1d(covered, square_metres(xyz))
        if counted is None:
            squares.add(metre_squares(xyz))
        elif not counted.is_empty:
            squares.add(metre_squares(xyz[shapely.contains_xy(counted, xyz[:, 0], xyz[:, 1])]))
    places = square_places(squares.found()[0])
    bounds = checked.extent(frame).bounds
    return FileCoverage(float(len(covered)), bounds, largest, has_class_12, places, squares.counts())


def vegetation_cover(xyz: Float, flat: Float, ground: NDArray[np.bool_], dip: float) -> float:
    """Share of the ground that lies under plants, seen from above: C_v of the published workflow.

    The canopy cover of Jennings et al. 1999 (doi:10.1093/forestry/72.1.59), the vertical projection of crowns: cells
    whose highest point stands more than MIN_VEGETATION_HEIGHT_M above the ground, of all cells with points.

    Args:
        xyz: (n, 3) all points in metres.
        flat: (n, 3) the same points in the slope's frame.
        ground: (n,) which of them are ground.
        dip: angle of the slope's plane to the horizontal, degrees.
    """
    if not ground.any():
        return 0.0
    heights = crown_heights(xyz, flat, ground, dip, crown_cell(point_spacing(xyz[:, :2])))
    return float(np.mean(heights > MIN_VEGETATION_HEIGHT_M))


def crown_cell(spacing: float) -> float:
    """Side (m) of the cells of ``vegetation_cover`` for points that are ``spacing`` m apart, seen from above."""
    return max(_CROWN_CELL, 2.0 * spacing)


def crown_heights(
    xyz: Float,
    flat: Float,
    ground: Bool,
    dip: float,
    cell: float,
    *,
    origin: Float | None = None,
    counted: Bool | None = None,
) -> Float:
    """Heights (m) over the nearest ground of each cell's highest point; arguments as of ``vegetation_cover``.

    Args:
        origin: (2,) where the cells begin, see ``square_numbers``.
        counted: (n,) cells with another highest point are left out.
    """
    key = square_numbers(xyz, cell, origin)
    # of equally high points the last
    top = len(key) - 1 - lowest_of_each(key[::-1], -xyz[::-1, 2])
    highest = flat[top if counted is None else top[counted[top]]]
    base = flat[ground]
    if not len(base) or not len(highest):
        return np.zeros(len(highest))
    _, nearest = cKDTree(base[:, :2]).query(highest[:, :2])
    return np.asarray((highest[:, 2] - base[nearest, 2]) / max(np.cos(np.radians(dip)), 0.1), dtype=np.float64)
