"""Surveys of slopes as long as one likes, in little memory: one simulated piece, mirrored and put end to end.

At the edge of a piece the next one is its mirror image, so the ground goes on without a step. Points, plants and change
repeat every 200 m; how long the work on them takes does not depend on that. The surveys are moved against each other by
a known translation.
"""

from __future__ import annotations

import math
from datetime import date
from pathlib import Path

import laspy
import numpy as np
from pyproj import CRS

from ...engine.core.arrays import Float
from ...interface.parameters import SurveyParameters
from ...simulation.frame import Frame
from ...simulation.surveys.survey import CRS as SYSTEM
from ...simulation.surveys.survey import rectangle, simulate_pair
from ...simulation.surveys.write import write_region, write_survey

LENGTH_M = 100.0
PIECE = SurveyParameters(seed=1, points=1_117_000, length=LENGTH_M, offset=0.0)
"""A million points of it lie along the hundred metres; the rest lies beyond their ends."""
RUN_M = PIECE.height / math.tan(math.radians(PIECE.angle))
"""From toe to crest, across the road."""
OFFSET_M = np.array([0.11, -0.09, 0.14])
"""What the later survey is moved by, and registration must undo."""
DATES = ("2024-05-01", "2025-05-01")


def frame_of(azimuth: float) -> Frame:
    """The frame of a slope that faces ``azimuth`` degrees from north: 180 lies along the axes."""
    return Frame(dip_azimuth=azimuth)


def write_piece(folder: Path, azimuth: float, parameters: SurveyParameters = PIECE) -> int:
    """Write one piece's two surveys and its region (DATE.laz, roi.gpkg) into a folder; the points of the first."""
    folder.mkdir(parents=True, exist_ok=True)
    pair = simulate_pair(parameters, frame=frame_of(azimuth))
    write_region(folder / "roi.gpkg", pair.roi, CRS.from_user_input(SYSTEM), date.fromisoformat(DATES[0]))
    held = 0
    for day, cloud in zip(DATES, (pair.first, pair.second), strict=True):
        path = folder / f"{day}.laz"
        write_survey(path, cloud, CRS.from_user_input(SYSTEM), day)
        las = laspy.read(path)
        along = pair.scene.frame.to_local(np.asarray(las.xyz))[:, 0]
        las.points = las.points[(along >= 0) & (along < parameters.length)]
        las.write(path)
        held = held or len(las.points)
    return held


def write_long(piece: Path, target: Path, count: float, frame: Frame, moved: bool, length: float = LENGTH_M) -> int:
    """Write ``count`` copies of a piece's cloud end to end, every second one mirrored; the points written.

    Args:
        count: of the last copy the part behind the point is written, as long as it.
        moved: whether the copies are moved by minus OFFSET_M, as a survey that must be registered.
        length: of the piece, m along u, from 0.
    """
    las = laspy.read(piece)
    local = frame.to_local(np.asarray(las.xyz))
    header = laspy.LasHeader(point_format=las.header.point_format, version=las.header.version)
    header.scales, header.global_encoding = las.header.scales, las.header.global_encoding
    header.offsets, header.vlrs = las.header.offsets, las.header.vlrs
    header.creation_date = las.header.creation_date
    written = 0
    with laspy.open(target, mode="w", header=header) as writer:
        for number in range(math.ceil(count)):
            copy = placed(local, number, length)
            kept = copy[:, 0] <= count * length
            points = laspy.ScaleAwarePointRecord(
                las.points.array[kept], las.points.point_format, header.scales, header.offsets
            )
            points["x"], points["y"], points["z"] = (frame.to_world(copy[kept]) - moved * OFFSET_M).T
            writer.write_points(points)
            written += len(points)
    return written


def placed(local: Float, number: int, length: float) -> Float:
    """The ``number``-th copy of a piece's points (n, 3), u from 0 to ``length``: odd ones are mirrored along u."""
    copy = local.copy()
    copy[:, 0] = number * length + (length - local[:, 0] if number % 2 else local[:, 0])
    return copy


def write_long_region(path: Path, count: float, frame: Frame) -> None:
    """Write the region of ``count`` pieces, from toe to crest."""
    ring = rectangle((0.0, 0.0, count * LENGTH_M, RUN_M), frame)
    write_region(path, ring, CRS.from_user_input(SYSTEM), date.fromisoformat(DATES[0]))
