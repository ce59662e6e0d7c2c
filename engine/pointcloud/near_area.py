"""The points of a compressed file near an area, kept while all of it is checked, so that it is decompressed once.

PDAL decompresses on one thread and takes twice as long for it as lazrs: what it clips is therefore written for it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from laspy import PackedPointRecord
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ..crs.working_frame import WorkingFrame
from .header import CloudHeader, preflight
from .records import coordinates, extra_dimensions
from .writing import Layout, laz_writer

_MARGIN_M = 0.5
"""By which the area is widened, so that it is not decided here what lies on its edge."""
_FIRST_FORMAT = 6
"""Point format from which on a record has one meaning to all programs."""


class NearArea:
    """Gathers the records of a file that lie within an area (m, of the frame) or close to it, with all they hold."""

    def __init__(self, header: CloudHeader, frame: WorkingFrame, area: BaseGeometry) -> None:
        self._header, self._frame = header, frame
        self._area = area.buffer(_MARGIN_M, join_style="mitre")
        shapely.prepare(self._area)
        self._records: list[NDArray[np.void]] = []

    def add(self, records: PackedPointRecord) -> None:
        """Keep what is near of records with all their fields."""
        west, south, east, north = self._area.bounds
        x, y = coordinates(records, self._header, self._frame.factors)[:, :2].T
        near = np.flatnonzero((x >= west) & (x <= east) & (y >= south) & (y <= north))
        near = near[shapely.intersects_xy(self._area, x[near], y[near])]
        if len(near):
            self._records.append(records.array[near])

    def written(self, output: Path) -> CloudHeader:
        """Write what was kept as LAS, in the order of the file, and forget it; the file itself if nothing was.

        Raises:
            InputError: as ``laz_writer``.
        """
        kept, self._records = self._records, []
        if not kept:
            return self._header
        source = self._header
        dimensions = tuple(extra_dimensions(source))
        layout = Layout(source.point_format, dimensions, source.scales, source.offsets, self._frame.crs)
        with laz_writer(output, layout, sum(len(records) for records in kept), source) as write:
            for records in kept:
                write(records)
        return preflight(output)


def near_area(header: CloudHeader, frame: WorkingFrame, area: BaseGeometry) -> NearArea | None:
    """Takes what is near the area; None where the file is better read from where it lies.

    That is a file which is not compressed, one of the formats before 6, and a COPC, of which less is read by its index.
    """
    if not header.compressed or header.point_format < _FIRST_FORMAT or header.copc:
        return None
    return NearArea(header, frame, area)
