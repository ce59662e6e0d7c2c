"""The survey that an extraction works on: its file, and the points within the region."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from laspy import DecompressionSelection
from numpy.typing import NDArray

from ..core.arrays import Bool, Float
from ..crs.working_frame import WorkingFrame
from ..geometry.dominant_plane import Plane
from ..pointcloud.copc import chunks_near, write_near
from ..pointcloud.header import CloudHeader, preflight
from ..pointcloud.near_area import NearArea
from ..pointcloud.records import PLACES, coordinates, read_records
from ..pointcloud.returns import Returns, last_returns
from ..vector.area import Roi


@dataclass(frozen=True)
class Source:
    """A sound cloud, the ``area`` (m²) that it covers, and whether its classes are more than PDAL compresses.

    ``has_class_12``: of a point format before 6, whose class 12 newer PDALs take for a flag. ``in_tiles``: its points
    within the region do not fit into memory in one piece. ``near`` holds those near the region where they were kept as
    the file was checked.
    """

    header: CloudHeader
    frame: WorkingFrame
    region: Roi | None
    area: float
    odd_classes: bool
    has_class_12: bool
    in_tiles: bool = False
    near: NearArea | None = None

    @property
    def flags_in_class(self) -> bool:
        """Formats before 6 have no class that large: what is in the upper bits of the byte are flags."""
        return self.odd_classes and self.header.point_format < 6


@dataclass(frozen=True)
class Clipped:
    """Points within the region without outliers: ``xyz`` (n, 3) metres, ``flat`` (n, 3) in the slope's frame.

    ``keep`` (m,) says which points of the clipped file they are, ``removed`` (m - n, 3) are the others in the slope's
    frame; ``spacing`` is between neighbours, metres.
    """

    keep: Bool
    xyz: Float
    flat: Float
    removed: Float
    returns: Returns
    plane: Plane
    spacing: float


def read_near(source: Source, near: Path) -> CloudHeader:
    """The file to clip: ``near``, with the points near the region where these were kept or the chunks of a COPC; else
    the cloud itself.

    Raises:
        InputError: as ``NearArea.written`` and ``copc.write_near``.
    """
    if source.near is not None:
        return source.near.written(near)
    if source.region is None:
        return source.header
    bounds = np.array(source.region.geometry.bounds).reshape(2, 2) / source.frame.horizontal_factor
    chunks = chunks_near(source.header, *bounds)
    if chunks is None:
        return source.header
    write_near(source.header, source.frame, chunks, near)
    return preflight(near)


def read_points(path: Path, *, flags_in_class: bool = False) -> tuple[Float, Returns, NDArray[np.uint8]]:
    """Coordinates (n, 3), returns and classes (n,) of a cloud that is in metres already.

    Raises:
        EmptyCloud, InputError: as ``preflight`` and ``read_records``.
    """
    header = preflight(path)
    xyz = np.empty((header.count, 3))
    number, total, labels = (np.empty(header.count, dtype=np.uint8) for _ in range(3))
    done = 0
    for records in read_records(header, selection=PLACES | DecompressionSelection.CLASSIFICATION):
        part = slice(done, done + len(records))
        xyz[part] = coordinates(records, header)
        number[part] = records["return_number"]
        total[part] = records["number_of_returns"]
        labels[part] = records["classification"]
        done += len(records)
    if flags_in_class:
        labels &= 0x1F
    return xyz, last_returns(number, total), labels
