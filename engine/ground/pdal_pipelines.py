"""The PDAL pipelines of the ground extraction, as lists of stages."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import GroundParameters
from ..crs.working_frame import WorkingFrame
from ..geometry.dominant_plane import Plane, flattening_matrix, unflattening_matrix
from ..pointcloud.clipping import MODERN_FORMAT
from ..pointcloud.declared_crs import declared_crs
from ..pointcloud.header import CloudHeader
from ..pointcloud.records import extra_dimensions
from ..pointcloud.writing import wkt_of

Stage = dict[str, Any]
GROUND, UNCLASSIFIED = 2, 1
NOISE = (7, 18)
"""Low and high noise, where the file says so itself (LAS 1.4)."""
WAVEFORM_FORMATS = (4, 5, 9, 10)
"""Point formats that PDAL does not read."""
MAX_PDAL_CLASS = 31
"""Classes above it stop PDAL 2.2 when it compresses; they are written uncompressed. It takes the flags that formats
before 6 keep in the same byte for such classes, too."""
_PDAL_NAMES = frozenset((
    "x", "y", "z", "intensity", "returnnumber", "numberofreturns", "scandirectionflag", "edgeofflightline",
    "classification", "scananglerank", "scanangle", "userdata", "pointsourceid", "pointid", "gpstime", "red",
    "green", "blue", "infrared", "scanchannel", "classflags", "synthetic", "keypoint", "withheld", "overlap",
))  # fmt: skip
"""A point's own dimensions, which one of the file with such a name would overwrite."""
_SCALED = 0b11000
"""Options of an extra dimension with a scale or an offset, which PDAL applies."""


def clip_pipeline(
    source: Path, output: Path, header: CloudHeader, frame: WorkingFrame, area: BaseGeometry | None
) -> list[Stage]:
    """Read, convert to metres, crop to the area, write LAS 1.4.

    Args:
        area: polygon or multipolygon in metres of the frame; None for the whole cloud.
    """
    stages: list[Stage] = [_reader(source, header)]
    declared, unreadable = declared_crs(header)
    if declared is None and unreadable:
        stages[0]["override_srs"] = wkt_of(frame.crs)  # PDAL stops at a reference system that it cannot read
    factors = (frame.horizontal_factor, frame.horizontal_factor, frame.vertical_factor)
    if not frame.in_metres:
        stages.append({"type": "filters.transformation", "matrix": matrix_text(np.diag([*factors, 1.0]))})
    if area is not None:
        stages.append({"type": "filters.crop", "polygon": shapely.to_wkt(area, rounding_precision=-1)})
    writer = _writer(output, header)
    writer["a_srs"] = wkt_of(frame.crs)
    if not frame.in_metres:
        # another unit is another scale: the integers of a point stay what they are
        for axis, factor, scale, offset in zip("xyz", factors, header.scales, header.offsets, strict=True):
            writer[f"scale_{axis}"], writer[f"offset_{axis}"] = scale * factor, offset * factor
    return [*stages, writer]


def cloth_pipeline(
    source: Path,
    output: Path,
    header: CloudHeader,
    parameters: GroundParameters,
    threshold: float,
    plane: Plane | None,
    last_returns: bool,
) -> list[Stage]:
    """Lay the slope flat, filters.csf, lay it back; write all points with class 1 or 2.

    Args:
        threshold: distance (m) to the cloth within which points become class 2.
        plane: laid flat first; None leaves the cloud as it is.
        last_returns: only last and only returns take part; the others become class 1.
    """
    stages: list[Stage] = [_reader(source, header)]
    # filters.csf leaves points that take no part as they are
    stages.append({"type": "filters.assign", "value": f"Classification = {UNCLASSIFIED}"})
    if plane is not None:
        stages.append({"type": "filters.transformation", "matrix": matrix_text(flattening_matrix(plane))})
    stages.append(
        {
            "type": "filters.csf",
            "resolution": parameters.cloth_resolution,
            "rigidness": parameters.rigidness,
            "step": parameters.time_step,
            "iterations": parameters.iterations,
            "smooth": parameters.slope_smoothing,
            "threshold": threshold,
            "returns": "last,only" if last_returns else "first,last,intermediate,only",
        }
    )
    if plane is not None:
        stages.append({"type": "filters.transformation", "matrix": matrix_text(unflattening_matrix(plane))})
    return [*stages, _writer(output, header)]


def select_pipeline(source: Path, output: Path, header: CloudHeader) -> list[Stage]:
    """The points of class 2 of a classified cloud."""
    limits = f"Classification[{GROUND}:{GROUND}]"
    return [_reader(source, header), {"type": "filters.range", "limits": limits}, _writer(output, header)]


def matrix_text(matrix: NDArray[np.float64]) -> str:
    """A (4, 4) matrix row by row, each number with all its digits."""
    return " ".join(repr(float(v)) for v in matrix.ravel())


def _reader(path: Path, header: CloudHeader) -> Stage:
    stage: Stage = {"type": "readers.las", "filename": str(path)}
    extra = _extra_bytes(header)
    if any(name != original for name, _, original in extra):
        # PDAL stops at names it does not take, so it gets the layout under other names
        stage["ignore_vlr"] = "LASF_Spec/4"
        stage["extra_dims"] = ",".join(f"{name}={kind}" for name, kind, _ in extra)
    elif header.version != "1.4" and extra:
        stage["use_eb_vlr"] = True
    return stage


def _writer(path: Path, header: CloudHeader) -> Stage:
    """Coordinates on the same grid of integers, all dimensions; variable length records are not carried over.

    A COPC's index, for one, would be wrong.
    """
    stage: Stage = {
        "type": "writers.las",
        "filename": str(path),
        "forward": "header,scale,offset",
        "minor_version": 4,
        "dataformat_id": MODERN_FORMAT[header.point_format],
    }
    if path.suffix.lower() == ".laz":
        stage["compression"] = "laszip"
    extra = _extra_bytes(header)
    scaled = {d.name for d in extra_dimensions(header) if d.descriptor and d.descriptor[3] & _SCALED}
    kinds = [(name, "double" if original in scaled and name == original else kind) for name, kind, original in extra]
    if kinds:
        stage["extra_dims"] = ",".join(f"{name}={kind}" for name, kind in kinds)
    return stage


def _extra_bytes(header: CloudHeader) -> list[tuple[str, str, str]]:
    """Name and type for PDAL, and the name in the file, of each extra dimension; raw bytes one by one."""
    kinds = {"u": "uint", "i": "int"}
    found = []
    for dimension in extra_dimensions(header):
        name = re.sub("[^A-Za-z0-9_]", "_", dimension.name)
        name = name if name[0].isalpha() and name.casefold() not in _PDAL_NAMES else f"X{name}"
        size = dimension.dtype.itemsize
        if dimension.dtype.kind in kinds:
            found.append((name, f"{kinds[dimension.dtype.kind]}{8 * size}_t", dimension.name))
        elif dimension.dtype.kind == "f":
            found.append((name, {4: "float", 8: "double"}[size], dimension.name))
        else:
            found += [(f"{name}_{byte}", "uint8_t", dimension.name) for byte in range(size)]
    return found
