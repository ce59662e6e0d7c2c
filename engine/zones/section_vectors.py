"""Displacement vectors in the plane of a section: along the line and upwards, of those that lie near it."""

from __future__ import annotations

from dataclasses import dataclass

import geopandas as gpd
import numpy as np
import shapely
from shapely.geometry import LineString

from ..core.arrays import Bool, Float

_STEP_M = 0.01  # along the line, over which its direction at a place is taken


@dataclass(frozen=True)
class SectionVectors:
    """Vectors near a line, in the order along it.

    Attributes:
        distance: (n,) of each vector's place from the line's start, measured along the line, metres.
        along: (n,) motion along the line, positive in its direction, metres.
        up: (n,) motion upwards, metres.
        across: (n,) motion out of the section, positive to the left as one walks along the line, metres.
    """

    distance: Float
    along: Float
    up: Float
    across: Float

    def __len__(self) -> int:
        return len(self.distance)


def vectors_near(line: LineString, vectors: gpd.GeoDataFrame) -> SectionVectors:
    """The vectors whose places lie within half of their own window of a line.

    Args:
        vectors: points with the fields ``east_m``, ``north_m``, ``up_m`` and ``window_m``, in the line's reference
            system, metres.
    """
    points = np.asarray(vectors.geometry)
    off = shapely.distance(line, points)
    distance = shapely.line_locate_point(line, points)
    at_foot = shapely.distance(shapely.line_interpolate_point(line, distance), points)
    use: Bool = np.asarray((off <= vectors["window_m"].to_numpy() / 2) & np.isclose(at_foot, off))
    # what lies beyond the ends is on no section
    use &= (distance > 0) & (distance < line.length)
    order = np.flatnonzero(use)[np.argsort(distance[use], kind="stable")]
    distance = distance[order]
    ahead = _directions(line, distance)
    motion = vectors[["east_m", "north_m"]].to_numpy(dtype=np.float64)[order]
    return SectionVectors(
        distance,
        (motion * ahead).sum(axis=1),
        vectors["up_m"].to_numpy(dtype=np.float64)[order],
        motion[:, 1] * ahead[:, 0] - motion[:, 0] * ahead[:, 1],
    )


def _directions(line: LineString, distance: Float) -> Float:
    """Unit vector of the line's direction at each distance, (n, 2)."""
    ends = [np.clip(distance + side * _STEP_M / 2, 0.0, line.length) for side in (-1, 1)]
    start, stop = (shapely.get_coordinates(shapely.line_interpolate_point(line, end)) for end in ends)
    step = stop - start
    return np.asarray(step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12))
