"""Hazard zones of M3C2 distances: their means in cells of the plane along the face, joined and summed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import geopandas as gpd
import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from scipy.interpolate import LinearNDInterpolator
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
    away, NaN beyond. The distance is that at the cell's centre, linear between core points.

    ``distance`` and its standard ``error`` are in metres; it is not divided by the number of core points, because
    neighbouring cylinders share their points. ``area`` is in m² (see ``_halfway``), 0 where a cell has no plane of its
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
        normal, distance = found.normal[here] * side[:, None], found.distance[here] * side
        values = np.column_stack([distance, local[:, 2], normal @ face.axes.T])
        centres = _centres(grid)
        between = _linear(local[:, :2], values, centres)
        held, inside = _members(local[:, :2], index, centres, np.isfinite(between[:, 0]), cell)
        share = np.bincount(inside, minlength=len(centres))

        def mean(values: Float) -> Float:
            with np.errstate(invalid="ignore", divide="ignore"):
                return np.asarray(np.bincount(inside, values[held], len(share)) / share).reshape(grid.shape)

        normals = np.stack([mean(normal[:, k]) for k in range(3)], axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
            upright = normals @ face.axes[2]
            # points of two cells that touch are at most two diagonals apart
            alone = _step(index, local[:, 2], grid) <= np.sqrt(8.0) * cell * np.tan(np.radians(MAX_OBLIQUE_DEG))
        between = between.reshape(*grid.shape, 5)
        distance = np.where(np.isnan(between[..., 0]), mean(distance), between[..., 0])
        area = _halfway(between[..., 1], between[..., 2:], distance, cell)
        area = np.where(np.isnan(area), cell**2 / upright, area)
        area = np.where(alone & (upright >= np.cos(np.radians(MAX_OBLIQUE_DEG))), area, 0.0)
        plants = plant_error(found, np.flatnonzero(here))
        fewest = np.minimum(found.reference.count, found.moving.count)[here].astype(np.float64)
        return cls(
            face,
            local,
            grid,
            np.where(area > 0, distance, np.nan),
            np.where(area > 0, mean(found.level[here]) / quantile(found.confidence), np.nan),
            area,
            mean(local[:, 2]),
            slope_of(normals.reshape(-1, 3)).reshape(grid.shape),
            np.nan_to_num(mean(fewest)).astype(np.int64),
            None if plants is None else found.plants_factor * mean(plants),
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


def _linear(places: Float, values: Float, centres: Float) -> Float:
    """Values (n, k) at places (n, 2), linear between them at centres (m, 2); NaN beyond."""
    try:
        return np.asarray(LinearNDInterpolator(Delaunay(places), values)(centres))
    except QhullError:  # few core points, or all on a line
        return np.full((len(centres), values.shape[1]), np.nan)


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


def _halfway(depth: Float, normals: Float, distance: Float, cell: float) -> Float:
    """Area (rows, columns), m², that a distance along the mean normals passes through in each cell; NaN at a rim.

    On the surface it is the scalar product of the mean normal and the vector of the area: noise tilts normals, which
    makes distances longer and this product smaller by as much. Halfway to the other surface it is larger where the
    surface bulges towards that, by the mean curvature times the distance (Steiner's formula for parallel surfaces).

    Args:
        depth: of the surface at the cells' centres, m over the plane along whose axes the ``normals`` (rows, columns,
            3) are.
    """
    if min(depth.shape) < 2:
        return np.full(depth.shape, np.nan)

    def rises(values: Float) -> tuple[Float, Float]:
        return np.gradient(values, cell, axis=1), -np.gradient(values, cell, axis=0)

    along, up = rises(depth)
    on_the_surface = normals[..., 2] - normals[..., 0] * along - normals[..., 1] * up
    curvature = (rises(normals[..., 0])[0] + rises(normals[..., 1])[1]) / 2.0
    return np.asarray(cell**2 * on_the_surface * (1.0 + curvature * distance))


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
