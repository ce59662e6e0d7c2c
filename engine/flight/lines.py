"""Flight lines over a region: parallel, at constant height over the ground, no steeper than the carrier climbs."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Polygon

from ...interface.parameters import FlightParameters, given
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.messages import shown
from .terrain import Terrain

_STEP_M = 1.0  # between the places at which the ground under a line is looked at
_MAX_LINES = 2000
_MIN_SLOPE_DEG = 3.0  # of a region's mean plane; on flatter ground lines run along the region's longer side


@dataclass(frozen=True)
class Line:
    """One flight line: its waypoints ``xyz`` (k, 3) as flown, k >= 2, and the ground ``under`` them (k,), metres.

    ``track`` (n, 3) are places along it at most about a metre apart, with the height flown, ``ground`` (n,) theirs.
    """

    number: int
    xyz: Float
    under: Float
    track: Float
    ground: Float

    @property
    def length(self) -> float:
        return float(np.linalg.norm(np.diff(self.xyz, axis=0), axis=1).sum())

    @property
    def over_ground(self) -> Float:
        """Heights over the ground along the track (n,), metres."""
        return np.asarray(self.track[:, 2] - self.ground)


@dataclass(frozen=True)
class Swath:
    """Half the field of view (radians), width of a strip on flat ground and distance of the lines (metres)."""

    half: float
    width: float
    spacing: float


def swath_of(parameters: FlightParameters) -> Swath:
    """The strip of one line.

    On a slope strips are wider, h tan(a) (1 / (1 + tan(a) tan(s)) + 1 / (1 - tan(a) tan(s))) for half the field of
    view a and the slope s, so that the overlap is at least the one asked for.
    """
    half = math.radians(parameters.field_of_view / 2)
    width = 2 * parameters.altitude * math.tan(half)
    spacing = width * (1 - parameters.side_overlap)
    if spacing < 1.0:
        raise InputError(
            f"A field of view of {parameters.field_of_view:g} degrees at {parameters.altitude:g} m with a side overlap "
            f"of {parameters.side_overlap:g} leaves {spacing:.2f} m from line to line, less than 1 m; give a wider "
            "field of view or less overlap."
        )
    return Swath(half, width, spacing)


def line_azimuth(region: Polygon | MultiPolygon, terrain: Terrain) -> tuple[float, float]:
    """Azimuth of the contour of the region's mean plane, and the plane's inclination, both in degrees.

    On ground flatter than 3 degrees, the azimuth of the region's longer side.
    """
    rows, columns = np.nonzero(terrain.known & np.isfinite(terrain.heights))
    x = terrain.grid.west + (columns + 0.5) * terrain.grid.cell
    y = terrain.grid.north - (rows + 0.5) * terrain.grid.cell
    inside = shapely.contains_xy(region, x, y)
    if inside.sum() < 3:
        raise InputError(
            f"The region lies outside of the terrain {shown(terrain.path)}, of which {int(inside.sum())} known cells "
            "lie in it; check both and their reference systems."
        )
    x, y, z = x[inside], y[inside], terrain.heights[rows[inside], columns[inside]]
    design = np.column_stack([np.ones(len(x)), x - x.mean(), y - y.mean()])
    _, east, north = np.linalg.lstsq(design, z, rcond=None)[0]
    slope = math.degrees(math.atan(math.hypot(east, north)))
    if slope < _MIN_SLOPE_DEG:
        ring = np.array(shapely.minimum_rotated_rectangle(region).exterior.coords)
        side = max((ring[1] - ring[0], ring[2] - ring[1]), key=lambda v: float(np.hypot(*v)))
        return math.degrees(math.atan2(side[0], side[1])) % 180.0, slope
    return math.degrees(math.atan2(-north, east)) % 180.0, slope


def plan_lines(region: Polygon | MultiPolygon, terrain: Terrain, parameters: FlightParameters) -> list[Line]:
    """Lines over ``region`` widened by the margin, flown to and fro, from the lowest side of the slope upwards.

    The outermost lines run along the edges of the widened region, the others evenly between them, at most as far apart
    as field of view and overlap allow; so every place lies between two lines.

    Raises:
        InputError: the region does not lie on the terrain, a line leaves it, or comes too near to ground or plants.
    """
    swath = swath_of(parameters)
    contour, _ = line_azimuth(region, terrain)
    wanted = given(parameters.azimuth)
    azimuth = math.radians(contour if wanted is None else wanted)
    along = np.array([math.sin(azimuth), math.cos(azimuth)])
    across = np.array([along[1], -along[0]])
    origin = np.array(region.centroid.coords[0])
    ring = shapely.get_coordinates(region) - origin
    low, high = float((ring @ across).min()) - parameters.margin, float((ring @ across).max()) + parameters.margin
    count = max(2, math.ceil((high - low) / swath.spacing - 1e-9) + 1)
    if count > _MAX_LINES:
        raise InputError(f"The region needs {count:,} lines, more than {_MAX_LINES:,}; divide it or fly higher.")
    tracks = []
    for place in np.linspace(low, high, count):
        strip = (ring @ across > place - swath.width / 2) & (ring @ across < place + swath.width / 2)
        reach = _along_strip(region, origin, along, across, (place - swath.width / 2, place + swath.width / 2))
        if reach is None:
            reach = (ring[strip] if strip.any() else ring) @ along
            reach = (float(reach.min()), float(reach.max()))
        ends = np.array([[reach[0] - parameters.margin], [reach[1] + parameters.margin]])
        tracks.append(origin + ends * along + place * across)
    first, last = (np.nan_to_num(terrain.at(_steps(track))).mean() for track in (tracks[0], tracks[-1]))
    if last < first:
        tracks.reverse()
    return lines_along([t if n % 2 == 0 else t[::-1] for n, t in enumerate(tracks)], terrain, parameters)


def _along_strip(
    region: Polygon | MultiPolygon, origin: Float, along: Float, across: Float, strip: tuple[float, float]
) -> tuple[float, float] | None:
    """How far the part of the region within a strip reaches along the lines; None where none of it is."""
    far = 2 * float(np.abs(shapely.get_coordinates(region) - origin).max()) + 1.0
    corners = [
        origin + u * along + v * across for u, v in zip((-far, far, far, -far), np.repeat(strip, 2), strict=True)
    ]
    part = region.intersection(Polygon(corners))
    if part.is_empty:
        return None
    reach = (shapely.get_coordinates(part) - origin) @ along
    return float(reach.min()), float(reach.max())


def lines_along(tracks: list[Float], terrain: Terrain, parameters: FlightParameters) -> list[Line]:
    """Lines over the plan of each track (k, 2), in their order, with heights of this terrain.

    The height is the lowest that is nowhere less than ``altitude`` over the ground below and nowhere steeper than the
    carrier climbs at its speed: z(s) = max over t of ground(t) + altitude - slope |s - t|.

    Raises:
        InputError: see ``plan_lines``.
    """
    steepest = parameters.climb_rate / parameters.flying_speed
    lines = []
    for number, track in enumerate(tracks, 1):
        xy = _steps(np.asarray(track, dtype=np.float64)[:, :2])
        ground = terrain.at(xy)
        _refuse_holes(number, xy, ground, terrain)
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
        height = lowest_flyable(way, ground + parameters.altitude, steepest)
        corners = _corners(np.asarray(track, dtype=np.float64)[:, :2], xy)
        kept = np.union1d(corners, simplified(way, height, parameters.height_tolerance))
        flown = np.interp(way, way[kept], height[kept])
        flown += max(0.0, float((height - flown).max()))  # never lower than asked for
        xyz = np.column_stack([xy, flown])
        lines.append(Line(number, xyz[kept], ground[kept], xyz, ground))
    _refuse_near(lines, terrain, parameters)
    return lines


def lowest_flyable(way: Float, least: Float, steepest: float) -> Float:
    """The lowest heights (n,) along ``way`` (n,) that are at least ``least`` and nowhere steeper than ``steepest``."""
    rising = np.maximum.accumulate(least + steepest * way) - steepest * way
    falling = np.maximum.accumulate((least - steepest * way)[::-1])[::-1] + steepest * way
    return np.maximum(rising, falling)


def simplified(way: Float, height: Float, tolerance: float) -> np.ndarray:
    """Indices of the places that a line through them needs to keep within ``tolerance`` m (Douglas, Peucker 1973)."""
    kept, waiting = {0, len(way) - 1}, [(0, len(way) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        inner = np.arange(first + 1, last)
        chord = np.interp(way[inner], way[[first, last]], height[[first, last]])
        error = np.abs(height[inner] - chord)
        worst = int(np.argmax(error))
        if error[worst] > tolerance:
            kept.add(int(inner[worst]))
            waiting += [(first, int(inner[worst])), (int(inner[worst]), last)]
    return np.array(sorted(kept))


def _steps(track: Float) -> Float:
    """Places (n, 2) along a track (k, 2) at most a metre apart, its corners among them."""
    parts = [track[:1]]
    for start, end in itertools.pairwise(track):
        count = max(1, math.ceil(float(np.hypot(*(end - start))) / _STEP_M))
        parts.append(start + (end - start) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(parts)


def _corners(track: Float, xy: Float) -> np.ndarray:
    return np.array([int(np.argmin(((xy - corner) ** 2).sum(axis=1))) for corner in track])


def _refuse_holes(number: int, xy: Float, ground: Float, terrain: Terrain) -> None:
    unknown = ~np.isfinite(ground)
    if unknown.any():
        x, y = xy[np.flatnonzero(unknown)[0]]
        raise InputError(
            f"The terrain {shown(terrain.path)} has no height under {int(unknown.sum())} of {len(xy)} m of line "
            f"{number}, first at x {x:.1f}, y {y:.1f}; give a terrain that reaches farther, a smaller --margin, or a "
            "larger --bridged-terrain."
        )


def _refuse_near(lines: list[Line], terrain: Terrain, parameters: FlightParameters) -> None:
    found = [clearance_of(line, terrain) for line in lines]
    worst = int(np.argmin(found))
    if found[worst] < parameters.clearance:
        least = max(found[worst], 0.0)
        raise InputError(
            f"Line {lines[worst].number} comes within {least:.1f} m of ground or plants at an altitude of "
            f"{parameters.altitude:g} m, and --clearance asks for {parameters.clearance:g} m; raise --altitude."
        )


def clearance_of(line: Line, terrain: Terrain) -> float:
    """Least distance (m, in space) from a line to ground or plants; negative where these are higher than the line."""
    reach = float((line.track[:, 2] - line.ground).max())
    low, high = line.track[:, :2].min(axis=0) - reach, line.track[:, :2].max(axis=0) + reach
    rows, columns = np.nonzero(np.isfinite(terrain.tops))
    x = terrain.grid.west + (columns + 0.5) * terrain.grid.cell
    y = terrain.grid.north - (rows + 0.5) * terrain.grid.cell
    near = (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
    places = np.column_stack([x[near], y[near], terrain.tops[rows[near], columns[near]]])
    plan = cKDTree(places[:, :2])
    _, below = plan.query(line.track[:, :2])
    under = float((line.track[:, 2] - places[below, 2]).min())
    if under <= 0:
        return under
    return float(min(cKDTree(places).query(line.track)[0].min(), under))
