"""Hazard zones of M3C2 distances: their means in cells of the plane along the face, joined and summed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import geopandas as gpd
import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.spatial import Delaunay, QhullError, cKDTree
from scipy.special import ndtr
from scipy.stats import false_discovery_control

from ...interface.parameters import ZoneParameters
from ..change.difference import uniform_shift
from ..core.arrays import Bool, Float, Index
from ..grid.grid import Grid, cell_index, snapped_grid
from ..grid.partition import Partition
from ..m3c2.distances import Distances
from ..m3c2.lattice import dominant_frame
from ..m3c2.level import plant_error, slope_of
from ..statistics.normal import quantile
from .extraction import Origin, Zones, extract_zones, footprint_frame
from .footprints import Cells, Detected, closed, edge_reach

MAX_OBLIQUE_DEG = 80.0
"""Angle of a cell's mean normal with the plane's up to which the cell counts; beyond it, several faces may be in it."""


@dataclass(frozen=True)
class Face:
    """The plane that fits core points best: ``origin`` (3,) m; ``axes`` (3, 3) along it, up it, and its normal."""

    origin: Float
    axes: Float

    @classmethod
    def of(cls, core: Float, normals: Float) -> Face:
        """Its normal is on the side of most of the ``normals`` (n, 3) at the points (n, 3)."""
        normal = dominant_frame(core)[2]
        normal = normal * (1.0 if np.median(normals @ normal) >= 0.0 else -1.0)
        along = np.array([-normal[1], normal[0], 0.0])
        along = along / np.linalg.norm(along) if np.linalg.norm(along) > 1e-6 else np.array([1.0, 0.0, 0.0])
        return cls(core.mean(axis=0), np.stack([along, np.cross(normal, along), normal]))

    def local(self, xyz: Float) -> Float:
        """(n, 3) of points (n, 3)."""
        return np.asarray((xyz - self.origin) @ self.axes.T)

    @property
    def dip(self) -> float:
        """Of the plane, degrees: 90 for a wall, more for an overhang."""
        return float(np.degrees(np.arccos(np.clip(self.axes[2, 2], -1.0, 1.0))))

    @property
    def seen_from(self) -> float:
        """Azimuth of the side of the normal, degrees from north."""
        return float(np.degrees(np.arctan2(self.axes[2, 0], self.axes[2, 1])) % 360.0)

    def on_map(self, frame: gpd.GeoDataFrame, local: Float) -> gpd.GeoDataFrame:
        """A frame of polygons in the plane as seen from above; ``local`` (n, 3) are points of the face."""
        tree = cKDTree(local[:, :2])

        def seen(places: Float) -> Float:
            out = local[tree.query(places)[1], 2]
            return np.asarray((np.column_stack([places, out]) @ self.axes + self.origin)[:, :2])

        return frame.set_geometry(_polygons(shapely.transform(frame.geometry.to_numpy(), seen)), crs=frame.crs)


def _polygons(shapes: NDArray[np.object_]) -> NDArray[np.object_]:
    """Valid polygons (n,) of those that a projection folded, without the lines that some parts become."""
    valid = shapely.make_valid(shapes)
    parts, number = shapely.get_parts(valid, return_index=True)
    inner, of_part = shapely.get_parts(parts, return_index=True)  # a collection may hold multipolygons
    kept = shapely.get_type_id(inner) == shapely.GeometryType.POLYGON
    made = np.full(len(shapes), shapely.MultiPolygon(), dtype=object)
    shapely.multipolygons(inner[kept], indices=number[of_part[kept]], out=made)
    return made


@dataclass(frozen=True)
class FaceCells:
    """Cells of a face, arrays (rows, columns): means of the measured core points, or the nearest one up to a diagonal
    away, NaN beyond. The mean of the distances is weighted by the area that each acts on.

    ``distance`` and its standard ``error`` are in metres; it is not divided by the number of core points, because
    neighbouring cylinders share their points. ``area`` is in m² (see ``Areas``), 0 where a cell has no plane of its
    own: its surface is too oblique (``MAX_OBLIQUE_DEG``), or one part of the face lies behind another, farther than a
    surface as oblique as that reaches from a cell to the next. ``left_out`` is the share of such core points.
    ``depth`` is how far the surface stands out from the plane, m; ``slope`` that of the normals, degrees; ``points``
    the number in the emptier cylinder; ``plants`` the part of the error that vegetation makes, m, None where no cloud
    states it.
    """

    face: Face
    local: Float
    grid: Grid
    distance: Float
    error: Float
    area: Float
    depth: Float
    slope: Float
    points: Index
    plants: Float | None
    left_out: float

    @classmethod
    def of(cls, found: Distances, cell: float) -> FaceCells:
        """Of cells of ``cell`` metres."""
        here = found.measured
        face = Face.of(found.core[here], found.normal[here])
        local = face.local(found.core[here])
        low, high = local[:, :2].min(axis=0), local[:, :2].max(axis=0)
        grid = snapped_grid((*low.tolist(), *high.tolist()), cell)
        index = cell_index(local[:, :2], grid)
        # near the vertical and in overhangs, normals that point upwards are on either side of the face
        side = np.where(found.normal[here] @ face.axes[2] < 0.0, -1.0, 1.0)
        normal, distance = (found.normal[here] * side[:, None]) @ face.axes.T, found.distance[here] * side
        areas = Areas.of(local, normal, found.reference.mean[here] * side, distance, cell)
        held, inside = _members(local[:, :2], index, _centres(grid), areas.amid(_centres(grid)), cell)
        cells = grid.rows * grid.columns

        def total(values: Float) -> Float:
            return np.bincount(inside, values[held], cells).reshape(grid.shape).astype(np.float64, copy=False)

        def mean(values: Float, weights: Float) -> Float:
            with np.errstate(invalid="ignore", divide="ignore"):
                return np.asarray(total(values * weights) / total(weights))

        alike = np.ones(len(local))
        # a core point that is a member of several cells has a part of its area in each
        part = 1.0 / np.bincount(held, minlength=len(local))
        normals = np.stack([mean(normal[:, k], alike) for k in range(3)], axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            upright = normals[..., 2] / np.linalg.norm(normals, axis=-1)
            alone = _step(index, local[:, 2], grid) <= _apart(cell) * np.tan(np.radians(MAX_OBLIQUE_DEG))
            whole = cell**2 * total(areas.acted_on) / total(areas.in_plane)
        # the triangles end within the cells beside those without core points
        amid = minimum_filter(total(alike) > 0, 3, mode="constant", cval=False)
        area = np.where(amid, total(areas.acted_on * part), whole)
        area = np.where(np.isnan(area), cell**2 / upright, area)
        area = np.where(alone & (upright >= np.cos(np.radians(MAX_OBLIQUE_DEG))), area, 0.0)
        distance = mean(distance, np.maximum(areas.acted_on, 1e-9 * cell**2) * part)
        steep = slope_of(normals.reshape(-1, 3) @ face.axes).reshape(grid.shape)
        plants = plant_error(found, np.flatnonzero(here))
        fewest = np.minimum(found.reference.count, found.moving.count)[here].astype(np.float64)
        return cls(
            face,
            local,
            grid,
            np.where(area > 0, distance, np.nan),
            np.where(area > 0, mean(found.level[here], alike) / quantile(found.confidence), np.nan),
            area,
            mean(local[:, 2], alike),
            steep,
            np.nan_to_num(mean(fewest, alike)).astype(np.int64),
            None if plants is None else found.plants_factor * mean(plants, alike),
            float(np.mean(area.ravel()[index] == 0.0)),
        )

    def discoveries(self, confidence: float) -> Bool:
        """Cells (rows, columns) that are significant with a false discovery rate of 1 - ``confidence``.

        At a level of 95 % one unchanged cell in twenty is significant. Here one in twenty of the significant cells is
        unchanged (Benjamini and Hochberg 1995; for errors that are alike nearby Benjamini and Yekutieli 2001).
        """
        known = np.isfinite(self.distance)
        significant = np.zeros(known.shape, dtype=np.bool_)
        if known.any():
            chance = 2.0 * ndtr(-np.abs(self.distance[known]) / self.error[known])
            significant[known] = false_discovery_control(chance) <= 1.0 - confidence
        return significant


def _centres(grid: Grid) -> Float:
    """(cells, 2) of a grid, row by row."""
    row, column = np.indices(grid.shape).reshape(2, -1)
    return np.column_stack([grid.west + (column + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell])


def _members(places: Float, index: Index, centres: Float, amid: Bool, cell: float) -> tuple[Index, Index]:
    """(m,) core points, and the cell that each is a member of.

    Core points are not one a cell. A cell without any that lies ``amid`` them has the nearest, up to a diagonal away.

    Args:
        index: (n,) cells of the core points at ``places`` (n, 2).
    """
    empty = np.bincount(index, minlength=len(centres)) == 0
    away, nearest = cKDTree(places).query(centres)
    taken = np.flatnonzero(empty & amid & (away <= np.sqrt(2.0) * cell))
    return np.append(np.arange(len(index)), nearest[taken]), np.append(index, taken)


def _apart(cell: float, between: int = 0) -> float:
    """How far apart in the plane core points of two cells that touch are at most, or with so many ``between``, m."""
    return float(np.sqrt(2.0)) * (2 + between) * cell


@dataclass(frozen=True)
class Areas:
    """What the distances act on: ``acted_on`` (n,) m² of each core point, and its part ``in_plane`` (n,) m² of the
    plane. ``net`` are triangles between the core points, of which those between near ones count.

    The sum of distance times area is the volume between the two surfaces that the triangles make, each through the
    means of one survey's cylinders. That holds on rough faces and where normals are noisy or cross, because each
    triangle sweeps the mean motion of its corners times its mean vector of area on the way.
    """

    acted_on: Float
    in_plane: Float
    net: Delaunay | None

    @classmethod
    def of(cls, local: Float, normal: Float, mean: Float, distance: Float, cell: float) -> Areas:
        """Args: core points and normals (n, 3); along these the mean of the reference and the distance (n,), m."""
        count = len(local)
        try:
            net = Delaunay(local[:, :2])
        except QhullError:  # few core points, or all on a line
            return cls(np.zeros(count), np.zeros(count), None)
        corners = net.simplices
        sides = local[corners] - local[np.roll(corners, 1, axis=1)]
        corners = corners[np.linalg.norm(sides[..., :2], axis=-1).max(axis=1) <= _apart(cell, between=1)]
        plane = _swept(corners, local, np.zeros((count, 3)))[:, 2]
        across = _swept(corners, local + mean[:, None] * normal, distance[:, None] * normal)
        across *= np.sign(plane)[:, None]

        def third(values: Float) -> Float:
            return np.bincount(corners.ravel(), np.repeat(values / 3.0, 3), count).astype(np.float64, copy=False)

        acted_on = np.sum([third(across[:, k]) * normal[:, k] for k in range(3)], axis=0)
        return cls(acted_on, third(np.abs(plane)), net)

    def amid(self, places: Float) -> Bool:
        """Which places (m, 2) of the plane lie amid the core points."""
        return np.zeros(len(places), dtype=np.bool_) if self.net is None else self.net.find_simplex(places) >= 0


def _swept(corners: Index, base: Float, moved: Float) -> Float:
    """Vectors (k, 3) of the areas of triangles (k, 3) of points, in the mean of their way, m².

    Args:
        base, moved: (n, 3) where the points are at first, and how they move.
    """
    first, second, third = corners.T
    (a, b), (c, d) = ((of[second] - of[first], of[third] - of[first]) for of in (base, moved))
    return np.asarray(np.cross(a, b) / 2 + (np.cross(a, d) + np.cross(c, b)) / 4 + np.cross(c, d) / 6)


def _by_the_edge(face: FaceCells) -> Float:
    """Standard error (rows, columns), m, of what cells on the survey's edge add to a sum: how much of each was seen is
    not known, anything from nothing to all, and may be alike along the whole edge.
    """
    whole = closed(np.isfinite(face.distance), edge_reach(face.grid.cell))
    edge = whole & ~minimum_filter(whole, 3, mode="constant", cval=False)
    return np.where(edge, np.abs(face.distance) / np.sqrt(12.0), 0.0)


def _step(index: Index, depth: Float, grid: Grid) -> Float:
    """How far a point of each cell (rows, columns) is before or behind one of the cell or those around it, m."""
    near, far = np.full(grid.shape, -np.inf), np.full(grid.shape, np.inf)
    np.maximum.at(near.ravel(), index, depth)
    np.minimum.at(far.ravel(), index, depth)
    return np.maximum(near - minimum_filter(far, 3), maximum_filter(near, 3) - far)


@dataclass(frozen=True)
class FaceZones:
    """Zones of a face, whose frames lie on the map; ``outlines`` are the zones in its plane, ``footprints`` those of
    the volumes; ``face`` what was measured, the cells, and which of them are significant.
    """

    face: FaceCells
    outlines: gpd.GeoDataFrame
    zones: Zones
    footprints: gpd.GeoDataFrame
    cells: Cells
    significant: Bool


def face_zones(
    found: Distances,
    cell: float,
    crs: CRS | None,
    parameters: ZoneParameters | None = None,
    *,
    origin: Origin | None = None,
) -> FaceZones:
    """Zones as of a change of heights (``extraction.extract_zones``), along the normals.

    Distances, areas and volumes are those of the surface. The polygons are seen from above. There are none where all
    of the face has moved alike.

    Args:
        cell: metres, the distance of the core points.
    """
    face = FaceCells.of(found, cell)
    partition = Partition(face.grid.shape, face.grid.cell)
    unknown = _by_the_edge(face)
    cells = Cells(face.distance, np.hypot(face.error, unknown), face.area, partition, face.plants, shared=unknown)
    significant = face.discoveries(found.confidence)
    if uniform_shift(found.distance[found.measured], found.level[found.measured]) is not None:
        significant[:] = False
    detected = Detected(significant, quantile(0.95) * face.error, face.points)
    error = found.registration_error
    zones = extract_zones(cells, detected, face.grid, crs, parameters, registration_error=error, origin=origin)
    footprints = face.face.on_map(footprint_frame(zones, face.grid), face.local)
    zone, slope = zones.labels.ravel(), np.nan_to_num(face.slope).ravel()
    number = np.maximum(np.bincount(zone, minlength=len(zones.frame) + 1), 1)
    steep = np.bincount(zone, slope, len(number))[1:] / number[1:]
    frame, unsure = (face.face.on_map(of, face.local) for of in (zones.frame.assign(slope_deg=steep), zones.unsure))
    return FaceZones(face, zones.frame, replace(zones, frame=frame, unsure=unsure), footprints, cells, significant)
