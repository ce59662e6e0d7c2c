"""Writing records as LAZ (LAS 1.4) through laspy, with their reference system and extra dimensions."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from pathlib import Path

import laspy
import numpy as np
from laspy.point.dims import DimensionInfo, DimensionKind
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.exceptions import CRSError

from ..core.errors import EngineError
from ..core.staged_outputs import atomic_output
from ..core.version import VERSION
from .header import CloudHeader, Vector, preflight
from .records import ExtraDimension

_CREATED = 90
"""Place of the day and year of creation in a header; laspy always writes a day, where a new file is to have none."""


def write_laz(
    path: Path,
    groups: Iterable[NDArray[np.void]],
    count: int,
    *,
    point_format: int,
    dimensions: Sequence[ExtraDimension],
    scales: Vector,
    offsets: Vector,
    crs: CRS,
    source: CloudHeader | None = None,
) -> None:
    """Write ``count`` records in groups of the structure ``record_dtype(point_format, dimensions)``.

    Args:
        source: the file of which this is a copy; its file source, kind of GPS time and day of creation are kept.

    Raises:
        EngineError: what was written does not hold ``count`` points.
        InputError: the folder cannot be written.
    """
    header = laspy.LasHeader(version="1.4", point_format=point_format)
    header.scales, header.offsets = np.array(scales), np.array(offsets)
    header.system_identifier, header.generating_software = "SlopeWatch", f"SlopeWatch {VERSION}"
    header.global_encoding.wkt = True
    header.global_encoding.gps_time_type = source is None or source.standard_time
    header.file_source_id = source.file_source if source else 0
    header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", wkt_of(crs).encode() + b"\0"))
    described = b"".join(d.descriptor for d in dimensions)
    if described:
        header.vlrs.append(laspy.VLR("LASF_Spec", 4, "", described))
    extra = sum(d.dtype.itemsize for d in dimensions)
    if extra:
        # To laspy they are bytes: it would lose parts of the descriptions and put false ranges into them.
        kind = DimensionKind.UnsignedInteger
        header.point_format.dimensions.append(DimensionInfo("extra", kind, 8 * extra, extra, is_standard=False))
    with atomic_output(Path(path), lambda p: _check(p, count)) as temporary, temporary.open("w+b") as stream:
        writer = laspy.LasWriter(stream, header, laz_backend=laspy.LazBackend.LazrsParallel, closefd=False)
        for records in groups:
            writer.write_points(laspy.PackedPointRecord(records, header.point_format))
        writer.close()
        stream.seek(_CREATED)
        stream.write(struct.pack("<HH", *(source.created if source else (0, 0))))


def wkt_of(crs: CRS) -> str:
    """WKT 1, which every LAS reader knows; WKT 2 where that cannot say it."""
    try:
        text = crs.to_wkt("WKT1_GDAL")
        if text and CRS.from_wkt(text).equals(crs, ignore_axis_order=True):
            return str(text)
    except CRSError:
        pass
    return str(crs.to_wkt("WKT2_2019"))


def _check(path: Path, count: int) -> None:
    """Reopen what was written: a sound header, sound chunks, all points."""
    held = preflight(path).count
    if held != count:
        raise EngineError(f"{path.name} was written with {held} points instead of {count}")
