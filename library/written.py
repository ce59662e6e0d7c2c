"""Surveys into files."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from ..engine.core.staged_outputs import atomic_output
from ..engine.ground.pdal_pipelines import GROUND
from ..engine.pointcloud.plant_cover import ERROR, HEIGHT
from .given import LOCAL, Survey

Dimensions = Mapping[str, NDArray[np.generic]]
_STEP_M = 0.0001  # of coordinates: far below any error, and LAS then reaches 214 km


def write_survey(survey: Survey, path: Path, *, ground: bool = False, dimensions: Dimensions | None = None) -> Path:
    """Write a survey as LAZ in metres; records that laspy read keep their other dimensions.

    Args:
        ground: give all points class 2.
        dimensions: further ones of the points (n,), by name.
    """
    points = survey.points
    if survey.source is None or survey.rows is None:
        las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
        las.points = laspy.ScaleAwarePointRecord.zeros(len(points), header=las.header)
    else:
        las = laspy.LasData(survey.source.header, survey.source.points[survey.rows])
    header = laspy.LasHeader(point_format=las.header.point_format, version=las.header.version)
    header.scales = np.full(3, _STEP_M)
    header.offsets = np.floor(points.xyz.mean(axis=0))
    if points.crs is not LOCAL:
        header.add_crs(points.crs)
    out = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(len(points), header=header))
    for name in las.point_format.dimension_names:
        if name not in ("X", "Y", "Z"):
            out[name] = las[name]
    out.x, out.y, out.z = points.xyz.T
    if ground:
        out.classification[:] = GROUND
    plants = {ERROR: points.plant_error, HEIGHT: points.plant_height}
    for name, values in (plants | dict(dimensions or {})).items():
        if values is not None:
            if name not in out.point_format.dimension_names:
                out.add_extra_dim(laspy.ExtraBytesParams(name, values.dtype))
            out[name] = values
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_output(path) as part:
        out.write(part, do_compress=True)
    return path


def hash_of(survey: Survey) -> str:
    """SHA-256 of the coordinates."""
    return hashlib.sha256(survey.points.xyz.tobytes()).hexdigest()
