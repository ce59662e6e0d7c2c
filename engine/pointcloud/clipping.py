"""A cloud's points within an area, without PDAL: read and written by laspy, chosen by shapely.

The same points in the same order, with the same values, as PDAL's ``filters.crop`` and ``writers.las`` give.
"""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Bool
from ..crs.working_frame import WorkingFrame
from .header import CloudHeader
from .records import PLACES, coordinates, extra_dimensions, read_records
from .writing import Layout, laz_writer

MODERN_FORMAT = {0: 6, 1: 6, 2: 7, 3: 7, 6: 6, 7: 7, 8: 8}
"""The format of LAS 1.4 that holds what another one does."""
SCAN_ANGLE_STEP_DEGREES = 0.006
"""Unit of the scan angle from point format 6 on; before, it is whole degrees (LAS 1.4 R15, table 16)."""
CLIPPED_BY = f"laspy {laspy.__version__} and shapely {shapely.__version__}"


def clip(source: CloudHeader, frame: WorkingFrame, area: BaseGeometry | None, output: Path) -> int:
    """Write the points within an area as LAS 1.4 in metres, with all their dimensions; how many there are.

    Nothing is written where there is none. A point on the area's edge is within.

    Args:
        area: polygon or multipolygon in metres of the frame; None for the whole cloud.

    Raises:
        InputError: the points are damaged, or the output cannot be written.
    """
    inside = None if area is None else _inside(source, frame, area)
    count = source.count if inside is None else int(np.count_nonzero(inside))
    if not count:
        return 0
    factors = np.array(frame.factors)
    dimensions = tuple(extra_dimensions(source))
    # another unit is another scale: the integers of a point stay what they are
    scales, offsets = np.array(source.scales) * factors, np.array(source.offsets) * factors
    layout = Layout(MODERN_FORMAT[source.point_format], dimensions, scales, offsets, frame.crs)
    with laz_writer(output, layout, count, source) as write:
        read = 0
        for group in read_records(source):
            records = group.array if inside is None else group.array[inside[read : read + len(group)]]
            read += len(group)
            write(modern_records(records, source.point_format, layout.dtype))
    return count


def _inside(source: CloudHeader, frame: WorkingFrame, area: BaseGeometry) -> Bool:
    """(n,) whether a point lies in the area or on its edge."""
    shapely.prepare(area)
    found = [
        shapely.intersects_xy(area, *coordinates(group, source, frame.factors)[:, :2].T)
        for group in read_records(source, selection=PLACES)
    ]
    return np.concatenate(found)


def modern_records(records: NDArray[np.void], point_format: int, dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Records (n,) of a point format in the structure ``dtype`` of the format of LAS 1.4 that holds them."""
    made = np.zeros(len(records), dtype)
    for field in set(made.dtype.names or ()) & set(records.dtype.names or ()) - {"bit_fields"}:
        made[field] = records[field]
    bits = records["bit_fields"]
    if point_format >= 6:
        made["bit_fields"] = bits
        return made
    made["bit_fields"] = (bits & 0b111) | ((bits >> 3) & 0b111) << 4  # number of the return, of all returns
    classes = records["raw_classification"]
    made["classification"] = classes & 0x1F
    made["classification_flags"] = classes >> 5 | (bits & 0b1100_0000)  # direction and edge of the scan stay in place
    steps = records["scan_angle_rank"].astype(np.float32) / np.float32(SCAN_ANGLE_STEP_DEGREES)
    made["scan_angle"] = np.round(steps).astype(np.int16)
    return made
