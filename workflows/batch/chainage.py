"""Where a zone lies along a road: chainage, side and distance from a centreline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from pyproj import CRS
from shapely.geometry import LineString
from shapely.geometry.base import BaseGeometry

from ...engine.core.errors import InputError
from ...engine.zones.profile_lines import read_lines

BOTH = "both"


@dataclass(frozen=True)
class Place:
    """Chainage of a zone's ends (m), the side of the line in its direction, and the distance from it (m)."""

    begin: float
    end: float
    side: str
    distance: float


def read_centreline(path: Path, crs: CRS) -> tuple[tuple[LineString, ...], tuple[str, ...]]:
    """The lines of a file in metres of ``crs``, joined where one begins at another's end; and sentences on them.

    Raises:
        InputError: it cannot be read, or holds no line.
    """
    try:
        lines, notes = read_lines(path, crs)
    except InputError as error:
        raise InputError(str(error).replace("The profiles' lines", "The lines of the centreline")) from error
    joined = shapely.line_merge(shapely.MultiLineString([line.geometry for line in lines]), directed=True)
    parts = tuple(p for p in shapely.get_parts(joined) if isinstance(p, LineString))
    sentences = [note.replace("The profiles' lines", "The lines of the centreline") for note in notes]
    if len(parts) > 1:
        sentences.append(
            f"The centreline {path.name} has {len(parts)} pieces that do not join; chainage begins anew on each."
        )
    return parts, tuple(sentences)


def place_along(zone: BaseGeometry, lines: Sequence[LineString], start: float = 0.0) -> Place | None:
    """The place of a zone on the nearest of the lines; None without a line or a zone.

    Chainage is the distance along the line to the foot of the perpendicular (linear referencing), from that of the
    zone's first corner to that of its last.

    Args:
        start: chainage (m) at the beginning of each line.
    """
    if not lines or zone is None or zone.is_empty:
        return None
    line = min(lines, key=zone.distance)
    corners = shapely.points(shapely.get_coordinates(zone))
    along = shapely.line_locate_point(line, corners)
    begin, end = start + float(np.min(along)), start + float(np.max(along))
    distance = float(zone.distance(line))
    side = BOTH if distance == 0.0 else _side(zone.representative_point(), line)
    return Place(round(begin, 2), round(end, 2), side, round(distance, 2))


def _side(point: BaseGeometry, line: LineString) -> str:
    """left or right of the line, in its direction, by the piece of it that is nearest to the point."""
    corners = shapely.get_coordinates(line)
    pieces = shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1))
    distances = shapely.distance(pieces, point)
    nearest = np.flatnonzero(distances <= distances.min() * (1 + 1e-9))
    own = shapely.get_coordinates(point)[0]
    # at a corner two pieces are equally near: that which the point lies more square to decides
    crosses = []
    for number in nearest:
        forward, across = corners[number + 1] - corners[number], own - corners[number]
        length = float(np.hypot(*forward))
        if length > 0:
            crosses.append((forward[0] * across[1] - forward[1] * across[0]) / length)
    return "left" if max(crosses, key=abs, default=0.0) > 0 else "right"
