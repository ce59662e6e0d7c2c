"""The ground of a survey as people corrected it: none in some areas, the lowest layer of returns in others."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from laspy import DecompressionSelection
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.spatial import QhullError
from shapely.geometry.base import BaseGeometry

from ...interface.corrections import EXCLUDE, GROUND, NOT_GROUND
from ...interface.seen import REACH_M
from ..core import cancellation
from ..core.arrays import Bool, Float, Index
from ..core.errors import InputError
from ..core.messages import shown
from ..geometry.numbered import distinct, lowest_of_each
from ..geometry.point_spacing import point_spacing
from ..pointcloud.header import preflight
from ..pointcloud.records import PLACES, coordinates, read_records
from ..pointcloud.writing import Copy, copies
from ..vector.corrections import Corrections
from . import pdal_pipelines
from .layered_ground import BARE_SCATTER_M, MIN_THRESHOLD_SCATTERS, MIN_WINDOW_RETURNS
from .lowest_layer import histograms, lowest_layers
from .result import GroundResult
from .squares import square_numbers

_MIN_RETURNS = 4
"""Fewer returns make no surface of triangles."""
_CLASSES = DecompressionSelection.XY_RETURNS_CHANNEL | DecompressionSelection.CLASSIFICATION


def corrected(result: GroundResult, corrections: Corrections) -> GroundResult:
    """The extraction with its classified and its ground cloud corrected, in place.

    Args:
        corrections: those that hold for this survey.

    Raises:
        InputError: nothing of the ground is left.
    """
    if not corrections.areas:
        return result
    count = correct_ground(
        (result.clipped, result.classified),
        (result.classified, result.ground),
        corrections,
        scatter=result.scatter,
        threshold=result.threshold,
    )
    return replace(result, ground_points=count, ground_ratio=count / result.roi_points)


def correct_ground(
    sources: tuple[Path, Path],
    outputs: tuple[Path, Path],
    corrections: Corrections,
    *,
    scatter: float,
    threshold: float,
) -> int:
    """Write the classified and the ground cloud of an extraction as corrected; how many points are ground.

    Points of areas with ``ground`` are ground if they lie in the lowest layer of their square (see ``lowest_layer``);
    those of areas with ``not_ground`` or ``exclude`` are none. The latter win where areas overlap.

    Args:
        sources: the clipped and the classified cloud of the extraction, with the same points.
        outputs: the classified and the ground cloud to write, which may be files that are there.
        scatter: of bare ground about its surface, metres; 0 where it is not known.
        threshold: largest distance of ground from its surface, metres; 0 where it is not known.

    Raises:
        InputError: nothing of the ground is left.
    """
    clipped, classified = sources
    polygons = list(shapely.get_parts(corrections.shape(GROUND)))
    without = shapely.union_all([corrections.shape(EXCLUDE), corrections.shape(NOT_GROUND)])
    noise = _classes(clipped, pdal_pipelines.NOISE) if polygons else None
    points = _points_in([*polygons, without], classified)
    ground = _classes(classified, (pdal_pipelines.GROUND,))
    for index, xyz in points[:-1]:
        ground[index] = False
        kept = np.ones(len(index), dtype=bool) if noise is None else ~noise[index]
        index = index[kept]
        ground[index[lowest_layer(xyz[kept], scatter, threshold)]] = True
    ground[points[-1][0]] = False
    if not ground.any():
        raise InputError(f"The corrections {shown(corrections.path)} leave no ground; make their areas smaller.")
    labels = np.where(ground, pdal_pipelines.GROUND, pdal_pipelines.UNCLASSIFIED).astype(np.uint8)
    names = [output.with_name(f"{output.stem}_corrected.laz") for output in outputs]
    with cancellation.temporary(names[0]), cancellation.temporary(names[1]):
        every, of_ground = (
            Copy(names[0], classification=labels),
            Copy(names[1], ground, classification=labels[ground]),
        )
        copies(classified, [every, of_ground])
        for name, output in zip(names, outputs, strict=True):
            os.replace(name, output)
    return int(np.count_nonzero(ground))


def lowest_layer(xyz: Float, scatter: float, threshold: float) -> Bool:
    """(n,) which returns (n, 3) of one area, metres, lie in the lowest layer of their square.

    A surface through the lowest returns of squares takes relief and inclination away; then ``lowest_layers`` says up to
    which height returns are ground. A square in which it does not say so keeps its lowest return.

    Args:
        scatter, threshold: as of ``correct_ground``.
    """
    if len(xyz) < _MIN_RETURNS:
        return np.ones(len(xyz), dtype=bool)
    local = xyz - xyz.mean(axis=0)
    side = max(REACH_M, MIN_WINDOW_RETURNS**0.5 * point_spacing(local))
    square = square_numbers(local, side)
    height = local[:, 2].copy()
    for surface in (_plane, _triangles):
        lowest = lowest_of_each(square, height)
        height = local[:, 2] - surface(local[lowest], local[:, :2])
    lowest = lowest_of_each(square, height)
    sigma = scatter or BARE_SCATTER_M
    place = distinct(square)[1]
    counts = histograms(height, place, len(lowest))
    layers = lowest_layers(counts, sigma, max(threshold, MIN_THRESHOLD_SCATTERS * sigma))
    found = (height <= layers.top[place]) & (height >= layers.ground[place] - threshold)  # not where that is NaN
    found[lowest] = True
    return np.asarray(found, dtype=np.bool_)


def _plane(points: Float, xy: Float) -> Float:
    """Heights (n,) at places (n, 2) of the plane through points (m, 3)."""
    terms = np.column_stack([points[:, :2], np.ones(len(points))])
    return np.asarray(np.column_stack([xy, np.ones(len(xy))]) @ np.linalg.lstsq(terms, points[:, 2], rcond=None)[0])


def _triangles(points: Float, xy: Float) -> Float:
    """Heights (n,) at places (n, 2) over triangles through points (m, 3), those of the plane beyond them."""
    plane = _plane(points, xy)
    if len(points) < _MIN_RETURNS:
        return plane
    try:
        within = LinearNDInterpolator(points[:, :2], points[:, 2])(xy)
    except QhullError:  # all points are on one line
        return plane
    # beyond the triangles the plane goes on, at the distance from it that the nearest point has
    rest = NearestNDInterpolator(points[:, :2], points[:, 2] - _plane(points, points[:, :2]))(xy) + plane
    return np.where(np.isnan(within), rest, within)


def _classes(cloud: Path, wanted: tuple[int, ...]) -> Bool:
    """(n,) whether each point of a cloud has one of the classes."""
    parts = read_records(preflight(cloud), selection=_CLASSES)
    return np.concatenate([np.isin(np.asarray(part["classification"]), wanted) for part in parts])


def _points_in(polygons: Sequence[BaseGeometry], cloud: Path) -> list[tuple[Index, Float]]:
    """Of each polygon, which of a cloud's points lie in it (m,), and their coordinates (m, 3), metres."""
    header = preflight(cloud)
    for polygon in polygons:
        shapely.prepare(polygon)
    found: list[list[tuple[Index, Float]]] = [[(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))] for _ in polygons]
    start = 0
    for records in read_records(header, selection=PLACES):
        xyz = coordinates(records, header)
        for polygon, pieces in zip(polygons, found, strict=True):
            inside = np.flatnonzero(shapely.contains_xy(polygon, xyz[:, 0], xyz[:, 1]))
            pieces.append((inside + start, xyz[inside]))
        start += len(records)
    return [
        (np.concatenate([index for index, _ in pieces]), np.concatenate([xyz for _, xyz in pieces])) for pieces in found
    ]
